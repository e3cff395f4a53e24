"""The mutable state of an emulated autopilot, which its telemetry reports."""

from collections.abc import Callable
from dataclasses import dataclass, field

from wil_campaign.vehicles.embedded.control.target import ControlTarget
from wil_campaign.vehicles.embedded.physics.battery import BatteryCharge
from wil_campaign.vehicles.embedded.physics.states import BodyMotion, motion_of_array
from wil_campaign.vehicles.poses.truth import STOPPED, Thrusts
from wil_campaign.worlds.frames import Vec3
from wil_campaign.worlds.geodesy import LocalFrame
from wil_campaign.worlds.jit import F64


@dataclass(frozen=True, slots=True)
class EmulatedIdentity:
    """The emulated autopilot's identity: system id, board ids, estimator origin.

    uid2 has at most 18 bytes; None of either means the autopilot's own SITL constant.
    """

    system_id: int = 1
    uid: int | None = None
    uid2: bytes | None = None
    origin: LocalFrame = field(default_factory=lambda: LocalFrame(47.397742, 8.545594, 488.0))


@dataclass(slots=True)
class AutopilotState:
    """The emulated autopilot's state: clock, estimate, battery, home; updated every step."""

    frame: LocalFrame
    charge: BatteryCharge
    estimate: F64
    """The estimate's motion array (see motion_kernel): the same one at each step."""
    simulator: Callable[[], BodyMotion]
    """Returns the motion in the autopilot's simulator."""
    clock_s: float = 0.0
    clock_offset_s: float = 0.0
    """The transmitted clock minus the time since the autopilot's start."""
    unix_offset_us: int | None = None
    """The time of day minus `boot_us`; None while unknown."""
    gps_unix_offset_us: int | None = None
    """The same by GPS, once its receiver has the time; None for a receiver without time."""
    known: BodyMotion | None = None
    """The cached `now`; None from each step until it is read."""
    touching: bool = True
    home_ned_m: Vec3 | None = None
    target: ControlTarget | None = None
    thrusts: Thrusts = STOPPED
    max_thrust_n: float = 1.0
    mission_seq: int = 0
    mission_total: int = 0

    @property
    def now(self) -> BodyMotion:
        """Return the present estimate."""
        known = self.known
        if known is None:
            known = self.known = motion_of_array(self.estimate)
        return known

    @property
    def truth(self) -> BodyMotion:
        """Return the motion in the simulator, for reports only."""
        return self.simulator()

    @property
    def boot_ms(self) -> int:
        """Return the autopilot's clock in ms, as a time_boot_ms: from 0 again after 49.7 days."""
        return int((self.clock_s + self.clock_offset_s) * 1e3 + 1e-6) & 0xFFFFFFFF

    @property
    def boot_us(self) -> int:
        """Return the autopilot's clock in us."""
        return self.stamp_us(self.clock_s)

    def stamp_us(self, clock_s: float) -> int:
        """Return the transmitted timestamp of a time on the autopilot's clock, us."""
        return int((clock_s + self.clock_offset_s) * 1e6 + 1e-3)

    @property
    def home_down_m(self) -> float:
        """Return the height of home in the autopilot's state, down, local."""
        return self.home_ned_m[2] if self.home_ned_m is not None else 0.0
