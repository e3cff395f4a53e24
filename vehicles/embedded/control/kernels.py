"""Functions that are compiled into both control laws: shaping, quaternions, allocation.

All angles rad, NED, body x forward, y right, z down. Arrays: `body` is the airframe (see
`ControlLaw`), `shape` holds a trajectory's position, velocity, acceleration (NED, 9 values).
"""

import math

from wil_campaign.worlds.jit import F64, Float, Int, jit_inlined

GRAVITY_M_S2 = 9.80665
STATE, GAINS, AIRFRAME, TARGET, THRUSTS, STEP_S = (
    slice(0, 48), slice(48, 84), slice(84, 94), slice(94, 106), slice(106, 110), 110
)  # fmt: skip
"""Places in a law array, which holds all that a step of a law reads and sets but the motion, so
that Python passes one array: `s`, `g`, `body`, `t`, `out` and `dt` of the kernels are of it."""
LAW_NUMBERS = 111


@jit_inlined
def clamp(value: Float, limit: Float) -> Float:
    """Return a value clamped to plus or minus a limit."""
    return min(max(value, -limit), limit)


@jit_inlined
def wrap_angle(angle_rad: Float) -> Float:
    """Return an angle wrapped to [-pi, pi)."""
    return (angle_rad + math.pi) % (2.0 * math.pi) - math.pi


@jit_inlined
def root_gain(error: Float, gain: Float, second_limit: Float) -> Float:
    """Return the factor from an error to its rate: linear when small, square root when large.

    Beyond second_limit / gain**2 the rate is the one from which the error can be stopped with
    `second_limit`: the square-root controller of ArduPilot's documentation.
    """
    linear = second_limit / (gain * gain)
    factor = gain
    if error > linear:
        factor = math.sqrt(2.0 * second_limit * (error - 0.5 * linear)) / error
    return factor


@jit_inlined
def shape_horizontal(
    shape: F64, target: F64, speed: Float, acceleration: Float, jerk: Float,
    place_gain: Float, speed_gain: Float, dt: Float,
) -> None:  # fmt: skip
    """Advance the horizontal trajectory by dt: speed, acceleration and jerk bounded.

    place_gain, speed_gain (1/s): from distance to speed, from speed error to acceleration, where
    both are small. It brakes with half of the acceleration, as ArduCopter does (identified: the
    return over 9 m), so that the jerk suffices to stop at the target.
    """
    vn, ve = target[3], target[4]
    if target[0] == target[0]:
        dn, de = target[0] - shape[0], target[1] - shape[1]
        factor = root_gain(math.hypot(dn, de), place_gain, 0.5 * acceleration)
        vn += dn * factor
        ve += de * factor
    size = math.hypot(vn, ve)
    if size > speed:
        vn, ve = vn * speed / size, ve * speed / size
    en, ee = vn - shape[3], ve - shape[4]
    size = math.hypot(en, ee)
    factor = root_gain(size, speed_gain, jerk)
    if size * factor > acceleration:
        factor = acceleration / size
    jn, je = en * factor - shape[6], ee * factor - shape[7]
    size = math.hypot(jn, je)
    if size > jerk * dt:
        jn, je = jn * jerk * dt / size, je * jerk * dt / size
    shape[6] += jn
    shape[7] += je
    shape[0] += shape[3] * dt + 0.5 * shape[6] * dt * dt
    shape[1] += shape[4] * dt + 0.5 * shape[7] * dt * dt
    shape[3] += shape[6] * dt
    shape[4] += shape[7] * dt


@jit_inlined
def shape_vertical(
    shape: F64, target: F64, up: Float, down: Float, acceleration: Float, jerk: Float,
    place_gain: Float, speed_gain: Float, dt: Float,
) -> None:  # fmt: skip
    """Advance the vertical trajectory by dt, as the horizontal one."""
    v = target[5]
    if target[2] == target[2]:
        d = target[2] - shape[2]
        v += d * root_gain(abs(d), place_gain, 0.5 * acceleration)
    e = min(max(v, -up), down) - shape[5]
    wanted = clamp(e * root_gain(abs(e), speed_gain, jerk), acceleration)
    shape[8] += clamp(wanted - shape[8], jerk * dt)
    shape[2] += shape[5] * dt + 0.5 * shape[8] * dt * dt
    shape[5] += shape[8] * dt


@jit_inlined
def low_pass_share(cutoff_hz: Float, dt: Float) -> Float:
    """Return a new sample's weight in a first-order low pass; 1 without a cutoff."""
    share = 1.0
    if cutoff_hz > 0.0:
        share = dt / (dt + 1.0 / (2.0 * math.pi * cutoff_hz))
    return share


@jit_inlined
def quaternion_product(
    a: tuple[Float, Float, Float, Float], b: tuple[Float, Float, Float, Float]
) -> tuple[Float, Float, Float, Float]:
    """Return the product of two quaternions (w, x, y, z)."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


@jit_inlined
def quaternion_from_euler(
    roll: Float, pitch: Float, yaw: Float
) -> tuple[Float, Float, Float, Float]:
    """Return the quaternion of Euler angles, yaw first."""
    cr, sr = math.cos(0.5 * roll), math.sin(0.5 * roll)
    cp, sp = math.cos(0.5 * pitch), math.sin(0.5 * pitch)
    cy, sy = math.cos(0.5 * yaw), math.sin(0.5 * yaw)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


@jit_inlined
def allocate_motor_thrusts(
    body: F64, thrust: Float, roll: Float, pitch: Float, yaw: Float, out: F64
) -> Int:
    """Set the motors' thrusts (N) for a thrust (N) and torques (N m), PX4's quad X order.

    To keep all motors between zero and their maximum, yaw is reduced first, then thrust. Return the
    sign of the missing yaw torque, 0 when nothing is missing.
    """
    most = body[6]
    a, b, c = 0.25 * thrust, roll / body[4], pitch / body[4]
    m0, m1, m2, m3 = a - b + c, a + b - c, a + b + c, a - b - c
    excess = max(m0, m1, m2, m3) - most
    if excess > 0.0:
        m0, m1, m2, m3 = m0 - excess, m1 - excess, m2 - excess, m3 - excess
    least = 0.05 * most
    upwards = max(least, min(most - m0, most - m1, m2, m3))
    downwards = max(least, min(m0, m1, most - m2, most - m3))
    asked = yaw / body[5]
    d = min(max(asked, -downwards), upwards)
    out[0] = min(max(m0 + d, 0.0), most)
    out[1] = min(max(m1 + d, 0.0), most)
    out[2] = min(max(m2 - d, 0.0), most)
    out[3] = min(max(m3 - d, 0.0), most)
    return (asked > d) - (asked < d)
