"""The actor on a node ends with its raylet, whatever Ray does."""

import os
import subprocess
import sys

import psutil
import pytest

from tests.test_house import ROOT

RAYLET = """\
import os, subprocess, sys, time
environment = {**os.environ, "RAY_RAYLET_PID": str(os.getpid() if sys.argv[2] == "mine" else 1)}
worker = subprocess.Popen([sys.executable, "-c", sys.argv[1]], env=environment)
worker.wait()
"""
WORKER = """\
import os, time
from multiprocessing import Pipe
from wil_campaign.plugins.cluster.node_agent import PipeAgent
agent = PipeAgent(*Pipe())
print(os.getpid(), flush=True)
time.sleep(100)
"""
ENDED_S = 30.0


@pytest.mark.parametrize("mine", [True, False])
def test_an_agent_ends_when_the_raylet_that_is_its_parent_does(*, mine: bool) -> None:
    with subprocess.Popen(  # noqa: S603 - our own interpreter
        [sys.executable, "-c", RAYLET, WORKER, "mine" if mine else "another"],
        stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    ) as raylet:
        assert raylet.stdout is not None
        worker = psutil.Process(int(raylet.stdout.readline()))
        raylet.kill()
        raylet.wait()
        # A parent that is no raylet of Ray's says nothing.
        _, alive = psutil.wait_procs([worker], timeout=ENDED_S if mine else 2.5)
        for one in alive:
            one.kill()
    assert bool(alive) is not mine
