"""The Ray actor on a node: starts the node process, and relays bytes to and from it.

The node process is no part of Ray: it has its own session and is no child of Ray's worker, which
kills its children when it ends. When Ray ends its worker the pipe ends too; the run in flight then
lands, and its files are delivered. The actor ends when its raylet does, also where Ray would keep
it: the run cannot be reached through it any longer.
"""

import os
import select
import subprocess
import sys
import threading
import time
from collections.abc import Mapping
from multiprocessing.connection import Connection

_MAX_MESSAGES = 100
_RAY_VARIABLES = ("RAY_", "OMP_NUM_THREADS")
"""Environment variables that the node process must not inherit: a cluster token, and what Ray sets
for its own workers."""
_RAYLET_PID = "RAY_RAYLET_PID"
"""In the environment of a Ray worker: the process id of its raylet, which is its parent."""
_POLL_S = 1.0
_DETACH = """\
import os, sys
pid = os.fork()
if pid:
    os.write(int(sys.argv[1]), b"%d" % pid)
    os._exit(0)
os.close(int(sys.argv[1]))
os.execv(sys.argv[2], sys.argv[2:])
"""
"""Starts a command as a grandchild, ends, and writes the command's pid to a descriptor."""


class PipeAgent:
    """Relays messages to a process of this node and back."""

    def __init__(self, to: Connection, back: Connection) -> None:
        self._to = to
        self._from = back
        self._sending = threading.Lock()
        raylet = os.environ.get(_RAYLET_PID, "")
        if raylet == str(os.getppid()):
            threading.Thread(target=_end_with_parent, args=(int(raylet),), daemon=True).start()

    def send(self, message: bytes) -> None:
        """Send a message to the process. Raises OSError."""
        with self._sending:
            self._to.send_bytes(message)

    def receive(self, wait_s: float) -> list[bytes]:
        """Return the process's next messages; an empty list after `wait_s`.

        Raises EOFError when the process has ended.
        """
        messages: list[bytes] = []
        while len(messages) < _MAX_MESSAGES and self._from.poll(0 if messages else wait_s):
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
        inherited = {
            name: text for name, text in os.environ.items() if not name.startswith(_RAY_VARIABLES)
        }
        command = [sys.executable, "-P", "-m", "wil_campaign.plugins.cluster.node_process"]
        environment = {**inherited, "PYTHONPATH": os.pathsep.join(sys.path)}
        self.pid, to, back = _start_detached(command, environment)
        super().__init__(Connection(to, readable=False), Connection(back, writable=False))

    def close(self) -> None:
        """End the process, after its run has landed."""
        super().close()
        await_process_end(self.pid)


def await_process_end(pid: int, limit_s: float | None = None) -> bool:
    """Wait until a process has ended, also one that is no child; return whether it has in time."""
    try:
        handle = os.pidfd_open(pid)
    except ProcessLookupError:
        return True
    try:
        poller = select.poll()
        poller.register(handle, select.POLLIN)
        return bool(poller.poll(None if limit_s is None else limit_s * 1000.0))
    finally:
        os.close(handle)


def _start_detached(command: list[str], environment: Mapping[str, str]) -> tuple[int, int, int]:
    """Start a command that is no child of this process, in a session of its own.

    Return its process id, and the descriptors of its standard input and output. Raises OSError.
    """
    pid_output, pid_input = os.pipe()
    starter = subprocess.Popen(  # noqa: S603 - our own program
        [sys.executable, "-I", "-S", "-c", _DETACH, str(pid_input), *command],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        start_new_session=True,
        env=environment,
        pass_fds=[pid_input],
    )
    os.close(pid_input)
    with os.fdopen(pid_output, "rb") as stream:
        pid = stream.read()
    starter.wait()
    if not pid or starter.stdin is None or starter.stdout is None:
        raise OSError("the node process cannot be started")
    with starter.stdin, starter.stdout:
        return int(pid), os.dup(starter.stdin.fileno()), os.dup(starter.stdout.fileno())


def _end_with_parent(parent: int) -> None:
    """End this process, and with it its pipes, once its parent has ended."""
    while os.getppid() == parent:
        time.sleep(_POLL_S)
    os._exit(1)
