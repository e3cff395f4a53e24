"""A rig: one embedded vehicle in virtual time, and a small ground station at its link."""

import asyncio
import math
from collections.abc import Awaitable, Callable
from contextlib import AsyncExitStack
from typing import Any, Self

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.vehicles.embedded.physics.config import ContactWorld, EmbeddedConfig
from wil_campaign.vehicles.embedded.vehicle import EmbeddedVehicle
from wil_campaign.vehicles.links.memory import memory_pair
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec

NAN = math.nan
PX4_READY_S, COPTER_READY_S = 6.6, 41.6
TAKEOFF, LAND, RTL, ARM, MODE = 22, 21, 20, 400, 176


class Rig:
    """The vehicle, what it said, and how to talk to it."""

    def __init__(
        self,
        *,
        seed: int = 1,
        contact_world: ContactWorld | None = None,
        heartbeats: bool = True,
        **config: Any,
    ) -> None:
        near, self.link = memory_pair(latency_s=0.003)
        self.config = EmbeddedConfig(**config)
        self.vehicle = EmbeddedVehicle(
            config=self.config, link=near, seed=seed, contact_world=contact_world
        )
        self.codec = MavlinkCodec(system_id=255, component_id=190)
        self.heard: list[tuple[float, Any]] = []
        self.last: dict[str, Any] = {}
        self.raw = bytearray()
        self._heartbeats = heartbeats
        self._stack = AsyncExitStack()
        self.link.receive(self._on_bytes)

    async def __aenter__(self) -> Self:
        await self._stack.enter_async_context(self.link)
        await self._stack.enter_async_context(self.vehicle)
        self._beating = asyncio.create_task(self._beat())
        return self

    async def __aexit__(self, *error: object) -> None:
        self._beating.cancel()
        await self._stack.aclose()

    async def _beat(self) -> None:
        while True:
            if self._heartbeats:
                self.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
            await asyncio.sleep(0.5)

    def silence(self) -> None:
        self._heartbeats = False

    def _on_bytes(self, data: bytes, t_s: float) -> None:
        self.raw += data
        for message in self.codec.parse(data):
            self.heard.append((t_s, message))
            self.last[message.get_type()] = message

    def send(self, message: Any) -> None:
        self.link.write(self.codec.pack(message))

    async def command(self, number: int, *params: float) -> int:
        """Send a COMMAND_LONG and return the result of its acknowledgement."""
        values = [*params, *(0.0,) * (7 - len(params))]
        self.send(mavlink.MAVLink_command_long_message(1, 1, number, 0, *values))
        return await self._result(number)

    async def command_int(
        self, number: int, *, frame: int, params: tuple[float, ...], place: tuple[int, int, float]
    ) -> int:
        self.send(mavlink.MAVLink_command_int_message(1, 1, frame, number, 0, 0, *params, *place))
        return await self._result(number)

    async def _result(self, number: int) -> int:
        since = len(self.heard)
        await asyncio.sleep(0.03)
        acks = [
            m
            for _, m in self.heard[since:]
            if m.get_type() == "COMMAND_ACK" and m.command == number
        ]
        assert len(acks) == 1, f"{len(acks)} acknowledgements of {number}"
        return int(acks[0].result)

    async def until(self, ready: Callable[[], bool], *, limit_s: float = 90.0) -> float:
        """Wait for something in steps of 20 ms; return the time that it took."""
        loop = asyncio.get_running_loop()
        began_s = loop.time()
        while not ready():
            assert loop.time() - began_s < limit_s, f"not within {limit_s} s: {self.texts()[-5:]}"
            await asyncio.sleep(0.02)
        return loop.time() - began_s

    def of(self, kind: str) -> list[Any]:
        return [m for _, m in self.heard if m.get_type() == kind]

    def texts(self) -> list[str]:
        """Return what was said, the chunks of long texts joined."""
        whole: list[str] = []
        for message in self.of("STATUSTEXT"):
            if message.chunk_seq:
                whole[-1] += message.text
            else:
                whole.append(message.text)
        return [text.rstrip("\t") for text in whole]

    @property
    def custom_mode(self) -> int:
        return int(self.last["HEARTBEAT"].custom_mode)

    @property
    def status(self) -> int:
        return int(self.last["HEARTBEAT"].system_status)

    @property
    def armed(self) -> bool:
        return self.vehicle.autopilot.flight.armed

    @property
    def height_m(self) -> float:
        return -self.vehicle.truth().pose.position_ned_m[2]

    @property
    def speed_m_s(self) -> float:
        return math.hypot(*self.vehicle.truth().velocity_ned_m_s[:2])

    def setpoint(
        self,
        *,
        mask: int,
        frame: int = 1,
        position: tuple[float, float, float] = (0.0, 0.0, 0.0),
        velocity: tuple[float, float, float] = (0.0, 0.0, 0.0),
        yaw: float = 0.0,
        yaw_rate: float = 0.0,
    ) -> None:
        self.send(
            mavlink.MAVLink_set_position_target_local_ned_message(
                0, 1, 1, frame, mask, *position, *velocity, 0, 0, 0, yaw, yaw_rate
            )
        )

    async def stream(self, seconds: float, **setpoint: Any) -> None:
        for _ in range(round(seconds * 20)):
            self.setpoint(**setpoint)
            await asyncio.sleep(0.05)

    async def hover(self, height_m: float = 3.0) -> None:
        """Become ready, arm, take off and wait for the height."""
        if self.config.autopilot == "px4":
            await asyncio.sleep(PX4_READY_S)
            assert await self.command(ARM, 1) == 0
            altitude_m = self.config.altitude_m + height_m
            assert await self.command(TAKEOFF, NAN, NAN, NAN, NAN, NAN, NAN, altitude_m) == 0
        else:
            await asyncio.sleep(COPTER_READY_S)
            assert await self.command(MODE, 1, 4) == 0
            assert await self.command(ARM, 1) == 0
            assert await self.command(TAKEOFF, 0, 0, 0, 0, 0, 0, height_m) == 0
        await self.until(lambda: self.height_m > height_m - 0.3, limit_s=20.0)
        await asyncio.sleep(2.0)


@pytest.fixture
def rig() -> type[Rig]:
    return Rig


@pytest.fixture
def virtually() -> Callable[[Awaitable[Any]], Any]:
    """Runs a scenario to its end in virtual time."""
    return run_virtual  # type: ignore[return-value]  # any coroutine
