"""The actor of Ray on a node: starts the node's own process and passes bytes on to it and back.

The process is no part of Ray, and has a session of its own: what Ray does to its worker ends the
pipe, and the run in flight then lands. The actor ends when its raylet does, also where Ray has it
linger on: nobody could reach the run through it.
"""

import os
import subprocess
import sys
import threading
import time
from multiprocessing.connection import Connection

_MOST_AT_ONCE = 100
_OF_RAY = ("RAY_", "OMP_NUM_THREADS")
"""Of the environment: a token of the cluster, and what Ray sets for its own workers."""
_RAYLET = "RAY_RAYLET_PID"
"""In the environment of a worker of Ray: the process id of its raylet, which is its parent."""
_LOOK_S = 1.0


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
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "orchestrator.engines.node_process"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,
            env={**kept, "PYTHONPATH": os.pathsep.join(sys.path)},
        )
        if self._process.stdin is None or self._process.stdout is None:
            raise OSError("the process of the node has no pipes")
        super().__init__(
            Connection(os.dup(self._process.stdin.fileno()), readable=False),
            Connection(os.dup(self._process.stdout.fileno()), writable=False),
        )
        for stream in (self._process.stdin, self._process.stdout):
            stream.close()

    def close(self) -> None:
        """End the process, after its run has landed."""
        super().close()
        self._process.wait()


def _end_with_parent(parent: int) -> None:
    """End this process, and with it its pipes, once it is another process's child."""
    while os.getppid() == parent:
        time.sleep(_LOOK_S)
    os._exit(1)
