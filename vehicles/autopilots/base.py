"""What every autopilot strategy offers; pure: MAVLink messages in and out, no sockets, no clock."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from enum import Enum
from typing import Any, ClassVar, Literal

from worlds.frames import Vec3

AutopilotName = Literal["px4", "ardupilot"]


class Mode(Enum):
    """What a flight mode means to us, whatever the autopilot calls it."""

    HOLD = "hold"
    TAKEOFF = "takeoff"
    GUIDED = "guided"
    """Follows setpoints over MAVLink: OFFBOARD on PX4, GUIDED on ArduCopter."""
    LAND = "land"
    RTL = "rtl"
    MISSION = "mission"
    PILOT = "pilot"
    """A mode that a pilot flies by sticks."""
    OTHER = "other"


@dataclass(frozen=True, slots=True)
class Target:
    """Whom a message is for: MAVLink system and component id."""

    system: int
    component: int = 1


class Autopilot(ABC):
    """Builds the messages that make one kind of autopilot do a thing, and reads its answers.

    Messages are pymavlink objects (dialect ardupilotmega, v2), not yet packed. Positions and
    velocities are in the autopilot's own local NED frame.
    """

    name: ClassVar[AutopilotName]
    mav_autopilot: ClassVar[int]
    """MAV_AUTOPILOT of its heartbeat."""
    setpoint_rate_hz: ClassVar[float]
    """At least how often it wants setpoints to stay in its guided mode."""

    @abstractmethod
    def mode_of(self, custom_mode: int) -> Mode:
        """Return what the mode of a HEARTBEAT means."""

    @abstractmethod
    def mode_name(self, custom_mode: int) -> str:
        """Return the autopilot's own word for the mode ("OFFBOARD", "BRAKE")."""

    @abstractmethod
    def set_mode(self, target: Target, mode: Mode) -> Any:
        """Return the COMMAND_LONG (MAV_CMD_DO_SET_MODE) that asks for HOLD, GUIDED, LAND or RTL."""

    @abstractmethod
    def velocity_setpoint(
        self,
        target: Target,
        *,
        t_boot_ms: int,
        velocity_ned_m_s: Vec3,
        yaw_rad: float | None = None,
        yaw_rate_rad_s: float | None = None,
    ) -> Any:
        """Return a SET_POSITION_TARGET_LOCAL_NED that asks for a velocity."""

    @abstractmethod
    def position_setpoint(
        self, target: Target, *, t_boot_ms: int, position_ned_m: Vec3, yaw_rad: float | None = None
    ) -> Any:
        """Return a SET_POSITION_TARGET_LOCAL_NED that asks for a position."""
