"""A process that has imported the product, of which tests fork its programs: `tests.forks` asks it.

`python -P -m tests.preloaded END`; END: an inherited socket, see `fork_server.serve`.
"""

import atexit
import contextlib
import ctypes
import gc
import importlib
import json
import multiprocessing.util
import os
import runpy
import socket
import sys
import threading
import traceback
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from tests.forks import END, adopt, children_forked
from wil_campaign.vehicles.processes.fork_server import _place as place
from wil_campaign.vehicles.processes.fork_server import serve
from wil_campaign.vehicles.processes.linux import show_command

WORDS = 4
"""`python -P -m tests.preloaded`; behind it stands what is to be run, as JSON."""
_SPARE_BYTES = 1 << 16
_forked = contextlib.ExitStack()
_RUN_SERVER = "wil_campaign.orchestrator.campaign.workers.run_server_imports"
_IMPORTED = (
    "tests.safety.guard.fake_vehicle_program",
    "wil_campaign.orchestrator.cli.commands.run",
    "wil_campaign.orchestrator.operator.local_commands",
    "wil_campaign.plugins.cluster.node_results",
    "wil_campaign.plugins.cluster.travelling_files",
    "wil_campaign.safety.guard.process.guard_process",
    "wil_campaign.vehicles.embedded.process.embedded_process",
)


def main(arguments: Sequence[str]) -> int:
    """Serve until no client is left."""
    importlib.import_module(_RUN_SERVER)
    del sys.modules[_RUN_SERVER]  # each run server does itself what stands there
    for name in _IMPORTED:
        importlib.import_module(name)
    gc.freeze()
    assert len(tuple(Path("/proc/self/task").iterdir())) == 1, "a fork has only the first thread"
    os.write(1, b"ready\n")
    return serve(socket.socket(fileno=int(arguments[0])), _run, words=WORDS)


def _run(words: list[str]) -> int:
    """Run a program in a forked process; return its exit code."""
    given = json.loads(words[0])
    argv: list[str] = given["argv"]
    # A guard writes down who started it.
    setattr(os, "getppid", lambda: given["parent"])  # noqa: B010 - a function is replaced
    with contextlib.suppress(OSError):  # more of the processor than it has, by root alone
        os.sched_setscheduler(0, given["policy"], os.sched_param(0))
        os.setpriority(os.PRIO_PROCESS, 0, given["nice"])
    adopt(dict(os.environ))
    _forked.enter_context(children_forked())
    os.chdir(given["cwd"])
    _take_environment(given["environment"])
    show_command(argv)
    sys.orig_argv[:] = argv
    name = argv[argv.index("-m") + 1]
    sys.argv = argv[argv.index("-m") + 1 :]
    if "-P" not in argv[: argv.index("-m")]:
        sys.path.insert(0, str(Path.cwd()))
    if not name.startswith(("wil_campaign.safety", "wil_campaign.vehicles")):  # they start none
        _keep_run_server()
    return _finish(lambda: runpy.run_module(name, run_name="__main__", alter_sys=True))


def _finish(run: Callable[[], object]) -> int:
    """Run it, and end as the interpreter does; return the exit code."""
    code: object = 0
    try:
        run()
    except SystemExit as error:
        code = error.code
    except BaseException:  # noqa: BLE001 - as the interpreter reports it
        traceback.print_exc()
        code = 1
    if code is not None and not isinstance(code, int):
        sys.stderr.write(f"{code}\n")
        code = 1
    getattr(threading, "_shutdown")()  # noqa: B009 - private
    getattr(atexit, "_run_exitfuncs")()  # noqa: B009 - private
    return code or 0


def _take_environment(environment: Mapping[str, str]) -> None:
    """Have this environment, and /proc show it: tests find a flight's processes by it."""
    os.environ.clear()
    os.environ.update(environment)
    fields = Path("/proc/self/stat").read_text().rpartition(")")[2].split()
    begin, end = int(fields[47]), int(fields[48])
    entries = b"".join(os.fsencode(f"{name}={value}\0") for name, value in environment.items())
    assert len(entries) <= end - begin, "no room for the environment"
    # No variable points there any more: what is set since stands elsewhere.
    ctypes.memmove(begin, entries.ljust(end - begin, b"\0"), end - begin)


def _keep_run_server() -> None:
    """Fork what becomes the run server of `multiprocessing` when this program starts one."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    pid = os.fork()
    if pid == 0:
        ours.close()
        os._exit(_become_run_server(theirs))
    theirs.close()
    start: Any = multiprocessing.util.spawnv_passfds

    def start_or_have(path: bytes, words: Sequence[str], descriptors: Sequence[int]) -> int:
        if "multiprocessing.forkserver" not in words[-1] or ours.fileno() < 0:
            return int(start(path, words, descriptors))
        said = {
            "argv": [*map(os.fsdecode, words)],
            "numbers": list(descriptors),
            "environment": dict(os.environ),
        }
        socket.send_fds(ours, [json.dumps(said).encode()], descriptors)
        ours.close()
        return pid

    setattr(multiprocessing.util, "spawnv_passfds", start_or_have)  # noqa: B010 - a function is replaced


def _become_run_server(asked: socket.socket) -> int:
    """Wait until the program starts its run server, and be it; return the exit code."""
    data, descriptors, _, _ = socket.recv_fds(asked, _SPARE_BYTES, 8)
    if not data:
        return 0  # it needed none
    asked.close()
    given = json.loads(data)
    _take_environment(given["environment"])
    show_command(given["argv"])
    sys.orig_argv[:], sys.argv = given["argv"], ["-c"]
    place((0, 1, 2, END, *descriptors), (0, 1, 2, END, *given["numbers"]))
    return _finish(lambda: exec(given["argv"][-1], {"__name__": "__main__"}))  # noqa: S102 - its -c


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
