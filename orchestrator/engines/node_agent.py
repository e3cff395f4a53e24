"""The actor of Ray on a node: starts the node's own process and passes bytes on to it and back.

The process is no part of Ray: it has a session of its own, and is no child of Ray's worker, which
kills its children when it ends. What Ray does to its worker ends the pipe; the run in flight then
lands, and its files go where they belong. The actor ends when its raylet does, also where Ray has
it linger on: nobody could reach the run through it.
"""

import os
import select
import subprocess
import sys
import threading
import time
from collections.abc import Mapping
from multiprocessing.connection import Connection

_MOST_AT_ONCE = 100
_OF_RAY = ("RAY_", "OMP_NUM_THREADS")
"""Of the environment: a token of the cluster, and what Ray sets for its own workers."""
_RAYLET = "RAY_RAYLET_PID"
"""In the environment of a worker of Ray: the process id of its raylet, which is its parent."""
_LOOK_S = 1.0
_DETACH = """\
import os, sys
pid = os.fork()
if pid:
    os.write(int(sys.argv[1]), b"%d" % pid)
    os._exit(0)
os.close(int(sys.argv[1]))
os.execv(sys.argv[2], sys.argv[2:])
"""
"""Starts a command as a child of nobody here, and writes its process id to a descriptor."""


class PipeAgent:
    """Passes messages on to a process of this node and back."""

    def __init__(self, to: Connection, back: Connection) -> None:
        self._to = to
        self._from = back
        self._sending = threading.Lock()
        raylet = os.environ.get(_RAYLET, "")
        if raylet == str(os.getppid()):
            threading.Thread(target=_end_with_parent, args=(int(raylet),), daemon=True).start()

    def send(self, message: bytes) -> None:
        """Pass a message on to the process. Raises OSError."""
        with self._sending:
            self._to.send_bytes(message)

    def receive(self, wait_s: float) -> list[bytes]:
        """Return the process's next messages; none when none has come in time.

        Raises EOFError when it has ended.
        """
        messages: list[bytes] = []
        while len(messages) < _MOST_AT_ONCE and self._from.poll(0 if messages else wait_s):
            try:
                messages.append(self._from.recv_bytes())
            except EOFError:
                if messages:
                    break
                raise
        return messages

    def close(self) -> None:
        """End the connection to the process."""
        self._to.close()


class NodeAgent(PipeAgent):
    """Relays between the machine of a campaign and the process on this node."""

    def __init__(self) -> None:
        kept = {name: text for name, text in os.environ.items() if not name.startswith(_OF_RAY)}
        command = [sys.executable, "-P", "-m", "orchestrator.engines.node_process"]
        environment = {**kept, "PYTHONPATH": os.pathsep.join(sys.path)}
        self.pid, to, back = _start_detached(command, environment)
        super().__init__(Connection(to, readable=False), Connection(back, writable=False))

    def close(self) -> None:
        """End the process, after its run has landed."""
        super().close()
        await_end(self.pid)


def await_end(pid: int, limit_s: float | None = None) -> bool:
    """Wait until a process has ended, whoever's child it is; return whether it has in time."""
    try:
        handle = os.pidfd_open(pid)
    except ProcessLookupError:
        return True
    try:
        look = select.poll()
        look.register(handle, select.POLLIN)
        return bool(look.poll(None if limit_s is None else limit_s * 1000.0))
    finally:
        os.close(handle)


def _start_detached(command: list[str], environment: Mapping[str, str]) -> tuple[int, int, int]:
    """Start a command that is no child of this process, in a session of its own.

    Return its process id, the descriptor of its standard input, and of its output. Raises OSError.
    """
    told, tell = os.pipe()
    starter = subprocess.Popen(  # noqa: S603 - our own program
        [sys.executable, "-I", "-S", "-c", _DETACH, str(tell), *command],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        start_new_session=True,
        env=environment,
        pass_fds=[tell],
    )
    os.close(tell)
    with os.fdopen(told, "rb") as stream:
        pid = stream.read()
    starter.wait()
    if not pid or starter.stdin is None or starter.stdout is None:
        raise OSError("the process of the node cannot be started")
    with starter.stdin, starter.stdout:
        return int(pid), os.dup(starter.stdin.fileno()), os.dup(starter.stdout.fileno())


def _end_with_parent(parent: int) -> None:
    """End this process, and with it its pipes, once it is another process's child."""
    while os.getppid() == parent:
        time.sleep(_LOOK_S)
    os._exit(1)
