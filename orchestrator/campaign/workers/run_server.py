"""The run server: a process that has imported all that a run needs, and forks a process per run.

So each run starts at once, and in the same state whatever flew before it.
"""

import atexit
import contextlib
import multiprocessing as mp
import os
import shutil
import signal
import socket
import stat
import tempfile
import threading
import time
from collections.abc import Iterator
from multiprocessing import forkserver, util
from multiprocessing.context import ForkServerContext
from pathlib import Path
from typing import Any

from wil_campaign.foundation.processes.interrupts import ctrl_c_blocked
from wil_campaign.safety.guard.process.runtime_folder import open_runtime_folder

_PRELOADED = "wil_campaign.orchestrator.campaign.workers.run_server_imports"
_SAFE_PATH = "PYTHONSAFEPATH"
IGNORED_SIGNALS = (signal.SIGTERM, signal.SIGHUP)
"""They reach the whole process group; the server ends when its campaign does."""
LOST_STATUS = 255
"""What `multiprocessing` gives for the exit status of a run whose run server has ended."""
_ENDING_TURN_S = 0.01
_STARTING = threading.Lock()
"""Held while the environment of this process is that of the run server."""


def run_context() -> ForkServerContext:
    """Return the context in which the processes of runs are forked from the run server."""
    context = mp.get_context("forkserver")
    context.set_forkserver_preload([_PRELOADED])
    return context


def start_run_server() -> None:
    """Start the run server unless it runs; it imports while the caller continues.

    It is a `python -c`, which would import a user's random.py in the current folder as ours. Raises
    RuntimeFolderError.
    """
    run_context()
    with _STARTING:
        _forget_lost_server()
        _shorten_socket_paths()
        before = os.environ.get(_SAFE_PATH)
        os.environ[_SAFE_PATH] = "1"
        try:
            with ctrl_c_blocked():
                forkserver.ensure_running()
            atexit.unregister(_end_importing_server)
            atexit.register(_end_importing_server, os.getpid())
        finally:
            del os.environ[_SAFE_PATH]
            if before is not None:
                os.environ[_SAFE_PATH] = before


def _end_importing_server(program: int) -> None:
    """End a server that still imports: what reads the program's output would wait for it.

    Later it ignores the signal, and ends with its program. program: the process that started it.
    """
    server = run_server_process()
    if os.getpid() == program and server is not None:
        with contextlib.suppress(OSError):
            os.kill(server, signal.SIGTERM)


def running_context() -> ForkServerContext | None:
    """Return the context of the run server where this program has one, started anew if lost."""
    if run_server_process() is None:
        return None
    try:
        start_run_server()
    except OSError:
        return None
    return run_context()


def run_server_process() -> int | None:
    """Return the process id of this program's run server, or None."""
    server: Any = getattr(forkserver, "_forkserver")  # noqa: B009 - private
    process: int | None = server._forkserver_pid  # noqa: SLF001
    return process


def has_run_server_ended(process: int, wait_s: float) -> bool:
    """Return whether a run server of this program has ended, or does so within `wait_s` seconds."""
    until = time.monotonic() + wait_s
    while True:
        try:
            if os.waitid(os.P_PID, process, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None:
                return True
        except ChildProcessError:  # `multiprocessing` has seen its end
            return True
        if time.monotonic() >= until:
            return False
        time.sleep(_ENDING_TURN_S)


def _forget_lost_server() -> None:
    """Have another server started, in another folder, where the socket of this one has gone.

    A server that ends removes it, and so does what cleans /tmp once it is old: each later campaign
    of the program, as of a search of days, could start no run. The lost one ends after its runs.
    """
    server: Any = getattr(forkserver, "_forkserver")  # noqa: B009 - private
    config = vars(mp.current_process())["_config"]
    with server._lock:  # noqa: SLF001 - so are its fields
        address = server._forkserver_address  # noqa: SLF001
        folder = config.get("tempdir")  # of util.get_temp_dir
        if folder is None or Path(address or folder).exists():
            return
        for finalizer in tuple(vars(util)["_finalizer_registry"].values()):
            if folder in (finalizer._args or ()):  # noqa: SLF001
                finalizer.cancel()  # it would report at the end what has gone
        del config["tempdir"]
        shutil.rmtree(folder, ignore_errors=True)
        if server._forkserver_alive_fd is not None:  # noqa: SLF001
            os.close(server._forkserver_alive_fd)  # noqa: SLF001 - the server ends by it
        server._forkserver_alive_fd = server._forkserver_pid = None  # noqa: SLF001
        server._forkserver_address = None  # noqa: SLF001


def _shorten_socket_paths() -> None:
    """Have `multiprocessing` make its sockets in our runtime folder, where their paths fit.

    A path in TMPDIR may be longer than the 107 bytes of sockaddr_un, unix(7).
    """
    before = tempfile.tempdir
    tempfile.tempdir = str(open_runtime_folder().path)
    try:
        util.get_temp_dir()  # is made once, and inherited by all processes of runs
    finally:
        tempfile.tempdir = before


def run_environment() -> dict[str, str]:
    """Return the environment of this process, for a run: not while the run server starts."""
    with _STARTING:
        return dict(os.environ)


def remove_listeners_at_exit() -> None:
    """Make this process, the run server, remove its listening socket when it ends.

    Otherwise the program that started it does so, unless that is killed.
    """
    server, paths = os.getpid(), tuple(_listening_paths())

    def remove() -> None:
        if os.getpid() != server:
            return
        for path in paths:
            with contextlib.suppress(OSError):
                path.unlink(missing_ok=True)
                path.parent.rmdir()  # made for this socket; stays while it has other files

    atexit.register(remove)


def _listening_paths() -> Iterator[Path]:
    """Yield the path of each Unix socket at which this process listens."""
    for entry in tuple(Path("/dev/fd").iterdir()):  # Linux and macOS have it, /proc only Linux
        if not _is_socket(int(entry.name)):
            continue
        with contextlib.suppress(OSError), socket.socket(fileno=os.dup(int(entry.name))) as end:
            listens = end.getsockopt(socket.SOL_SOCKET, socket.SO_ACCEPTCONN)
            name = end.getsockname()
            if end.family == socket.AF_UNIX and listens and isinstance(name, str) and name:
                yield Path(name)


def _is_socket(descriptor: int) -> bool:
    try:
        return stat.S_ISSOCK(os.fstat(descriptor).st_mode)
    except OSError:
        return False
