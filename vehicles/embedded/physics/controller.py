"""The flight controller: position, velocity, attitude and rate cascade; tuples of floats.

Runs 250 times per simulated second, hence no arrays; the outer loops run every second time.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

from vehicles.embedded.physics.airframe import Airframe
from vehicles.embedded.physics.states import Motion, Thrusts
from worlds.frames import Vec3

GRAVITY_M_S2 = 9.80665
_OUTER_EVERY = 2
_EASE_PER_S = 5.0


@dataclass(frozen=True, slots=True)
class Gains:
    """The controller's gains, horizontal and vertical; names and defaults of PX4's parameters.

    position: MPC_XY_P, MPC_Z_P (1/s). velocity: MPC_XY_VEL_P_ACC, MPC_Z_VEL_P_ACC (1/s).
    integral: MPC_XY_VEL_I_ACC, MPC_Z_VEL_I_ACC (1/s2). acceleration: how fast a velocity setpoint
    may change, inf for at once and without feed-forward. attitude: MC_ROLL_P, MC_YAW_P (1/s).
    rate: bandwidth of the rate loop (1/s), bounded by the motors' lag. The rest are limits.
    """

    position: tuple[float, float] = (0.95, 1.0)
    velocity: tuple[float, float] = (1.8, 4.0)
    integral: tuple[float, float] = (0.4, 2.0)
    acceleration_m_s2: tuple[float, float] = (math.inf, math.inf)
    attitude: tuple[float, float] = (6.5, 2.8)
    rate: tuple[float, float] = (16.0, 8.0)
    max_tilt_rad: float = math.radians(45.0)
    max_yaw_rate_rad_s: float = 1.0


class Target(NamedTuple):
    """The controller's target, NED, the estimator's frame.

    position_ned_m: per axis, None where only the velocity counts. velocity_ned_m_s: the velocity,
    or what is added to the one that position asks for. yaw_rad: None to turn at yaw_rate_rad_s.
    speed_m_s: limits (horizontal, up, down) of the velocity that results.
    """

    position_ned_m: tuple[float | None, float | None, float | None]
    velocity_ned_m_s: Vec3 = (0.0, 0.0, 0.0)
    yaw_rad: float | None = None
    yaw_rate_rad_s: float = 0.0
    speed_m_s: Vec3 = (5.0, 3.0, 1.5)


class Controller:
    """The cascaded controller: from estimate and target to the thrusts of four motors."""

    def __init__(self, *, airframe: Airframe, gains: Gains, dt_s: float) -> None:
        self._frame = airframe
        self._gains = gains
        self._dt_s = dt_s * _OUTER_EVERY
        (_, _), (rate, yaw_rate) = gains.attitude, gains.rate
        self._torque_gains = (
            airframe.inertia_xx_kg_m2 * rate,
            airframe.inertia_yy_kg_m2 * rate,
            airframe.inertia_zz_kg_m2 * yaw_rate,
        )
        self._levers_m = (4.0 * airframe.motor_offset_m, 4.0 * airframe.torque_per_thrust_m)
        self._eased = gains.acceleration_m_s2[0] < math.inf
        self._most_turn_rad = gains.max_yaw_rate_rad_s * self._dt_s
        self._integral: Vec3 = (0.0, 0.0, 0.0)
        self._velocity_setpoint: Vec3 = (0.0, 0.0, 0.0)
        self._acceleration: Vec3 = (0.0, 0.0, 0.0)
        self._feed_forward: Vec3 = (0.0, 0.0, 0.0)
        self._calls = 0
        self._yaw_rad = 0.0

    @property
    def yaw_setpoint_rad(self) -> float:
        """Return the controller's heading setpoint."""
        return self._yaw_rad

    def reset(self, *, yaw_rad: float, velocity_ned_m_s: Vec3 = (0.0, 0.0, 0.0)) -> None:
        """Reset the controller's integrals; hold this heading, start from this velocity."""
        self._integral = (0.0, 0.0, 0.0)
        self._velocity_setpoint = velocity_ned_m_s
        self._yaw_rad = yaw_rad
        self._calls = 0

    def run(self, now: Motion, target: Target) -> Thrusts:
        """Return the controller's thrusts of this step."""
        if self._calls % _OUTER_EVERY == 0:
            self._shape(now, target)
            self._acceleration = self._accelerate(now)
            self._turn(target)
        self._calls += 1
        return self._attitude(now, self._acceleration)

    def _shape(self, now: Motion, target: Target) -> None:
        """Set the velocity setpoint: position error and feed-forward, bounded, then slewed."""
        (pn, pe, pd), (north, east, down), _, _, (speed, up, sink) = target
        gains, here = self._gains, now.position_ned_m
        if pn is not None and pe is not None:
            limit = min(gains.acceleration_m_s2[0], 3.0)
            dn, de = pn - here[0], pe - here[1]
            share = _approach(math.hypot(dn, de), gains.position[0], limit)
            north += dn * share
            east += de * share
        if pd is not None:
            limit = min(gains.acceleration_m_s2[1], 2.0)
            dd = pd - here[2]
            down += dd * _approach(abs(dd), gains.position[1], limit)
        horizontal = math.hypot(north, east)
        if horizontal > speed:
            north, east = north * speed / horizontal, east * speed / horizontal
        down = -up if down < -up else (down if down < sink else sink)
        self._slew(north, east, down)

    def _slew(self, north: float, east: float, down: float) -> None:
        """Slew the velocity setpoint; keep its rate as feed-forward."""
        (limit, vertical), dt = self._gains.acceleration_m_s2, self._dt_s
        old_north, old_east, old_down = self._velocity_setpoint
        dn, de = north - old_north, east - old_east
        dd = _clamp(down - old_down, vertical * dt)
        if self._eased:
            change = math.hypot(dn, de)
            if change > 0.0:
                # Eased in at the end: the body cannot tilt back at once.
                share = min(limit / change, _EASE_PER_S) * dt
                dn, de = dn * share, de * share
            self._feed_forward = (dn / dt, de / dt, dd / dt)
        self._velocity_setpoint = (old_north + dn, old_east + de, old_down + dd)

    def _accelerate(self, now: Motion) -> Vec3:
        gains, dt = self._gains, self._dt_s
        (kv, kvz), (ki, kiz) = gains.velocity, gains.integral
        (vn, ve, vd), (sn, se, sd) = now.velocity_ned_m_s, self._velocity_setpoint
        en, ee, ed = sn - vn, se - ve, sd - vd
        pull_n, pull_e, pull_d = self._integral
        pull_n = _clamp(pull_n + ki * en * dt, 4.0)
        pull_e = _clamp(pull_e + ki * ee * dt, 4.0)
        pull_d = _clamp(pull_d + kiz * ed * dt, 5.0)
        self._integral = (pull_n, pull_e, pull_d)
        north, east, down = self._feed_forward
        return (
            kv * en + pull_n + north,
            kv * ee + pull_e + east,
            _clamp(kvz * ed + pull_d + down, 6.0),
        )

    def _turn(self, target: Target) -> None:
        """Slew the heading setpoint, no faster than the vehicle may turn."""
        if target.yaw_rad is None:
            turn_rad = target.yaw_rate_rad_s * self._dt_s
        else:
            turn_rad = _wrap(target.yaw_rad - self._yaw_rad)
        self._yaw_rad = _wrap(self._yaw_rad + _clamp(turn_rad, self._most_turn_rad))

    def _attitude(self, now: Motion, acceleration: Vec3) -> Thrusts:
        gains, (gain_x, gain_y, gain_z) = self._gains, self._torque_gains
        _, _, (roll, pitch, yaw), (p, q, r), _ = now
        cos, sin = math.cos(yaw), math.sin(yaw)
        north, east, down = acceleration
        forward, right = north * cos + east * sin, east * cos - north * sin
        up = GRAVITY_M_S2 - down
        tilt = gains.max_tilt_rad
        pitch_wanted = _clamp(math.atan2(-forward, up), tilt)
        roll_wanted = _clamp(math.atan2(right * math.cos(pitch_wanted), up), tilt)
        thrust = self._frame.mass_kg * up / max(0.5, math.cos(roll) * math.cos(pitch))
        ka, kaz = gains.attitude
        roll_rate = _clamp(ka * (roll_wanted - roll), 3.8)
        pitch_rate = _clamp(ka * (pitch_wanted - pitch), 3.8)
        yaw_rate = _clamp(kaz * _wrap(self._yaw_rad - yaw), 1.5)
        return self._mix(
            thrust,
            gain_x * (roll_rate - p),
            gain_y * (pitch_rate - q),
            _clamp(gain_z * (yaw_rate - r), 0.02),
        )

    def _mix(self, thrust: float, roll: float, pitch: float, yaw: float) -> Thrusts:
        """Return motor thrusts in N for the thrust and torques; saturation cuts thrust."""
        arm_m, drag_m = self._levers_m
        a, b, c, d = thrust / 4.0, roll / arm_m, pitch / arm_m, yaw / drag_m
        m0, m1, m2, m3 = a - b + c + d, a + b - c + d, a + b + c - d, a - b - c - d
        excess = max(m0, m1, m2, m3) - self._frame.max_thrust_n
        if excess > 0.0:
            m0, m1, m2, m3 = m0 - excess, m1 - excess, m2 - excess, m3 - excess
        return (
            m0 if m0 > 0.0 else 0.0,
            m1 if m1 > 0.0 else 0.0,
            m2 if m2 > 0.0 else 0.0,
            m3 if m3 > 0.0 else 0.0,
        )


def _approach(distance_m: float, gain: float, deceleration_m_s2: float) -> float:
    """Return the controller's speed by distance: proportional near, constant braking farther.

    The square-root controller that ArduPilot and PX4 both use for positions.
    """
    linear_m = deceleration_m_s2 / (gain * gain)
    if distance_m <= linear_m:
        return gain
    return math.sqrt(2.0 * deceleration_m_s2 * (distance_m - linear_m / 2.0)) / distance_m


def _clamp(value: float, limit: float) -> float:
    """Return the controller's value clamped to plus or minus a limit."""
    if value > limit:
        return limit
    return -limit if value < -limit else value


def _wrap(angle_rad: float) -> float:
    """Return the controller's angle wrapped to [-pi, pi)."""
    return (angle_rad + math.pi) % (2.0 * math.pi) - math.pi
