"""Limits setpoints on their way to a vehicle; pure, world frame.

A velocity is limited so that the vehicle can still stop before a boundary: it continues for the
latency, then brakes at a constant rate, v t + v^2 / (2 a), as in the prediction of the fence. A
position is moved towards the vehicle until the path to it is inside, and no longer than the speed
limit covers in a second: both autopilots control position with a gain of about 1/s (MPC_XY_P 0.95,
PSC_POSXY_P 1).
"""

import math
from dataclasses import dataclass

from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.safety.fence.stopping import VehicleMotion
from wil_campaign.safety.guard.core.setpoint_limits import SetpointLimits
from wil_campaign.vehicles.setpoints import PositionSetpoint, Setpoint, VelocitySetpoint
from wil_campaign.worlds.frames import Vec3, add, norm, scale, subtract

_CARROT_S = 1.0
_LONGEST_STEP_S = 0.5
"""Setpoints further apart are no steps of one motion: the vehicle's own velocity is compared."""
_STEP_M = 0.02
_MOST_STEPS = 500
"""Of the check of a path to a position; it is cut there, 10 m ahead at least. The next setpoint is
checked from where the vehicle is then."""
_HALVINGS = 8
_TOLERANCE_M = 1e-3
_TOLERANCE_M_S = 1e-3


@dataclass(frozen=True, slots=True)
class LimitReport:
    """A report of a setpoint limit that took effect. asked, given: in `unit`."""

    what: str
    asked: float
    given: float
    unit: str


