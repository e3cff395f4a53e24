"""Behaviours: each turns the present motion into a controller target (hold, go to, land...)."""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

from wil_campaign.vehicles.embedded.control.target import ControlTarget
from wil_campaign.vehicles.embedded.physics.states import BodyMotion
from wil_campaign.worlds.frames import Vec3


class WantedMotion(NamedTuple):
    """A received setpoint in the local frame; None for axes without one."""

    position_ned_m: tuple[float | None, float | None, float | None]
    velocity_ned_m_s: Vec3
    yaw_rad: float | None
    yaw_rate_rad_s: float
    has_velocity: bool
    has_heading: bool = True
    """Whether it has a heading or a rate of turn, be it 0."""


class GuidanceSpeeds(NamedTuple):
    """Guidance speed limits in m/s: across, up, down."""

    across: float
    up: float
    down: float


def speed_limits(across: float, up: float, down: float) -> GuidanceSpeeds:
    """Return guidance speed limits from parameters, at least zero."""
    return GuidanceSpeeds(max(0.0, across), max(0.0, up), max(0.0, down))


Limit = Callable[[Vec3, float, float], Vec3]
"""Maps velocity, heading and time to the allowed velocity."""


class GuidanceBehaviour(ABC):
    """A guidance behaviour: one way to fly. `done`: it has reached its end."""

    def __init__(self) -> None:
        self.done = False

    @property
    def lifts(self) -> bool:
        """Return whether the behaviour takes off."""
        return False

    @property
    def descends(self) -> bool:
        """Return whether the behaviour descends to the ground, so that touching it is a landing."""
        return False

    @property
    def steady(self) -> ControlTarget | None:
        """Return the target that `update` returns until the behaviour is changed; None if any."""
        return None

    @abstractmethod
    def update(self, now: BodyMotion, t_s: float) -> ControlTarget:
        """Return the behaviour's present guidance target."""

    def change_speeds(self, speeds: GuidanceSpeeds) -> None:  # noqa: B027 - most have their own speeds
        """Change the behaviour's speeds, if it flies at the automatic ones."""

    def face(self, yaw_rad: float) -> None:  # noqa: B027 - some have their own heading
        """Turn to a heading, if the behaviour leaves that to the user."""


class HoldBehaviour(GuidanceBehaviour):
    """The guidance behaviour of a hold: brake, then stay there, or at a given position."""

    _SLOW_M_S = 0.15

    def __init__(
        self, *, speeds: GuidanceSpeeds, yaw_rad: float, position_ned_m: Vec3 | None = None
    ) -> None:
        super().__init__()
        self._target = ControlTarget((None, None, None), yaw_rad=yaw_rad, speed_m_s=speeds)
        self._place = position_ned_m
        if position_ned_m is not None:
            self._target = self._target._replace(position_ned_m=position_ned_m)

    @property
    def steady(self) -> ControlTarget | None:
        """Return the target of a hold that has its place."""
        return self._target if self.done else None

    def update(self, now: BodyMotion, t_s: float) -> ControlTarget:  # noqa: ARG002 - the base's signature
        """Return zero velocity while fast, then the hold's position."""
        if self._place is None and _speed(now) <= self._SLOW_M_S:
            self._place = now.position_ned_m
            self._target = self._target._replace(position_ned_m=self._place)
        self.done = self._place is not None
        return self._target

    def face(self, yaw_rad: float) -> None:
        """Turn to a heading in the hold."""
        self._target = self._target._replace(yaw_rad=yaw_rad)


class GoToBehaviour(GuidanceBehaviour):
    """The guidance behaviour that flies to a place and stays there."""

    def __init__(
        self, *, position_ned_m: Vec3, yaw_rad: float, speeds: GuidanceSpeeds, radius_m: float
    ) -> None:
        super().__init__()
        self.position_ned_m = position_ned_m
        self._target = ControlTarget(position_ned_m, yaw_rad=yaw_rad, speed_m_s=speeds)
        self._radius_m = radius_m

    @property
    def steady(self) -> ControlTarget | None:
        """Return the place once it is reached."""
        return self._target if self.done else None

    def update(self, now: BodyMotion, t_s: float) -> ControlTarget:  # noqa: ARG002 - the base's signature
        """Return the place to go to; done within the radius."""
        if math.dist(now.position_ned_m, self.position_ned_m) < self._radius_m:
            self.done = True
        return self._target

    def change_speeds(self, speeds: GuidanceSpeeds) -> None:
        """Change the speeds on the way to the place."""
        self._target = self._target._replace(speed_m_s=speeds)

    def face(self, yaw_rad: float) -> None:
        """Turn to a heading on the way to the place."""
        self._target = self._target._replace(yaw_rad=yaw_rad)


