"""The anchor of an autopilot's local frame in the world: a shift and a turn; pure.

LOCAL_POSITION_NED is relative to the estimator's origin, which is the vehicle's place when the
estimator started, and not to home. Both frames are NED, so they differ by a shift and a turn
about the vertical (the turn is the error of the vehicle's heading against the world's north).
"""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field

from wil_campaign.vehicles.errors import AnchorError
from wil_campaign.vehicles.setpoints import PositionSetpoint, Setpoint, VelocitySetpoint
from wil_campaign.worlds.frames import Pose, Quat, Vec3, quat_multiply, wrap_pi


@dataclass(frozen=True, slots=True)
class Anchor:
    """The anchor of the autopilot's local frame in the world's: shift and turn.

    origin_ned_m: where in the world the estimator's origin is. turn_rad: heading in the world
    minus heading by the autopilot.
    """

    origin_ned_m: Vec3
    turn_rad: float = 0.0
    _cosine: float = field(init=False, repr=False, compare=False)
    _sine: float = field(init=False, repr=False, compare=False)
    _turn_wxyz: Quat = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Precompute the anchor's sine and cosine."""
        object.__setattr__(self, "_cosine", math.cos(self.turn_rad))
        object.__setattr__(self, "_sine", math.sin(self.turn_rad))
        half_rad = self.turn_rad / 2.0
        turn_wxyz = (math.cos(half_rad), 0.0, 0.0, math.sin(half_rad))
        object.__setattr__(self, "_turn_wxyz", turn_wxyz)

    @classmethod
    def of_poses(cls, *, local: Pose, world: Pose) -> "Anchor":
        """Return the anchor that maps an autopilot's pose onto the same pose in the world.

        Roll and pitch are not compared: both frames are level.
        """
        turn_rad = wrap_pi(world.yaw_rad - local.yaw_rad)
        turned = _turn(local.position_ned_m, turn_rad)
        north, east, down = world.position_ned_m
        return cls((north - turned[0], east - turned[1], down - turned[2]), turn_rad)

    def pose(self, local: Pose) -> Pose:
        """Return an autopilot's pose in the world frame, by the anchor."""
        return Pose(self.position(local.position_ned_m), self.attitude(local.q_wxyz))

    def position(self, local_ned_m: Vec3) -> Vec3:
        """Return an autopilot's position in the world frame, by the anchor."""
        north, east, down = local_ned_m
        cosine, sine, origin = self._cosine, self._sine, self.origin_ned_m
        return (
            cosine * north - sine * east + origin[0],
            sine * north + cosine * east + origin[1],
            down + origin[2],
        )

    def velocity(self, local_ned_m_s: Vec3) -> Vec3:
        """Return an autopilot's velocity in the world frame, by the anchor."""
        north, east, down = local_ned_m_s
        cosine, sine = self._cosine, self._sine
        return (cosine * north - sine * east, sine * north + cosine * east, down)

    def attitude(self, local_q_wxyz: Quat) -> Quat:
        """Return an autopilot's attitude in the world frame, by the anchor."""
        if not self.turn_rad:
            return local_q_wxyz
        return quat_multiply(self._turn_wxyz, local_q_wxyz)

    def to_local(self, setpoint: Setpoint) -> Setpoint:
        """Return a world setpoint in the anchored autopilot's frame."""
        yaw_rad = None if setpoint.yaw_rad is None else wrap_pi(setpoint.yaw_rad - self.turn_rad)
        if isinstance(setpoint, PositionSetpoint):
            return PositionSetpoint(self.position_to_local(setpoint.position_ned_m), yaw_rad)
        velocity = self.velocity_to_local(setpoint.velocity_ned_m_s)
        return VelocitySetpoint(velocity, yaw_rad, setpoint.yaw_rate_rad_s)

    def velocity_to_local(self, world_ned_m_s: Vec3) -> Vec3:
        """Return a world velocity in the anchored autopilot's frame."""
        return _turn(world_ned_m_s, -self.turn_rad)

    def position_to_local(self, world_ned_m: Vec3) -> Vec3:
        """Return a world position in the anchored autopilot's frame."""
        origin = self.origin_ned_m
        shifted = (
            world_ned_m[0] - origin[0],
            world_ned_m[1] - origin[1],
            world_ned_m[2] - origin[2],
        )
        return _turn(shifted, -self.turn_rad)


class PoseAverage:
    """The average local pose of a standing vehicle over the last `span_s`, to anchor it."""

    def __init__(
        self, *, span_s: float = 1.0, least_samples: int = 5, still_within_m: float = 0.5
    ) -> None:
        self._span_s = span_s
        self._least_samples = least_samples
        self._still_within_m = still_within_m
        self._samples: deque[tuple[float, Pose]] = deque()

    def add(self, t_s: float, local: Pose) -> None:
        """Add a pose to the average; a time that goes back restarts it."""
        if self._samples and t_s < self._samples[-1][0]:
            self._samples.clear()
        self._samples.append((t_s, local))
        while t_s - self._samples[0][0] > self._span_s:
            self._samples.popleft()

    @property
    def rate_hz(self) -> float:
        """Return the rate of averaged poses; 0 with too few of them."""
        if len(self._samples) < self._least_samples:
            return 0.0
        span_s = self._samples[-1][0] - self._samples[0][0]
        return (len(self._samples) - 1) / span_s if span_s > 0 else 0.0

    def mean(self) -> Pose:
        """Return the mean position and heading for an anchor, level.

        Raises AnchorError when there are too few samples, they are not numbers, or the vehicle
        moves.
        """
        poses = [pose for _, pose in self._samples]
        if len(poses) < self._least_samples:
            raise AnchorError(
                f"only {len(poses)} position estimates within {self._span_s:g} s, "
                f"{self._least_samples} are needed to determine its position"
            )
        positions = [pose.position_ned_m for pose in poses]
        if not all(math.isfinite(value) for position in positions for value in position):
            raise AnchorError("the position estimate is not finite; restart the estimator")
        self._check_still(positions)
        count = len(poses)
        mean = [math.fsum(position[axis] for position in positions) / count for axis in range(3)]
        yaws = [pose.yaw_rad for pose in poses]
        yaw_rad = math.atan2(
            math.fsum(math.sin(yaw) for yaw in yaws), math.fsum(math.cos(yaw) for yaw in yaws)
        )
        return Pose.of(mean[0], mean[1], -mean[2], yaw_rad=yaw_rad)

    def _check_still(self, positions: Sequence[Vec3]) -> None:
        spread_m = max(
            max(position[axis] for position in positions)
            - min(position[axis] for position in positions)
            for axis in range(3)
        )
        if spread_m > self._still_within_m:
            raise AnchorError(
                f"the position estimate moved by {spread_m:.2f} m within {self._span_s:g} s while "
                "the vehicle should stand still; wait until its estimator has settled"
            )


def _turn(v: Vec3, angle_rad: float) -> Vec3:
    cosine, sine = math.cos(angle_rad), math.sin(angle_rad)
    return (cosine * v[0] - sine * v[1], sine * v[0] + cosine * v[1], v[2])
