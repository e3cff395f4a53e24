"""A vehicle small enough to be understood, at the other end of the guard's wires."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.safety.guard.guard_rigs import make_pair
from tests.vehicles.px4_modes import px4_custom_mode
from wil_campaign.safety.guard.core.events import GuardEvent, Output, ToOrchestrator, ToVehicle
from wil_campaign.safety.guard.core.guard_core import GuardCore
from wil_campaign.safety.model.samples import PoseSample
from wil_campaign.vehicles.autopilots.autopilot import Autopilot, FlightMode, MavlinkTarget
from wil_campaign.vehicles.autopilots.px4 import Px4
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec
from wil_campaign.worlds.frames import Pose

STEP_S = 0.05


@dataclass
class FakeVehicle:
    """Obeys mode commands at once, sinks in LAND, disarms a second after its touchdown.

    deaf: hears nothing. mute: says nothing. ignores: modes that it does not take. stuck: does not
    sink. heard: all that reached it, as (time, word).
    """

    name: str
    autopilot: Autopilot = field(default_factory=Px4)
    system: int = 1
    armed: bool = True
    mode: FlightMode = FlightMode.GUIDED
    pilot_mode: bool = False
    up_m: float = 2.0
    north_m: float = 0.0
    north_m_s: float = 0.0
    critical: bool = False
    deaf: bool = False
    mute: bool = False
    ignores: frozenset[FlightMode] = frozenset()
    stuck: bool = False
    disarms: bool = True
    tells_landed: bool = True
    heard: list[tuple[float, str]] = field(default_factory=list)
    landed_s: float | None = None
    setpoints: int = 0

    def __post_init__(self) -> None:
        self.codec = MavlinkCodec(system_id=self.system, component_id=1)
        self._last_mode: FlightMode | None = None
        self._beat_s = -9.0

    @property
    def target(self) -> MavlinkTarget:
        return MavlinkTarget(self.system)

    def words(self) -> list[str]:
        return [word for _, word in self.heard]

    def receive(self, frames: tuple[bytes, ...], t_s: float) -> None:
        if self.deaf:
            return
        for message in (m for frame in frames for m in self.codec.parse(frame)):
            self._take(message, t_s)

    def _take(self, message: Any, t_s: float) -> None:
        kind = message.get_type()
        if getattr(message, "target_system", 0) not in {0, self.system}:
            return
        if kind != "COMMAND_LONG":
            velocity = getattr(message, "vx", None), getattr(message, "vy", None)
            self.heard.append((t_s, "ZERO" if velocity == (0.0, 0.0) else kind))
            return
        if message.command == mavlink.MAV_CMD_DO_SET_MODE:
            asked = self._requested_mode(message)
            self.heard.append((t_s, asked.name))
            if asked not in self.ignores:
                self.mode = asked
        elif message.command == mavlink.MAV_CMD_COMPONENT_ARM_DISARM:
            arms = message.param1 == 1.0
            self.heard.append((t_s, "ARM" if arms else "DISARM"))
            if arms or self.up_m <= 0.0:
                self.armed = arms
        elif message.command == mavlink.MAV_CMD_DO_FLIGHTTERMINATION:
            self.heard.append((t_s, "TERMINATE"))
            self.armed = False

    def _requested_mode(self, message: Any) -> FlightMode:
        custom = int(message.param2)
        if isinstance(self.autopilot, Px4):
            custom = px4_custom_mode(int(message.param2), int(message.param3))
        return self.autopilot.mode_of(custom)

    def step(self, t_s: float) -> None:
        self.north_m += self.north_m_s * STEP_S
        if self.mode in {FlightMode.HOLD, FlightMode.LAND}:
            self.north_m_s = 0.0
        if self.mode is FlightMode.LAND and self.armed and not self.stuck:
            self.up_m = max(0.0, self.up_m - 0.5 * STEP_S)
        if self.up_m > 0.0:
            self.landed_s = None
        elif self.landed_s is None:
            self.landed_s = t_s
        if self.disarms and self.mode is FlightMode.LAND and self.landed_s is not None:
            self.armed = self.armed and t_s - self.landed_s < 1.0

    def frames(self, t_s: float) -> bytes:
        if self.mute:
            return b""
        data = b""
        if t_s - self._beat_s >= 1.0 - 1e-9 or self.mode is not self._last_mode:
            self._beat_s, self._last_mode = t_s, self.mode
            data += self.heartbeat()
        if self.tells_landed:
            landed = 1 if self.up_m <= 0.0 else 2
            data += self.codec.pack(mavlink.MAVLink_extended_sys_state_message(0, landed))
        return data

    def heartbeat(self) -> bytes:
        base_mode = 1 | (128 if self.armed else 0)
        status = 5 if self.critical else (4 if self.armed else 3)
        return self.codec.pack(
            mavlink.MAVLink_heartbeat_message(
                2, self.autopilot.mav_autopilot, base_mode, self._custom_mode(), status, 3
            )
        )

    def _custom_mode(self) -> int:
        if isinstance(self.autopilot, Px4):
            modes = {
                FlightMode.PILOT: (3, 0),
                FlightMode.HOLD: (4, 3),
                FlightMode.TAKEOFF: (4, 2),
                FlightMode.GUIDED: (6, 0),
                FlightMode.LAND: (4, 6),
                FlightMode.RTL: (4, 5),
                FlightMode.MISSION: (4, 4),
            }
            return px4_custom_mode(*modes[self.mode])
        numbers = {
            FlightMode.PILOT: 0,
            FlightMode.HOLD: 17,
            FlightMode.GUIDED: 4,
            FlightMode.LAND: 9,
            FlightMode.RTL: 6,
        }
        return numbers[self.mode]

    def sample(self, t_s: float) -> PoseSample:
        falls_m_s = (
            0.5 if self.mode is FlightMode.LAND and not self.stuck and self.up_m > 0 else 0.0
        )
        place = Pose((self.north_m, 0.0, -self.up_m))
        return PoseSample(t_s, self.name, place, (self.north_m_s, 0.0, falls_m_s))


@dataclass
class Rig:
    """A guard core with its fake vehicles, stepped at 20 Hz."""

    core: GuardCore
    vehicles: dict[str, FakeVehicle]
    t_s: float = 0.0
    blind: tuple[str, ...] = ()
    """Vehicles of which no positions come."""
    events: list[GuardEvent] = field(default_factory=list)
    to_orchestrator: int = 0

    def apply(self, outputs: tuple[Output, ...]) -> None:
        for output in outputs:
            if isinstance(output, ToVehicle):
                self.vehicles[output.name].receive(output.frames, self.t_s)
            elif isinstance(output, ToOrchestrator):
                self.to_orchestrator += len(output.frames)
            elif isinstance(output, GuardEvent):
                self.events.append(output)

    def fly(self, seconds: float, *, each: Callable[[], None] | None = None) -> None:
        for _ in range(round(seconds / STEP_S)):
            self.t_s = round(self.t_s + STEP_S, 6)
            for name, vehicle in self.vehicles.items():
                vehicle.step(self.t_s)
                self.apply(self.core.from_vehicle(name, vehicle.frames(self.t_s), self.t_s))
                if name not in self.blind:
                    self.apply(self.core.position(vehicle.sample(self.t_s)))
            if each is not None:
                each()
            self.apply(self.core.tick(self.t_s))

    def kinds(self) -> list[str]:
        return [event.kind for event in self.events if event.kind != "action"]


@pytest.fixture
def fake_vehicle() -> type[FakeVehicle]:
    return FakeVehicle


@pytest.fixture
def rig() -> type[Rig]:
    return Rig


@pytest.fixture
def pair(fake_vehicle: Any, rig: Any) -> Any:
    """Return a rig of a PX4 as real and an ArduCopter as twin, both flying in GUIDED."""
    return make_pair(fake_vehicle, rig)