class FollowBehaviour(GuidanceBehaviour):
    """The guidance behaviour that follows setpoints; without fresh ones it stands still.

    limit: limits velocities for obstacle avoidance; None for none.
    """

    def __init__(
        self,
        *,
        speeds: GuidanceSpeeds,
        yaw_rad: float,
        may_lift: bool,
        limit: Limit | None = None,
        direct: bool = False,
    ) -> None:
        super().__init__()
        self._direct = direct
        self._limit = limit
        self._speeds = speeds
        self._may_lift = may_lift
        self._faces_from_m_s: float | None = None
        self._still = ControlTarget(
            (None, None, None), yaw_rad=yaw_rad, speed_m_s=speeds, direct=direct
        )
        self._target = self._still
        self._lifts = self._descends = False

    @property
    def lifts(self) -> bool:
        """Return whether the followed setpoint is upwards and may take off."""
        return self._lifts

    @property
    def descends(self) -> bool:
        """Return whether the followed setpoint is downwards."""
        return self._descends

    def set(
        self, wanted: WantedMotion, *, keep_yaw_rad: float, faces_from_m_s: float | None = None
    ) -> None:
        """Set the followed setpoint; axes of None fly by velocity, no heading keeps this one.

        faces_from_m_s: from this horizontal speed on the nose points where it flies; None: never.
        """
        self._faces_from_m_s = faces_from_m_s
        yaw_rad = wanted.yaw_rad
        if yaw_rad is None and wanted.yaw_rate_rad_s == 0.0:
            yaw_rad = keep_yaw_rad
        self._target = ControlTarget(
            wanted.position_ned_m,
            wanted.velocity_ned_m_s,
            yaw_rad,
            wanted.yaw_rate_rad_s,
            self._speeds,
            self._direct,
        )
        climb, down = wanted.velocity_ned_m_s[2], wanted.position_ned_m[2]
        self._lifts = self._may_lift and (climb < -0.1 or (down or 0.0) < -0.3)
        self._descends = climb > 0.1 or (down is not None and down > 0.0)

    def change_speeds(self, speeds: GuidanceSpeeds) -> None:
        """Change the speeds of followed setpoints, the present one included."""
        self._speeds = speeds
        self._still = self._still._replace(speed_m_s=speeds)
        self._target = self._target._replace(speed_m_s=speeds)

    def face(self, yaw_rad: float) -> None:
        """Turn to a heading while following the setpoint."""
        self._faces_from_m_s = None
        self._target = self._target._replace(yaw_rad=yaw_rad, yaw_rate_rad_s=0.0)

    def stand(self, now: BodyMotion) -> None:
        """Drop the followed setpoint: zero velocity, present heading."""
        self._faces_from_m_s = None
        self._target = self._still._replace(yaw_rad=now.euler_rad[2])
        self._lifts = self._descends = False

    @property
    def steady(self) -> ControlTarget | None:
        """Return the followed setpoint where no velocity of it is limited."""
        target = self._target
        limited = self._limit is not None and target.position_ned_m[0] is None
        return None if limited or self._faces_from_m_s is not None else target

    def update(self, now: BodyMotion, t_s: float) -> ControlTarget:
        """Return the followed setpoint as guidance target."""
        self._face_motion(now)
        target = self._target
        if self._limit is None or target.position_ned_m[0] is not None:
            return target
        limited = self._limit(target.velocity_ned_m_s, now.euler_rad[2], t_s)
        return target._replace(velocity_ned_m_s=limited)

    def _face_motion(self, now: BodyMotion) -> None:
        north, east, _ = now.velocity_ned_m_s
        least_m_s = self._faces_from_m_s
        if least_m_s is not None and math.hypot(north, east) > least_m_s:
            self._target = self._target._replace(yaw_rad=math.atan2(east, north))


class TakeOffBehaviour(GuidanceBehaviour):
    """The guidance behaviour of a takeoff: a ramped climb. Done within `radius_m`."""

    def __init__(
        self,
        *,
        down_m: float,
        climb_m_s: float,
        ramp_s: float,
        radius_m: float,
        speeds: GuidanceSpeeds,
    ) -> None:
        super().__init__()
        self.down_m = down_m
        self._climb_m_s = climb_m_s
        self._ramp_s = ramp_s
        self._radius_m = radius_m
        self._speeds = speeds
        self._began_s: float | None = None
        self._place = (0.0, 0.0)
        self._target: ControlTarget | None = None
        self._share = 0.0
        """Of the climb's speed, on the ramp."""
        self.yaw_rad = 0.0
        self._faced = False

    @property
    def lifts(self) -> bool:
        """Return true: a takeoff lifts."""
        return True

    @property
    def goal_ned_m(self) -> Vec3:
        """Return the position at which the takeoff ends."""
        return (*self._place, self.down_m)

    @property
    def steady(self) -> ControlTarget | None:
        """Return the takeoff's target once it is reached, and the ramp is over."""
        return self._target if self.done and self._share == 1.0 else None

    def update(self, now: BodyMotion, t_s: float) -> ControlTarget:
        """Return the takeoff's target above its start, at the ramp's speed."""
        if self._began_s is None:
            self._began_s = t_s
            self._place = now.position_ned_m[:2]
            self.yaw_rad = self.yaw_rad if self._faced else now.euler_rad[2]
        if now.position_ned_m[2] - self.down_m < self._radius_m:
            self.done = True
        share = 1.0
        if self._ramp_s > 0.0:
            share = min(1.0, 0.1 + (t_s - self._began_s) / self._ramp_s)
        target = self._target
        if target is None or share != self._share:
            speeds = self._speeds._replace(up=self._climb_m_s * share)
            target = ControlTarget(
                (*self._place, self.down_m), yaw_rad=self.yaw_rad, speed_m_s=speeds
            )
            self._target, self._share = target, share
        return target

    def face(self, yaw_rad: float) -> None:
        """Turn to a heading in the climb, or above it."""
        self.yaw_rad, self._faced, self._target = yaw_rad, True, None


