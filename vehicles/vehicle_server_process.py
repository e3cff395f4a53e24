"""The process of the vehicles' fork server: its command, its start, and what a run inherits."""

import os
import socket
import sys
from contextlib import suppress

from wil_campaign.foundation.processes.child import ChildProcess
from wil_campaign.foundation.processes.fork_server import ONE_THREAD

_ROOM = 8000
"""Characters of the server's command line that a vehicle's, with its settings, replaces."""
_END_S = 1.0
_inherited: list[int] = []


def vehicle_program() -> tuple[str, ...]:
    """Return the words of an embedded vehicle's command before its settings."""
    return (sys.executable, "-P", "-m", "wil_campaign.vehicles.embedded")


def inherit_vehicle_server(descriptor: int) -> None:
    """Have this process's guards start vehicles by the fork server at a descriptor."""
    _inherited[:] = [descriptor]


def vehicle_server() -> int | None:
    """Return the descriptor of the fork server that this process inherited; None without."""
    return _inherited[0] if _inherited else None


class VehicleServerProcess:
    """The fork server of vehicles. descriptor: of its clients' end, for processes that ask it."""

    def __init__(self) -> None:
        self._ours, self._theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._child: ChildProcess | None = None

    @property
    def descriptor(self) -> int:
        """Return the descriptor of the clients' end."""
        return self._ours.fileno()

    def start(self) -> None:
        """Start the process, once; it imports for a second. Without it guards start vehicles."""
        if self._child is not None:
            return
        number = self._theirs.fileno()
        program = ("-P", "-m", "wil_campaign.vehicles.vehicle_server")
        self._child = ChildProcess(
            argv=(sys.executable, *program, str(number), " " * _ROOM),
            # Not what C code has set besides, which no vehicle is given.
            environment={**os.environ, **ONE_THREAD},
            inherited=(number,),
            grace_s=_END_S,
        )
        with suppress(OSError):
            self._child.start()
        self._theirs.close()

    async def close(self) -> None:
        """Close the clients' end, and end the process. Vehicles go on; their parent is another."""
        self._ours.close()
        self._theirs.close()
        if self._child is not None:
            await self._child.wait(_END_S)
            await self._child.end()
