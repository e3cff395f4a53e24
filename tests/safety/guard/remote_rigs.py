"""What tests of the guard's process share; run as a program: an orchestrator to be killed."""

import asyncio
import json
import sys
import time
from collections.abc import Awaitable, Callable
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Any, Self

from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.safety.guard.core.events import GuardedVehicle, GuardSettings
from wil_campaign.safety.guard.process.guard_config import GuardConfig, GuardedVehicleConfig
from wil_campaign.safety.guard.process.remote_guard import RemoteGuard
from wil_campaign.safety.model.samples import PoseSample
from wil_campaign.vehicles.autopilots.autopilot import MavlinkTarget, command_long
from wil_campaign.vehicles.autopilots.px4 import Px4
from wil_campaign.vehicles.links.link_conditions import LinkConditions
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec
from wil_campaign.worlds.frames import Pose

ROOT = Path(__file__).parents[3]
SYSTEMS = {"real": 1, "twin": 2}
FENCE = Fence.box(north_m=(-3, 5), east_m=(-3, 3), up_m=(-1, 6))
DRIVER = MavlinkCodec(system_id=245, component_id=190)
PATIENT = GuardSettings(orchestrator_silent_s=5.0)
"""A test on a loaded machine may be silent for longer than an orchestrator may."""
SILENT_S, LOST_S = 4.0, 8.0
"""How long the orchestrator of this file may be silent, and how long the fake vehicles wait until
they land by themselves: who acts is seen by when it does."""


def guard_config(
    folder: Path, *, conditions: LinkConditions | None = None, **more: Any
) -> GuardConfig:
    return GuardConfig(
        run="test/wil/1",
        folder=str(folder),
        epoch_s=time.time() - time.monotonic(),
        vehicles={
            name: GuardedVehicleConfig(
                vehicle=GuardedVehicle(autopilot=Px4(), target=MavlinkTarget(system), fence=FENCE),
                conditions=conditions or LinkConditions(),
            )
            for name, system in SYSTEMS.items()
        },
        **more,
    )


class RemoteFlight:
    """A remote guard over two fake vehicles that are in the air; the test is the orchestrator."""

    def __init__(
        self, folder: Path, *, up_m: float = 0.4, lost_s: float = LOST_S, **charter_fields: Any
    ) -> None:
        self.folder = folder
        self.guard = RemoteGuard(
            guard_config=guard_config(folder, **{"settings": PATIENT, **charter_fields}),
            record=lambda *row: self.wire.append(row),
        )
        self.up_m, self.lost_s = up_m, lost_s
        self.wire: list[tuple[str, float, bytes]] = []
        self.heard: dict[str, int] = dict.fromkeys(SYSTEMS, 0)
        self.pids: dict[str, int] = {}

    async def __aenter__(self) -> Self:
        async with AsyncExitStack() as stack:
            for name in SYSTEMS:
                link = self.guard.link(name)
                link.receive(self._hear(name))
                await stack.enter_async_context(link)
            await stack.enter_async_context(self.guard)
            for name, system in SYSTEMS.items():
                self.pids[name] = await self.guard.start(name, self._argv(name, system))
            self._stream()
            stack.callback(self._still)
            await until(lambda: all(self.heard.values()))
            await until(lambda: all(words(self.folder, name) for name in SYSTEMS))
            self._stack = stack.pop_all()
        return self

    async def __aexit__(self, *error: object) -> None:
        await self._stack.aclose()

    def _argv(self, name: str, system: int) -> list[str]:
        program = [sys.executable, "-m", "tests.safety.guard.fake_vehicle_program"]
        numbers = (self.guard.port(name), system, self.up_m, self.lost_s)
        return [*program, *map(str, numbers), str(self.folder / f"{name}.words")]

    def _hear(self, name: str) -> Callable[[bytes, float], None]:
        def hear(data: bytes, t_s: float) -> None:
            self.heard[name] += 1

        return hear

    def _stream(self) -> None:
        """Keep the vehicles from their own failsafe, as a driver does."""
        for name in SYSTEMS:
            self.send(name, 512)
        self._timer = asyncio.get_running_loop().call_later(0.2, self._stream)

    def _still(self) -> None:
        self._timer.cancel()

    def send(self, name: str, number: int = 512) -> None:
        """Send a command that moves nothing."""
        self.guard.link(name).write(DRIVER.pack(command_long(MavlinkTarget(SYSTEMS[name]), number)))

    def place(self, name: str, north_m: float) -> None:
        now_s = asyncio.get_running_loop().time()
        sample = PoseSample(now_s, name, Pose((north_m, 0.0, -0.4)), (0.0, 0.0, 0.0))
        self.guard.position(sample)

    def kinds(self) -> list[str]:
        return [e.kind for e in self.guard.events if e.kind not in {"action", "dropped"}]


def words(folder: Path, name: str) -> list[tuple[float, str]]:
    """Return what a fake vehicle heard, and when."""
    lines = (folder / f"{name}.words").read_text().splitlines()
    return [(float(t_s), word) for t_s, _, word in (line.partition(" ") for line in lines)]


def log_lines(folder: Path) -> list[dict[str, Any]]:
    """Return the lines of guard.jsonl."""
    return [json.loads(line) for line in (folder / "guard.jsonl").read_text().splitlines()]


async def until(condition: Callable[[], bool], timeout_s: float = 60.0) -> float:
    """Wait until a condition holds; returns when."""
    loop = asyncio.get_running_loop()
    async with asyncio.timeout(timeout_s):
        while not condition():  # noqa: ASYNC110 - other processes set no event of ours
            await asyncio.sleep(0.01)
    return loop.time()


async def start_orchestrator(
    folder: Path, *, patience_s: float = 120.0
) -> tuple[asyncio.subprocess.Process, dict[str, int]]:
    """Start this file as a program; returns it and the process ids, once all are in the air."""
    program = await asyncio.create_subprocess_exec(
        sys.executable,
        "-m",
        "tests.safety.guard.remote_rigs",
        str(folder),
        str(patience_s),
        stdout=asyncio.subprocess.PIPE,
        cwd=ROOT,
    )
    assert program.stdout is not None
    async with asyncio.timeout(120.0):
        line = await program.stdout.readline()
    return program, json.loads(line)


async def _orchestrate(folder: Path, patience_s: float, last: Callable[[], Awaitable[Any]]) -> None:
    settings = GuardSettings(orchestrator_silent_s=SILENT_S)
    async with RemoteFlight(folder, up_m=0.6, settings=settings, patience_s=patience_s) as flight:
        sys.stdout.write(json.dumps({"guard": flight.guard.pid, **flight.pids}) + "\n")
        sys.stdout.flush()
        await last()


if __name__ == "__main__":
    asyncio.run(_orchestrate(Path(sys.argv[1]), float(sys.argv[2]), asyncio.Event().wait))
