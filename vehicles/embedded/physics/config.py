"""The configuration of one embedded vehicle."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, Protocol, runtime_checkable

from wil_campaign.vehicles.embedded.physics.airframe import Airframe
from wil_campaign.vehicles.embedded.profile import Profile, load_profile
from wil_campaign.vehicles.readings import Source
from wil_campaign.worlds.frames import Pose

Physics = Literal["jsbsim", "compiled"]
"""What moves an embedded vehicle: JSBSim, or our compiled rigid body."""


class ContactWorld(Protocol):
    """The physical objects around an embedded vehicle (protocol)."""

    def contact(self, pose_0: Pose, t_0: float, pose_1: Pose, t_1: float) -> str | None:
        """Return the object that the vehicle touches between two poses (world frame); or None."""


@runtime_checkable
class EventListener(ContactWorld, Protocol):
    """A contact world with moving objects, which start at events (protocol)."""

    def notify(self, event: str, t_s: float) -> None:
        """Notify the contact world of an event at t_s (run clock)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class EmbeddedConfig:
    """The config of an embedded vehicle: ids, profile, start pose, origin, parameters.

    start: position and heading in the world's local frame. heading_rad: its compass heading there,
    when the world's north is not true north; None for the same. latitude_deg, longitude_deg,
    altitude_m: of the world's origin, WGS-84 and above sea level. parameters: values that replace
    the autopilot's defaults. full_streams: send all streams of the real firmware, not only those
    that a run needs. uid, uid2: None for the SITL constants. boot_unix_us: the time of day at boot,
    for its GPS; None for a GPS without time.
    """

    autopilot: str
    physics: Physics = "jsbsim"
    profile: Profile = field(default_factory=lambda: load_profile("nominal"))
    source: Source = "real"
    system_id: int = 1
    start: Pose = field(default_factory=lambda: Pose((0.0, 0.0, 0.0)))
    heading_rad: float | None = None
    latitude_deg: float = 47.397742
    longitude_deg: float = 8.545594
    altitude_m: float = 488.0
    parameters: Mapping[str, float] = field(default_factory=dict)
    full_streams: bool = False
    uid: int | None = None
    uid2: bytes | None = None
    boot_unix_us: int | None = None
    running_s: float = 0.0
    """For how long its autopilot has been on when its link opens."""
    never_ready: bool = False
    """A fault: the autopilot's checks never pass."""
    refuse_arm: str | None = None
    """A fault: arming is refused with this reason."""

    @property
    def airframe(self) -> Airframe:
        """Return the profile's airframe; without one, the paper's drone."""
        numbers, lag_s = self.profile.airframe, self.profile.motors.lag_s
        return Airframe(**({} if numbers is None else numbers.model_dump()), motor_lag_s=lag_s)

    def __post_init__(self) -> None:
        if not 1 <= self.system_id <= 255:
            raise ValueError(f"system_id is {self.system_id}: MAVLink has 1 to 255")
