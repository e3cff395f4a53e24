"""What the harness sees of a flight's processes: who they are, who is left, what is true."""

import asyncio
import contextlib
import json
import os
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from pathlib import Path

from tests.faults.witness import Sight
from wil_campaign.foundation.processes.identity import ProcessId

_TELLERS = ("wil_campaign.foundation.processes.supervisor", "wil_campaign.orchestrator.cli")
"""Whose command lines name the program too."""


class TruthReceiver(asyncio.DatagramProtocol):
    """Keeps what the vehicles' processes tell of their physics."""

    def __init__(self) -> None:
        self.sights: dict[str, Sight] = {}

    def datagram_received(self, data: bytes, addr: object) -> None:
        said = json.loads(data)
        north_m, east_m, down_m, sink_m_s = said["place"]
        sight = self.sights.setdefault(said["vehicle"], Sight())
        place = (north_m, east_m, -down_m, sink_m_s)
        sight.see(asyncio.get_running_loop().time(), place, said["armed"])


@asynccontextmanager
async def truth_receiver() -> AsyncIterator[tuple[TruthReceiver, int]]:
    """Listen for the truth; gives the receiver and its port."""
    loop = asyncio.get_running_loop()
    transport, receiver = await loop.create_datagram_endpoint(
        TruthReceiver, local_addr=("127.0.0.1", 0)
    )
    try:
        yield receiver, transport.get_extra_info("sockname")[1]
    finally:
        transport.close()


def processes_of(runtime: Path) -> dict[int, tuple[int, str]]:
    """Return parent and command line, by id, of all that inherited a flight's environment.

    Whoever they are and whoever's child: `runtime` is in the environment of nobody else.
    """
    mark = f"XDG_RUNTIME_DIR={runtime}".encode()
    found = {}
    for pid in [int(one.name) for one in Path("/proc").iterdir() if one.name.isdecimal()]:
        with contextlib.suppress(OSError, UnicodeDecodeError):
            folder = Path(f"/proc/{pid}")
            if pid == os.getpid() or mark not in (folder / "environ").read_bytes().split(b"\0"):
                continue
            fields = (folder / "stat").read_bytes().rpartition(b")")[2].split()
            words = (folder / "cmdline").read_bytes().replace(b"\0", b" ").decode()
            if fields[0] not in {b"Z", b"X"}:
                found[pid] = (int(fields[1]), words)
    return found


def roles(program: int, runtime: Path) -> dict[str, ProcessId]:
    """Return the processes of a flight by what they are; program: the orchestrator's id."""
    found = {"orchestrator": program}
    for pid, (parent, words) in processes_of(runtime).items():
        if "wil_campaign.safety.guard.process" in words:
            found["guard"] = pid
        elif "wil_campaign.vehicles.embedded" in words:
            found[vehicle_of(words)] = pid
        elif "multiprocessing.forkserver" in words and parent != program:
            found["flight"] = pid  # what the run server, the program's child, has forked
        elif "pilot_program" in words and not any(teller in words for teller in _TELLERS):
            found.setdefault("autonomy", pid)
    return {name: one for name, pid in found.items() if (one := ProcessId.of(pid)) is not None}


def vehicle_of(words: str) -> str:
    """Return which vehicle a process flies, by its command line."""
    return "twin" if '"source":"twin"' in words else "real"


def vehicle_ports(runtime: Path) -> dict[str, int]:
    """Return the guard's UDP port of each embedded vehicle."""
    found = {}
    for _, words in processes_of(runtime).values():
        if "wil_campaign.vehicles.embedded" in words:
            settings = json.loads(words[words.index("{") :])
            found[vehicle_of(words)] = int(settings["link"].rpartition(":")[2])
    return found


async def all_gone(runtime: Path, within_s: float) -> Mapping[int, tuple[int, str]]:
    """Wait until no process of a flight is left; return who is."""
    loop = asyncio.get_running_loop()
    until_s = loop.time() + within_s
    while (left := processes_of(runtime)) and loop.time() < until_s:  # noqa: ASYNC110 - theirs
        await asyncio.sleep(0.2)
    return left
