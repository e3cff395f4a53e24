"""The flight of step responses with which the firmwares were measured, on an embedded vehicle.

Takes off to 2.5 m; velocity steps of 0.4, 0.8 and 1.5 m/s with stops, a position step of 2 m, a
climb at 0.5 m/s and a yaw step of 60 degrees, all as SET_POSITION_TARGET_LOCAL_NED at 25 Hz. In
virtual time, over a link in memory with 3 ms.
"""

import asyncio
import math
from collections.abc import Callable, Mapping
from typing import Any, Literal, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from orchestrator.model.clock import run_virtual
from vehicles.embedded.physics.config import EmbeddedConfig
from vehicles.embedded.profile import load_profile
from vehicles.embedded.vehicle import EmbeddedVehicle
from vehicles.links.memory import memory_pair
from vehicles.mavlink.codec import Codec

Autopilot = Literal["px4", "ardupilot"]
Triple = tuple[float, float, float]
Figures = dict[str, dict[str, float | None]]

IGNORE_VELOCITY, IGNORE_POSITION, IGNORE_ACCELERATION, IGNORE_YAW_RATE = 0x38, 0x07, 0x1C0, 0x800
POSITION = IGNORE_VELOCITY | IGNORE_ACCELERATION | IGNORE_YAW_RATE
VELOCITY = IGNORE_POSITION | IGNORE_ACCELERATION | IGNORE_YAW_RATE
SPEEDS = (0.4, 0.8, 1.5)
SETPOINT_HZ = 25
SAMPLE_US = 1e6 / 50
PROFILES: dict[Autopilot, str] = {"px4": "px4-sih", "ardupilot": "ardupilot-sitl"}


class Sample(NamedTuple):
    """The vehicle's estimate: s; NED m and m/s; rad."""

    t_s: float
    north_m: float
    east_m: float
    down_m: float
    vn_m_s: float
    ve_m_s: float
    vd_m_s: float
    roll_rad: float
    pitch_rad: float
    yaw_rad: float


Series = dict[str, list[Sample]]


class StepFlight:
    """One vehicle on a link, and what it said last."""

    def __init__(self, link: Any, autopilot: Autopilot) -> None:
        self._link = link
        self._autopilot = autopilot
        self._codec = Codec(system_id=245, component_id=190)
        self._last: dict[str, Any] = {}
        self._samples: list[Sample] = []
        self._start: Triple = (0.0, 0.0, 0.0)
        self._hover: Triple = (0.0, 0.0, -2.5)
        self._yaw_rad = 0.0
        link.receive(self._on_bytes)

    def _on_bytes(self, data: bytes, t_s: float) -> None:
        for message in self._codec.parse(data):
            kind = message.get_type()
            self._last[kind] = message
            if kind == "LOCAL_POSITION_NED" and "ATTITUDE" in self._last:
                m, a = message, self._last["ATTITUDE"]
                place = (m.time_boot_ms / 1e3, m.x, m.y, m.z, m.vx, m.vy, m.vz)
                self._samples.append(Sample(*place, a.roll, a.pitch, a.yaw))

    def _send(self, message: Any) -> None:
        self._link.write(self._codec.pack(message))

    async def _beat(self) -> None:
        while True:
            self._send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
            await asyncio.sleep(1.0)

    async def _stream(self, seconds: float, send: Callable[[], None]) -> list[Sample]:
        first = len(self._samples)
        for _ in range(round(seconds * SETPOINT_HZ)):
            send()
            await asyncio.sleep(1.0 / SETPOINT_HZ)
        return self._samples[first:]

    async def _command(self, number: int, *values: float) -> int | None:
        self._last.pop("COMMAND_ACK", None)
        rest = (0.0,) * (7 - len(values))
        self._send(mavlink.MAVLink_command_long_message(1, 1, number, 0, *values, *rest))
        await asyncio.sleep(0.05)
        ack = self._last.get("COMMAND_ACK")
        return None if ack is None else int(ack.result)

    def _setpoint(
        self,
        mask: int,
        *,
        position: Triple = (0.0, 0.0, 0.0),
        velocity: Triple = (0.0, 0.0, 0.0),
        yaw_rad: float,
    ) -> None:
        self._send(
            mavlink.MAVLink_set_position_target_local_ned_message(
                0, 1, 1, 1, mask, *position, *velocity, 0, 0, 0, yaw_rad, 0
            )
        )

    def _hold(self) -> None:
        self._setpoint(POSITION, position=self._hover, yaw_rad=self._yaw_rad)

    async def _get_ready(self) -> None:
        for number in (mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED, mavlink.MAVLINK_MSG_ID_ATTITUDE):
            await self._command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, number, SAMPLE_US)
        result = None
        while result != 0:
            await asyncio.sleep(1.0)
            if "LOCAL_POSITION_NED" not in self._last or "ATTITUDE" not in self._last:
                continue
            p = self._last["LOCAL_POSITION_NED"]
            self._start, self._yaw_rad = (p.x, p.y, p.z), self._last["ATTITUDE"].yaw
            self._hover = (p.x, p.y, p.z - 2.5)
            if self._autopilot == "px4":
                await self._stream(
                    1.0,
                    lambda: self._setpoint(POSITION, position=self._start, yaw_rad=self._yaw_rad),
                )
            await self._command(
                mavlink.MAV_CMD_DO_SET_MODE, 1, 6 if self._autopilot == "px4" else 4
            )
            result = await self._command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
        if self._autopilot == "ardupilot":
            await self._command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 2.5)
            await asyncio.sleep(12.0)
        await self._stream(4.0 if self._autopilot == "ardupilot" else 16.0, self._hold)

    async def fly(self, speeds: tuple[float, ...] = SPEEDS, turn_deg: float = 60.0) -> Series:
        """Fly it all and return the samples of each segment."""
        beating = asyncio.create_task(self._beat())
        try:
            await self._get_ready()
            return await self._steps(speeds, turn_deg)
        finally:
            beating.cancel()

    async def _steps(self, speeds: tuple[float, ...], turn_deg: float) -> Series:
        yaw_rad = self._yaw_rad
        north, east = math.cos(yaw_rad), math.sin(yaw_rad)
        flown: Series = {}

        def moving(speed: float, up: float = 0.0) -> Callable[[], None]:
            velocity = (speed * north, speed * east, -up)
            return lambda: self._setpoint(VELOCITY, velocity=velocity, yaw_rad=yaw_rad)

        def turned(turn_rad: float) -> Callable[[], None]:
            return lambda: self._setpoint(
                POSITION, position=self._hover, yaw_rad=yaw_rad + turn_rad
            )

        for speed in speeds:
            flown[f"speed {speed}"] = await self._stream(6.0, moving(speed))
            flown[f"stop {speed}"] = await self._stream(4.0, moving(0.0))
            flown[f"back {speed}"] = await self._stream(8.0, self._hold)
        x, y, z = self._hover
        there = (x + 2.0 * north, y + 2.0 * east, z)
        flown["position 2"] = await self._stream(
            8.0, lambda: self._setpoint(POSITION, position=there, yaw_rad=yaw_rad)
        )
        flown["position back"] = await self._stream(8.0, self._hold)
        flown["climb 0.5"] = await self._stream(4.0, moving(0.0, 0.5))
        flown["hover"] = await self._stream(6.0, self._hold)
        flown["yaw 60"] = await self._stream(8.0, turned(math.radians(turn_deg)))
        flown["yaw back"] = await self._stream(6.0, self._hold)
        await self._command(mavlink.MAV_CMD_NAV_LAND)
        first = len(self._samples)
        await asyncio.sleep(15.0)
        flown["land"] = self._samples[first:]
        return flown


