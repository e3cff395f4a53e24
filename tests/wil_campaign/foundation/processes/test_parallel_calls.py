"""Calls in processes beside a program: a lost process, or Ctrl-C, ends them all."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

_PROGRAM = """
import multiprocessing, os, signal, sys, time
from concurrent.futures.process import BrokenProcessPool
from wil_campaign.foundation.processes.parallel_calls import call_in_processes

def echo(number, _):
    return number

def die(*_):
    os.kill(os.getpid(), signal.SIGKILL)

def wait(*_):
    os.write(1, b"waits\\n")
    time.sleep(600)

def blocks_ctrl_c(*_):
    return signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, ())

if __name__ == "__main__":
    function = globals()[sys.argv[1]]
    large = bytes(1_000_000)  # more than a pipe takes: the pool's thread waits for a reader
    try:
        context = multiprocessing.get_context("spawn")
        print(call_in_processes([(function, (n, large)) for n in range(12)], 2, context))
    except (BrokenProcessPool, KeyboardInterrupt) as error:
        print(type(error).__name__)
"""
_ROOT = Path(__file__).parents[4]
_WITHIN_S = 120.0


@contextmanager
def _started(tmp_path: Path, function: str) -> "Iterator[subprocess.Popen[str]]":
    program = tmp_path / "program.py"
    program.write_text(_PROGRAM)
    started = subprocess.Popen(  # noqa: S603 - our own program
        [sys.executable, program, function],
        env={**os.environ, "PYTHONPATH": str(_ROOT)},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )
    try:
        yield started
    finally:
        with suppress(ProcessLookupError):
            os.killpg(started.pid, signal.SIGKILL)
        started.wait()


@pytest.mark.parametrize(
    ("function", "said"),
    [
        ("echo", f"{list(range(12))}\n"),
        ("die", "BrokenProcessPool\n"),
        ("blocks_ctrl_c", f"{[True] * 12}\n"),  # else one prints a traceback while it imports
    ],
)
def test_results_come_in_order_unless_a_process_is_lost(
    tmp_path: Path, function: str, said: str
) -> None:
    """The program's output ends when no process has it open."""
    with _started(tmp_path, function) as program:
        assert program.communicate(timeout=_WITHIN_S)[0] == said


def test_ctrl_c_ends_the_processes(tmp_path: Path) -> None:
    with _started(tmp_path, "wait") as program:
        assert program.stdout is not None
        assert [program.stdout.readline() for _ in range(2)] == ["waits\n", "waits\n"]
        os.killpg(program.pid, signal.SIGINT)  # as a terminal does
        assert program.communicate(timeout=_WITHIN_S)[0] == "KeyboardInterrupt\n"
