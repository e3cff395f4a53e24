"""What tests fork is what an interpreter would start: else they prove nothing of programs."""

import contextlib
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import psutil
import pytest

from tests.forks import END, ROOT, ForkedPopen, fork_program
from tests.preloaded import _RUN_SERVER

SHOWS = """\
import atexit, gc, json, os, signal, sys, threading
from pathlib import Path

def proc(name):
    parts = Path(f"/proc/self/{name}").read_bytes().split(b"\\0")
    return [os.fsdecode(one).rstrip() for one in parts]

print(json.dumps({
    "name": __name__,
    "argv": sys.argv,
    "command": [one for one in proc("cmdline") if one],
    "mark": [os.environ["MARK"], "MARK=" + os.environ["MARK"] in proc("environ")],
    "gone": [name for name in ("WIL_CAMPAIGN_ROOM", "OPENBLAS_NUM_THREADS") if name in os.environ],
    "folder": os.getcwd(),
    "path": sys.path,
    "leads": os.getsid(0) == os.getpid() == os.getpgid(0),
    "descriptors": sorted(
        int(one) for one in os.listdir("/proc/self/fd") if os.path.exists(f"/proc/self/fd/{one}")
    ),
    "signals": [signal.getsignal(one) == signal.SIG_DFL for one in (signal.SIGTERM, signal.SIGHUP)],
    "interrupt": signal.getsignal(signal.SIGINT) is signal.default_int_handler,
    "threads": threading.active_count(),
    "priority": [os.sched_getscheduler(0), os.nice(0)],
    "collects": gc.isenabled(),
    "says": sys.stdin.read(),
}))
atexit.register(print, "at its end", flush=True)
threading.Thread(target=lambda: print("a thread", flush=True)).start()
sys.exit("why it ended" if sys.argv[1] == "words" else int(sys.argv[1]))
"""
SERVES = """\
import multiprocessing, os, sys

def flies():
    command = open("/proc/self/cmdline").read()
    is_forked = "wil_campaign.orchestrator.cli.commands.run" in sys.modules
    print(is_forked, os.environ["MARK"], "multiprocessing.forkserver" in command, flush=True)

if __name__ == "__main__":
    os.environ["MARK"] = "changed"
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([PRELOADED])
    process = context.Process(target=flies)
    process.start()
    process.join()
    print(process.exitcode, multiprocessing.forkserver._forkserver._forkserver_pid)
"""


@pytest.mark.parametrize("ends", ["0", "7", "words"])
def test_a_forked_program_is_what_a_started_one_is(tmp_path: Path, ends: str) -> None:
    (tmp_path / "shows.py").write_text(SHOWS)
    given = {name: text for name, text in os.environ.items() if name != "OPENBLAS_NUM_THREADS"}
    given |= {"MARK": "of this one", "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "shows", ends, "more words"]
    started = subprocess.run(  # noqa: S603 - our own interpreter
        command,
        cwd=tmp_path,
        env=given,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        start_new_session=True,
        check=False,
    )
    expected = started.stdout.splitlines()[0]
    assert json.loads(expected)["mark"] == ["of this one", True]
    with (tmp_path / "stderr").open("wb") as stderr:
        forked = ForkedPopen(
            command, stdout=subprocess.PIPE, stderr=stderr.fileno(), env=given, cwd=tmp_path
        )
        assert forked.stdout is not None
        with forked:
            out = forked.stdout.read()
    shown, *others = out.splitlines()
    facts = json.loads(shown)
    for one in (3, END):  # by which it asks for its run server, and for children
        facts["descriptors"].remove(one)
    assert [facts, *others] == [json.loads(expected), *started.stdout.splitlines()[1:]]
    assert (tmp_path / "stderr").read_bytes() == started.stderr
    assert forked.wait() == started.returncode


async def test_a_forked_program_is_killed_as_others(tmp_path: Path) -> None:
    (tmp_path / "sleeps.py").write_text("import time\nprint(1, flush=True)\ntime.sleep(600)\n")
    program = await fork_program("-m", "sleeps", environment=os.environ, cwd=tmp_path)
    assert program.stdout is not None
    assert await program.stdout.readline() == b"1\n"
    os.killpg(program.pid, signal.SIGKILL)
    assert await program.communicate() == (b"", b"")
    assert program.returncode == -signal.SIGKILL


async def test_the_run_server_of_a_forked_program_is_forked_and_ends_with_it(
    tmp_path: Path,
) -> None:
    (tmp_path / "serves.py").write_text(SERVES.replace("PRELOADED", repr(_RUN_SERVER)))
    environment = {**os.environ, "MARK": "given"}
    program = await fork_program("-m", "serves", environment=environment, cwd=tmp_path)
    out, err = await program.communicate()
    assert err == b""
    flies, ended = out.decode().splitlines()
    assert flies == "True changed True"
    code, server = ended.split()
    assert code == "0"
    with contextlib.suppress(psutil.NoSuchProcess):
        psutil.Process(int(server)).wait(60.0)
