"""The count of what a flight leaves can fail: sockets that outlive it, and files."""

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.faults.processes import own_files
from tests.faults.socket_ledger import SocketLedger, files_left
from wil_campaign.foundation.processes.identity import ProcessId

_FLIGHT = """
import os, socket, subprocess, sys
ends = [socket.socket(family, kind) for family, kind in (
    (socket.AF_INET, socket.SOCK_DGRAM), (socket.AF_INET, socket.SOCK_STREAM),
    (socket.AF_UNIX, socket.SOCK_STREAM), (socket.AF_UNIX, socket.SOCK_DGRAM))]
ends[0].bind(("127.0.0.1", 0))
ends[1].bind(("127.0.0.1", 0))
ends[1].listen()
ends[2].bind("\\0of-a-flight-%d" % os.getpid())
ends[2].listen()
ends[3].bind(sys.argv[1])
kept = [end.fileno() for end in ends]
words = [sys.executable, "-c", "import sys; sys.stdin.read()"]
print(ends[0].getsockname()[1], flush=True)
sys.stdin.readline()
if sys.argv[2] == "keeps":
    # Only now: it reads the same pipe, and would take the line.
    child = subprocess.Popen(words, env={}, pass_fds=kept)
"""
"""Its child has none of its environment, and with `keeps` all its sockets."""


@pytest.fixture
def runtime(tmp_path: Path) -> Path:
    for name in ("wil-campaign", "tmp"):
        (tmp_path / name).mkdir(mode=0o700)
    return tmp_path


def _flown(runtime: Path, what: str, stack: ExitStack) -> tuple[SocketLedger, int, int]:
    """Let a process open sockets and end; return what was counted, its id and its UDP port."""
    bound = str(runtime / "wil-campaign" / "s")
    process = stack.enter_context(
        subprocess.Popen(  # noqa: S603 - our own program
            [sys.executable, "-c", _FLIGHT, os.path.relpath(bound), what],
            env={**os.environ, "XDG_RUNTIME_DIR": str(runtime)},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )
    )
    assert process.stdin is not None
    assert process.stdout is not None
    ledger = SocketLedger(runtime)
    port = int(process.stdout.readline())
    ledger.look()
    # Its child reads the pipe to its end, which comes when the stack is left.
    process.stdin.write(b"\n")
    process.stdin.flush()
    process.wait()
    return ledger, process.pid, port


def _ends(ledger: SocketLedger) -> Iterator[str]:
    return (one.partition(" of ")[0] for one in ledger.left())


def test_sockets_that_an_unknown_process_keeps_are_found(runtime: Path) -> None:
    with ExitStack() as stack:
        ledger, pid, port = _flown(runtime, "keeps", stack)
        found = sorted(_ends(ledger))
    assert len(ledger.seen) == 4
    assert found[0].startswith("tcp port ")
    assert found[1] == f"udp port {port}"
    assert found[2].startswith("unix ")
    assert found[2].endswith("s")
    assert found[3] == f"unix @of-a-flight-{pid}"


def test_sockets_that_ended_with_their_process_are_not(runtime: Path) -> None:
    with ExitStack() as stack:
        ledger, *_ = _flown(runtime, "ends", stack)
        assert len(ledger.seen) == 4
        assert ledger.left() == []


def test_files_of_a_killed_program_are_left_when_no_next_start_removes_them(runtime: Path) -> None:
    killed = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    victim = ProcessId.of(killed.pid)
    killed.kill()
    killed.communicate()
    (runtime / "tmp" / "wil-jsbsim-0").mkdir()
    assert own_files(runtime, victim) == ([], [])
    own = f"wil-campaign/guard-{killed.pid}.sock"
    others = ("tmp/pymp-x", f"wil-campaign/guard-{killed.pid}0.sock", "wil-campaign/x.sock")
    for name in (own, *others):
        (runtime / name).touch()
    assert files_left(runtime) == sorted((own, *others))
    assert own_files(runtime, victim) == ([own], sorted(others))
    assert not (runtime / own).exists()
    # Of who was not killed, nothing may be there even for a while.
    (runtime / own).touch()
    assert own_files(runtime, None) == ([], sorted((own, "tmp/pymp-x", "wil-campaign/x.sock")))