def fly_steps(
    autopilot: Autopilot,
    profile: str | None = None,
    *,
    seed: int = 1,
    parameters: Mapping[str, float] | None = None,
) -> Series:
    """Return the series of the flight of an embedded vehicle, in virtual time."""

    async def scenario() -> Series:
        near, far = memory_pair(latency_s=0.003)
        config = EmbeddedConfig(
            autopilot=autopilot,
            profile=load_profile(profile or PROFILES[autopilot]),
            parameters=parameters or {},
        )
        flight = StepFlight(far, autopilot)
        async with far, EmbeddedVehicle(config=config, link=near, seed=seed):
            return await flight.fly()

    return run_virtual(scenario())


def figures_of(flown: Series, speeds: tuple[float, ...] = SPEEDS) -> Figures:
    """Return the figures of a flight, by segment and name."""
    yaw_rad = flown[f"speed {speeds[0]}"][0].yaw_rad
    north, east = math.cos(yaw_rad), math.sin(yaw_rad)
    figures: Figures = {}
    for v in speeds:
        samples = flown[f"speed {v}"]
        speed = [(q.t_s - samples[0].t_s, q.vn_m_s * north + q.ve_m_s * east) for q in samples]
        late = [x for t, x in speed if t > 4]
        steady = sum(late) / len(late)
        figures[f"speed {v}"] = {
            "steady_m_s": round(steady, 3),
            "peak_m_s": round(max(x for _, x in speed), 3),
            "t63_s": _first_s(speed, 0.63 * steady),
            "t90_s": _first_s(speed, 0.9 * steady),
        }
        way = _way(flown[f"stop {v}"], north, east)
        figures[f"stop {v}"] = {"distance_m": round(max(x for _, x in way), 3)}
    samples = flown["position 2"]
    way = _way(samples, north, east)
    figures["position 2"] = {
        "t90_s": _first_s(way, 1.8),
        "overshoot_m": round(max(x for _, x in way) - way[-1][1], 3),
        "peak_m_s": round(max(q.vn_m_s * north + q.ve_m_s * east for q in samples), 3),
    }
    samples = flown["climb 0.5"]
    rise = [(q.t_s - samples[0].t_s, -q.vd_m_s) for q in samples]
    late = [x for t, x in rise if t > 2]
    figures["climb 0.5"] = {
        "steady_m_s": round(sum(late) / len(late), 3),
        "t63_s": _first_s(rise, 0.315),
    }
    samples = flown["yaw 60"]
    turn = [
        (q.t_s - samples[0].t_s, math.degrees(math.remainder(q.yaw_rad - yaw_rad, math.tau)))
        for q in samples
    ]
    figures["yaw 60"] = {
        "t90_s": _first_s(turn, 54.0),
        "overshoot_deg": round(max(x for _, x in turn) - 60, 1),
    }
    return figures


def _way(samples: list[Sample], north: float, east: float) -> list[tuple[float, float]]:
    """Return (s, m) along the heading from the segment's first sample."""
    t, x, y = samples[0][:3]
    return [(q.t_s - t, (q.north_m - x) * north + (q.east_m - y) * east) for q in samples]


def _first_s(points: list[tuple[float, float]], level: float) -> float | None:
    return next((round(t, 2) for t, x in points if x >= level), None)