class SetpointLimiter:
    """Limits the setpoints of one vehicle.

    latency_s, braking_m_s2: how late and how hard a vehicle brakes that is slowed down by its
    setpoints; both on the safe side of the values of the fence's prediction.
    """

    def __init__(
        self,
        *,
        limits: SetpointLimits,
        fence: Fence | None,
        latency_s: float,
        braking_m_s2: float,
    ) -> None:
        self.limits = limits
        self._fence = fence if limits.inside_fence else None
        self._latency_s = latency_s
        self._braking_m_s2 = braking_m_s2
        self._last_setpoint: tuple[float, Vec3] | None = None

    def change_fence(self, fence: Fence) -> None:
        """Change the fence inside which setpoints are kept, if limited."""
        self._fence = fence if self.limits.inside_fence else None

    def limit(
        self, asked: Setpoint, motion: VehicleMotion | None, t_s: float
    ) -> tuple[Setpoint | None, tuple[LimitReport, ...]]:
        """Return the limited setpoint (None: nothing), and which limits took effect.

        motion: None if unknown; then no setpoint is allowed whose limit depends on the position.
        """
        if isinstance(asked, PositionSetpoint):
            return self._limit_position(asked, motion)
        return self._limit_velocity(asked, motion, t_s)

    def _limit_velocity(
        self, asked: VelocitySetpoint, motion: VehicleMotion | None, t_s: float
    ) -> tuple[Setpoint | None, tuple[LimitReport, ...]]:
        found: list[LimitReport] = []
        velocity = self._within_speed(asked.velocity_ned_m_s, found)
        velocity = self._within_acceleration(velocity, motion, t_s, found)
        velocity = self._within_heights(velocity, motion, found)
        velocity = self._within_fence(velocity, motion, found)
        self._last_setpoint = (t_s, velocity)
        if not found:
            return asked, ()
        return VelocitySetpoint(velocity, asked.yaw_rad, asked.yaw_rate_rad_s), tuple(found)

    def _within_speed(self, velocity: Vec3, found: list[LimitReport]) -> Vec3:
        limit, speed = self.limits.speed_m_s, norm(velocity)
        if limit is None or speed <= limit + _TOLERANCE_M_S:
            return velocity
        found.append(LimitReport("speed", speed, limit, "m/s"))
        return scale(velocity, limit / speed)

    def _within_acceleration(
        self, velocity: Vec3, motion: VehicleMotion | None, t_s: float, found: list[LimitReport]
    ) -> Vec3:
        limit = self.limits.acceleration_m_s2
        if limit is None:
            return velocity
        before_s, before = self._last_setpoint or (-math.inf, (0.0, 0.0, 0.0))
        elapsed_s = t_s - before_s
        if elapsed_s > _LONGEST_STEP_S:
            elapsed_s = _LONGEST_STEP_S
            before = (0.0, 0.0, 0.0) if motion is None else motion.velocity_ned_m_s
        change = subtract(velocity, before)
        size, most = norm(change), limit * max(0.0, elapsed_s)
        if size <= most + _TOLERANCE_M_S:
            return velocity
        asked = size / elapsed_s if elapsed_s > 0.0 else math.inf
        found.append(LimitReport("acceleration", asked, limit, "m/s^2"))
        return add(before, scale(change, most / size))

    def _within_heights(
        self, velocity: Vec3, motion: VehicleMotion | None, found: list[LimitReport]
    ) -> Vec3:
        floor, ceiling = self.limits.floor_up_m, self.limits.ceiling_up_m
        climb = -velocity[2]
        low, high = -math.inf, math.inf
        if motion is not None:
            up_m = -motion.position_ned_m[2]
            if ceiling is not None:
                high = self._stopping_speed(ceiling - self.limits.keep_m - up_m)
            if floor is not None:
                low = -self._stopping_speed(up_m - floor - self.limits.keep_m)
        else:
            high = math.inf if ceiling is None else 0.0
            low = -math.inf if floor is None else 0.0
        given = max(low, min(high, climb))
        if abs(given - climb) <= _TOLERANCE_M_S:
            return velocity
        found.append(LimitReport("climb", climb, given, "m/s"))
        return (velocity[0], velocity[1], -given)

    def _stopping_speed(self, room_m: float) -> float:
        """Return the speed from which a vehicle stops within `room_m`; 0 without."""
        if room_m <= 0.0:
            return 0.0
        late = self._braking_m_s2 * self._latency_s
        return math.sqrt(late * late + 2.0 * self._braking_m_s2 * room_m) - late

    def _within_fence(
        self, velocity: Vec3, motion: VehicleMotion | None, found: list[LimitReport]
    ) -> Vec3:
        fence, speed = self._fence, norm(velocity)
        if fence is None or speed <= _TOLERANCE_M_S:
            return velocity
        if motion is None:
            found.append(LimitReport("speed at an unknown position", speed, 0.0, "m/s"))
            return (0.0, 0.0, 0.0)
        part = self._part_inside(fence, motion.position_ned_m, velocity)
        if part >= 1.0:
            return velocity
        found.append(LimitReport("speed towards the fence", speed, speed * part, "m/s"))
        return scale(velocity, part)

    def _part_inside(self, fence: Fence, place: Vec3, velocity: Vec3) -> float:
        def leaves(part: float) -> bool:
            asked = scale(velocity, part)
            return (
                fence.breached(
                    VehicleMotion(place, asked),
                    latency_s=self._latency_s,
                    braking_m_s2=self._braking_m_s2,
                    keep_m=self.limits.keep_m,
                )
                is not None
            )

        if not leaves(1.0):
            return 1.0
        if leaves(0.0):
            # Too close already: only the direction back is allowed.
            ahead = add(place, scale(velocity, _STEP_M / norm(velocity)))
            return 1.0 if fence.margin_m(ahead) > fence.margin_m(place) else 0.0
        low, high = 0.0, 1.0
        for _ in range(_HALVINGS):
            middle = (low + high) / 2.0
            low, high = (low, middle) if leaves(middle) else (middle, high)
        return low

    def _limit_position(
        self, asked: PositionSetpoint, motion: VehicleMotion | None
    ) -> tuple[Setpoint | None, tuple[LimitReport, ...]]:
        found: list[LimitReport] = []
        target = self._at_height(asked.position_ned_m, found)
        if motion is None:
            if self._fence is not None or self.limits.speed_m_s is not None:
                return None, (
                    LimitReport("a position setpoint at an unknown position", 1.0, 0.0, ""),
                )
        else:
            target = self._way_inside(motion.position_ned_m, target, found)
            target = self._carrot(motion.position_ned_m, target, found)
        if not found:
            return asked, ()
        return PositionSetpoint(target, asked.yaw_rad), tuple(found)

    def _at_height(self, target: Vec3, found: list[LimitReport]) -> Vec3:
        floor, ceiling = self.limits.floor_up_m, self.limits.ceiling_up_m
        up_m = given_m = -target[2]
        if ceiling is not None:
            given_m = min(given_m, ceiling - self.limits.keep_m)
        if floor is not None:
            given_m = max(given_m, floor + self.limits.keep_m)
        if given_m == up_m:
            return target
        found.append(LimitReport("height", up_m, given_m, "m"))
        return (target[0], target[1], -given_m)

    def _way_inside(self, place: Vec3, target: Vec3, found: list[LimitReport]) -> Vec3:
        """Return the last point of the path to a setpoint that is `keep_m` inside."""
        way = subtract(target, place)
        length_m = norm(way)
        if self._fence is None or length_m == 0.0:
            return target
        gone_m, leads_out = _inside_m(self._fence, place, way, self.limits.keep_m)
        if gone_m >= length_m:
            return target
        what = "path towards the fence" if leads_out else "distance ahead"
        found.append(LimitReport(what, length_m, gone_m, "m"))
        return add(place, scale(way, gone_m / length_m))

    def _carrot(self, place: Vec3, target: Vec3, found: list[LimitReport]) -> Vec3:
        limit = self.limits.speed_m_s
        way = subtract(target, place)
        length_m = norm(way)
        if limit is None or length_m <= limit * _CARROT_S:
            return target
        found.append(LimitReport("distance ahead", length_m, limit * _CARROT_S, "m"))
        return add(place, scale(way, limit * _CARROT_S / length_m))


def _inside_m(fence: Fence, place: Vec3, way: Vec3, keep_m: float) -> tuple[float, bool]:
    """Return up to which length a path to a setpoint stays `keep_m` inside, and if it leads out.

    From a position that is too close already, the path counts as inside while it leads back.
    """
    length_m = norm(way)
    margin_m = fence.margin_m(place)
    needed_m = min(keep_m, margin_m)
    gone_m = 0.0
    for _ in range(_MOST_STEPS):
        if gone_m >= length_m:
            return length_m, False
        step_m = max(margin_m - keep_m, _STEP_M)
        ahead_m = min(gone_m + step_m, length_m)
        margin_m = fence.margin_m(add(place, scale(way, ahead_m / length_m)))
        if margin_m < needed_m - _TOLERANCE_M:
            return gone_m, True
        needed_m = max(needed_m, min(keep_m, margin_m))
        gone_m = ahead_m
    return gone_m, False
