"""ArduCopter's control law, compiled: jerk-limited shaping, position P, velocity PID, attitude.

As ardupilot.org describes it (Copter position control and attitude control, input shaping), with
the parameters that it names.
"""

import math

from wil_campaign.vehicles.embedded.control.kernels import (
    GRAVITY_M_S2,
    allocate_motor_thrusts,
    clamp,
    low_pass_share,
    quaternion_from_euler,
    quaternion_product,
    root_gain,
    shape_horizontal,
    shape_vertical,
    wrap_angle,
)
from wil_campaign.vehicles.embedded.physics.motion_kernel import (
    FINITE,
    FLOWN,
    WRECKED,
    read_and_estimate_motion,
)
from wil_campaign.worlds.jit import F64, Float, Int, jit_compiled

GAINS = (
    "PSC_NE_POS_P",
    "PSC_D_POS_P",
    "PSC_NE_VEL_P",
    "PSC_NE_VEL_I",
    "PSC_NE_VEL_D",
    "PSC_NE_VEL_FLTE",
    "PSC_NE_VEL_FLTD",
    "PSC_D_VEL_P",
    "PSC_D_ACC_P",
    "PSC_D_ACC_I",
    "PSC_D_ACC_FLTE",
    "WPNAV_ACCEL",
    "WPNAV_ACCEL_Z",
    "PSC_NE_JERK",
    "PSC_D_JERK",
    "ATC_ANGLE_MAX",
    "ATC_ANG_RLL_P",
    "ATC_ANG_PIT_P",
    "ATC_ANG_YAW_P",
    "ATC_INPUT_TC",
    "ATC_ACCEL_R_MAX",
    "ATC_ACCEL_P_MAX",
    "ATC_ACCEL_Y_MAX",
    "ATC_SLEW_YAW",
    "ATC_RAT_RLL_P",
    "ATC_RAT_PIT_P",
    "ATC_RAT_YAW_P",
    "ATC_RAT_RLL_I",
    "ATC_RAT_PIT_I",
    "ATC_RAT_YAW_I",
    "ATC_RAT_RLL_D",
    "ATC_RAT_PIT_D",
    "ATC_RAT_YAW_D",
    "ATC_RAT_YAW_FLTE",
    "ATC_RAT_RLL_FLTD",
    "MOT_THST_HOVER",
)
"""The law's gains in their order in the array; in rad and m there."""

_ANGLES = ("ATC_ACCEL_R_MAX", "ATC_ACCEL_P_MAX", "ATC_ACCEL_Y_MAX", "ATC_SLEW_YAW")
DEGREES = ("ATC_ANGLE_MAX", *_ANGLES)
HUNDREDTHS = ("WPNAV_ACCEL", "WPNAV_ACCEL_Z", *_ANGLES)
"""Parameters in centimetres or centidegrees."""

# Of the state: 0 trajectory (9), 9 heading setpoint, 10 velocity integral (2), 12 filtered
# velocity error (2), 14 its derivative (2), 16 acceleration setpoint (3), 19 vertical integral,
# 20 filtered vertical acceleration error, 21 attitude target (roll, pitch, yaw), 24 its rates (3),
# 27 rate integral (3), 30 rates (3), 33 their filtered rate (3), 36 filtered yaw rate error,
# 37 whether anything was flown.


@jit_compiled
def step_copter_law(law: F64, m: F64, outer: int) -> Int:
    """Advance ArduCopter's law by a step; its position part by `outer` steps, not at all for 0."""
    s, g, body, t, out = law[0:48], law[48:84], law[84:94], law[94:106], law[106:110]
    dt = law[110]
    if s[37] == 0.0:
        for i in range(6):
            s[i] = m[i]
        s[21], s[22], s[23] = m[6], m[7], m[8]
        s[37] = 1.0
    if outer > 0:
        _position(s, g, m, t, dt * outer)
    _attitude(s, g, body, m, t, dt, out)
    return 0


@jit_compiled
def advance_copter_body(body: F64, late: F64, number: int, outer: int) -> Int:
    """Set a body's motion and estimate as `read_and_estimate_motion`; then run the law, if any."""
    bits = read_and_estimate_motion(body, late, number, outer)
    if outer >= 0 and bits & (FINITE | WRECKED) == FINITE:
        step_copter_law(body[57:168], body[42:57], outer)
        bits |= FLOWN
    return bits


