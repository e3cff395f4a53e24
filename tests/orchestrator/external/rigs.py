"""Stand-ins for what a run has, as far as its outside looks at them."""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from wil_campaign.vehicles.driver.vehicle_state import LocalEstimate
from wil_campaign.vehicles.errors import ParameterError
from wil_campaign.vehicles.poses.anchor import Anchor
from wil_campaign.worlds.frames import Pose


@dataclass
class FakeParameters:
    values: dict[str, float] = field(default_factory=dict)
    asked: list[str] = field(default_factory=list)

    async def get(self, name: str) -> float:
        self.asked.append(name)
        if name not in self.values:
            raise ParameterError(f"no reply for parameter {name}")
        return self.values[name]


@dataclass
class FakeState:
    local: LocalEstimate | None = None
    mode_name: str = "GUIDED"


@dataclass
class FakeDriver:
    parameters: FakeParameters = field(default_factory=FakeParameters)
    told: list[Any] = field(default_factory=list)
    anchor: Anchor | None = None
    state: FakeState = field(default_factory=FakeState)
    calls: list[str] = field(default_factory=list)

    def send_message(self, message: Any) -> None:
        self.told.append(message)

    def keep_still(self) -> None:
        self.calls.append("keep_still")

    def hand_over(self) -> None:
        self.calls.append("hand_over")

    def set_anchor(self, anchor: Anchor) -> None:
        self.anchor = anchor

    def stands_at(self, local: Pose, world: Pose) -> None:
        self.anchor = Anchor.of_poses(local=local, world=world)
        self.state.local = LocalEstimate(0.0, local, (0.0, 0.0, 0.0))


@dataclass
class FakeStation:
    """name, driver: as of a Station."""

    name: str = "real"
    driver: FakeDriver = field(default_factory=FakeDriver)
    steered_by: str | None = None


async def until(condition: Callable[[], bool], timeout_s: float = 60.0) -> None:
    """Wait until something outside of the loop has happened."""
    async with asyncio.timeout(timeout_s):
        while not condition():  # noqa: ASYNC110 - sockets set no event of ours
            await asyncio.sleep(0.01)
