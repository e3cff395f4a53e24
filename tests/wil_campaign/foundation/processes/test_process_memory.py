"""Resident memory: of this process, and of the right process after a fork."""

import subprocess
import sys

import numpy as np
import psutil
import pytest

from wil_campaign.foundation.processes import process_memory
from wil_campaign.foundation.processes.process_memory import resident_mb

FORKED = """
import os
from wil_campaign.foundation.processes.process_memory import resident_mb

before_mb = resident_mb()
if os.fork() == 0:
    kept = bytearray(b"1") * 200_000_000
    print(resident_mb() - before_mb, flush=True)
    os._exit(0)
os.wait()
print(resident_mb() - before_mb)
"""


def test_own_memory_is_what_psutil_says_and_grows() -> None:
    assert resident_mb() == pytest.approx(resident_mb(psutil.Process()), rel=0.02)
    before_mb = resident_mb()
    kept = np.ones(100_000_000, np.uint8)
    assert resident_mb() - before_mb == pytest.approx(100.0, abs=15.0)
    assert kept.nbytes == 100_000_000


def test_psutil_gives_the_memory_where_the_system_does_not(monkeypatch: pytest.MonkeyPatch) -> None:
    here_mb = resident_mb()
    monkeypatch.setattr(process_memory, "_own_mb", lambda: None)
    assert resident_mb() == pytest.approx(here_mb, rel=0.02)


def test_a_fork_reads_its_own_memory() -> None:
    done = subprocess.run(  # noqa: S603 - our own program
        [sys.executable, "-c", FORKED], check=True, capture_output=True, text=True
    )
    child_mb, parent_mb = map(float, done.stdout.split())
    assert child_mb > 180.0
    assert parent_mb < 20.0