@jit_compiled
def _position(s: F64, g: F64, m: F64, t: F64, dt: float) -> Int:
    """Advance the trajectory and set the acceleration setpoint from its errors.

    The speed limits apply to position targets only; a velocity target is flown whatever
    WPNAV_SPEED is (seen with ArduCopter 4.7: WPNAV_SPEED 1.2 m/s, 2.5 m/s commanded and flown).
    """
    across, up, down = t[8], t[9], t[10]
    if t[0] != t[0]:
        across = math.inf
    if t[2] != t[2]:
        up = down = math.inf
    gain, gain_z = g[13] / g[11], g[14] / g[12]
    shape_horizontal(s, t, across, g[11], g[13], 0.5 * gain, gain, dt)
    shape_vertical(s, t, up, down, g[12], g[14], 0.5 * gain_z, gain_z, dt)
    # Position to velocity, by the square-root controller.
    dn, de, dd = s[0] - m[0], s[1] - m[1], s[2] - m[2]
    factor = root_gain(math.hypot(dn, de), g[0], g[11])
    vn, ve = s[3] + dn * factor, s[4] + de * factor
    vd = s[5] + dd * root_gain(abs(dd), g[1], g[12])
    # Velocity to acceleration.
    share, share_d = low_pass_share(g[5], dt), low_pass_share(g[6], dt)
    en, ee = vn - m[3], ve - m[4]
    old_n, old_e = s[12], s[13]
    s[12] += share * (en - s[12])
    s[13] += share * (ee - s[13])
    s[14] += share_d * ((s[12] - old_n) / dt - s[14])
    s[15] += share_d * ((s[13] - old_e) / dt - s[15])
    north = s[6] + g[2] * s[12] + s[10] + g[4] * s[14]
    east = s[7] + g[2] * s[13] + s[11] + g[4] * s[15]
    most = GRAVITY_M_S2 * math.tan(g[15])
    size = math.hypot(north, east)
    if size > most:
        north, east = north * most / size, east * most / size
    # The integral grows only while the tilt is not at its limit.
    if size <= most or s[10] * s[12] + s[11] * s[13] < 0.0:
        s[10] += g[3] * s[12] * dt
        s[11] += g[3] * s[13] * dt
    s[16], s[17] = north, east
    s[18] = s[8] + g[7] * (vd - m[5])
    return 0


@jit_compiled
def _shape_angle(error: Float, rate: Float, g: F64, most: Float, dt: Float) -> Float:
    """Return the next rate of an attitude target that turns by `error` (ATC_INPUT_TC)."""
    gain = 1.0 / max(g[19], 0.01)
    wanted = error * root_gain(abs(error), gain, most)
    return rate + clamp(wanted - rate, most * dt)


@jit_compiled
def _attitude(s: F64, g: F64, body: F64, m: F64, t: F64, dt: float, out: F64) -> Int:
    """Set the motors' thrusts from the acceleration setpoint and the heading."""
    # Heading: an angle is approached no faster than ATC_SLEW_YAW; a rate moves the target.
    turn = t[7] * dt
    if t[6] == t[6]:
        turn = wrap_angle(t[6] - s[9])
    s[9] = wrap_angle(s[9] + clamp(turn, g[23] * dt))
    yaw_rate = _shape_angle(wrap_angle(s[9] - s[23]), s[26], g, g[22], dt)
    s[26] = clamp(yaw_rate, g[23])
    s[23] = wrap_angle(s[23] + s[26] * dt)
    cos, sin = math.cos(m[8]), math.sin(m[8])
    forward, right = s[16] * cos + s[17] * sin, s[17] * cos - s[16] * sin
    pitch = -math.atan(forward / GRAVITY_M_S2)
    roll = math.atan(right * math.cos(pitch) / GRAVITY_M_S2)
    s[24] = _shape_angle(roll - s[21], s[24], g, g[20], dt)
    s[25] = _shape_angle(pitch - s[22], s[25], g, g[21], dt)
    s[21] += s[24] * dt
    s[22] += s[25] * dt
    # Vertical acceleration, from the measured specific force.
    q = quaternion_from_euler(m[6], m[7], m[8])
    w, x, y, z = q
    zx, zy, zz = 2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)
    measured = zx * m[12] + zy * m[13] + zz * m[14] + GRAVITY_M_S2
    error = s[18] - measured
    s[20] += low_pass_share(g[10], dt) * (error - s[20])
    hover = g[35] / GRAVITY_M_S2
    s[19] = clamp(s[19] + g[9] * s[20] * dt, 1.0)
    up = GRAVITY_M_S2 - (g[8] * s[20] + s[19]) / hover
    thrust = body[0] * max(up, 0.0) / max(zz, 0.5)
    # Attitude error to rates, with the target's rates as feed-forward.
    e = quaternion_product((w, -x, -y, -z), quaternion_from_euler(s[21], s[22], s[23]))
    sign = 2.0 if e[0] >= 0.0 else -2.0
    ep = sign * e[1] * root_gain(abs(sign * e[1]), g[16], 0.5 * g[20]) + s[24] - m[9]
    eq = sign * e[2] * root_gain(abs(sign * e[2]), g[17], 0.5 * g[21]) + s[25] - m[10]
    er = sign * e[3] * root_gain(abs(sign * e[3]), g[18], 0.5 * g[22]) + s[26] - m[11]
    share = low_pass_share(g[34], dt)
    for i in range(3):
        s[33 + i] += share * ((m[9 + i] - s[30 + i]) / dt - s[33 + i])
        s[30 + i] = m[9 + i]
    s[36] += low_pass_share(g[33], dt) * (er - s[36])
    s[27] = clamp(s[27] + g[27] * ep * dt, 0.5)
    s[28] = clamp(s[28] + g[28] * eq * dt, 0.5)
    s[29] = clamp(s[29] + g[29] * s[36] * dt, 0.5)
    roll_u = g[24] * ep + s[27] - g[30] * s[33]
    pitch_u = g[25] * eq + s[28] - g[31] * s[34]
    yaw_u = g[26] * s[36] + s[29] - g[32] * s[35]
    allocate_motor_thrusts(
        body,
        thrust,
        body[1] * body[7] * roll_u,
        body[2] * body[8] * pitch_u,
        body[3] * body[9] * yaw_u,
        out,
    )
    return 0
