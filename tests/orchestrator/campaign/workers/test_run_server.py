"""The run server: what it leaves when its program is killed."""

import os
import subprocess
import sys
import time
from pathlib import Path

_PROGRAM = """
import sys, time
from orchestrator.campaign.workers.run_server import start_run_server
start_run_server()
print("started", flush=True)
time.sleep(600)
"""
_ROOT = Path(__file__).parents[4]
_WITHIN_S = 120.0


def test_a_program_that_is_killed_leaves_no_socket_of_its_run_server(tmp_path: Path) -> None:
    environment = {**os.environ, "TMPDIR": str(tmp_path), "PYTHONPATH": str(_ROOT)}
    with subprocess.Popen(  # noqa: S603 - our own program
        [sys.executable, "-c", _PROGRAM], env=environment, cwd=_ROOT, stdout=subprocess.PIPE
    ) as program:
        assert program.stdout is not None
        assert program.stdout.readline() == b"started\n"
        assert [path.is_socket() for path in tmp_path.glob("pymp-*/*")] == [True]
        program.kill()
    end_s = time.monotonic() + _WITHIN_S  # it imports what runs need before it sees its end
    while any(tmp_path.glob("pymp-*")) and time.monotonic() < end_s:
        time.sleep(0.05)
    assert list(tmp_path.glob("pymp-*")) == []