class LandProfile(NamedTuple):
    """Guidance's descent speeds, m/s by height above ground: from high to low."""

    steps: tuple[tuple[float, float], ...]

    def speed(self, height_m: float) -> float:
        """Return the descent speed: linear between the steps, constant beyond them."""
        steps = self.steps
        if height_m >= steps[0][0]:
            return steps[0][1]
        for (high, fast), (low, slow) in pairwise(steps):
            if height_m >= low:
                share = (height_m - low) / (high - low) if high > low else 0.0
                return slow + (fast - slow) * share
        return steps[-1][1]


class LandBehaviour(GuidanceBehaviour):
    """The guidance behaviour of a landing: brake, then descend until touchdown."""

    def __init__(
        self, *, profile: LandProfile, speeds: GuidanceSpeeds, ground_down_m: float
    ) -> None:
        super().__init__()
        self._profile = profile
        self._speeds = speeds
        self._ground_down_m = ground_down_m
        self._place: tuple[float, float] | None = None
        self._yaw_rad: float | None = None

    @property
    def descends(self) -> bool:
        """Return true: a landing descends."""
        return True

    def aim(self, north_m: float, east_m: float) -> None:
        """Land at this position, not where the vehicle comes to rest."""
        self._place = (north_m, east_m)

    def update(self, now: BodyMotion, t_s: float) -> ControlTarget:  # noqa: ARG002 - the base's signature
        """Return the landing's target at the profile's speed."""
        if self._yaw_rad is None:
            self._yaw_rad = now.euler_rad[2]
        north: float | None = None
        east: float | None = None
        if self._place is None and math.hypot(*now.velocity_ned_m_s[:2]) < 0.15:
            self._place = now.position_ned_m[:2]
        if self._place is not None:
            north, east = self._place
        speed = self._profile.speed(self._ground_down_m - now.position_ned_m[2])
        return ControlTarget(
            (north, east, None),
            (0.0, 0.0, speed),
            self._yaw_rad,
            speed_m_s=self._speeds._replace(down=max(speed, self._speeds.down)),
        )


class ReturnHomeBehaviour(GuidanceBehaviour):
    """The guidance behaviour of a return: climb, fly home, wait, and land there.

    end_down_m: the height, down, at which it stays above home instead; None: it lands.
    """

    def __init__(
        self,
        *,
        home_ned_m: Vec3,
        return_down_m: float,
        speeds: GuidanceSpeeds,
        wait_s: float,
        land: LandBehaviour,
        end_down_m: float | None = None,
    ) -> None:
        super().__init__()
        self._end_down_m = end_down_m
        self._home = home_ned_m
        self._down_m = return_down_m
        self._speeds = speeds
        self._wait_s = wait_s
        self._land = land
        self._start: tuple[float, float, float] | None = None
        self._climbed = False
        self._over_home_s: float | None = None
        self.landing = False

    @property
    def descends(self) -> bool:
        """Return whether the return is in its landing stage."""
        return self.landing

    def update(self, now: BodyMotion, t_s: float) -> ControlTarget:
        """Return the return's target in its stage: climb, cross, wait, land or stay."""
        if self.landing:
            return self._land.update(now, t_s)
        north, east, down = now.position_ned_m
        if self._start is None:
            self._start = (north, east, now.euler_rad[2])
        start_north, start_east, yaw = self._start
        if not self._climbed:
            self._climbed = down - self._down_m < 0.5
            return ControlTarget(
                (start_north, start_east, self._down_m), yaw_rad=yaw, speed_m_s=self._speeds
            )
        home_north, home_east, _ = self._home
        if math.hypot(home_north - north, home_east - east) < 0.5:
            if self._over_home_s is None:
                self._over_home_s = t_s
            if t_s - self._over_home_s >= self._wait_s:
                self._end(home_north, home_east)
        return ControlTarget(
            (home_north, home_east, self._down_m), yaw_rad=yaw, speed_m_s=self._speeds
        )

    def _end(self, north_m: float, east_m: float) -> None:
        """Begin the landing at home, or fly to the height of the end."""
        if self._end_down_m is not None:
            self._down_m = self._end_down_m
            return
        self.landing = True
        self._land.aim(north_m, east_m)


def _speed(now: BodyMotion) -> float:
    north, east, down = now.velocity_ned_m_s
    return math.sqrt(north * north + east * east + down * down)
