"""PX4's control law, compiled: position P, velocity PID, attitude P with yaw weight, rate PID.

As docs.px4.io describes it (Multicopter Controller Diagrams of v1.18; Brescianini, Hehn, D'Andrea,
"Nonlinear Quadrocopter Attitude Control", 2013), with the parameters that it names.
"""

import math

from wil_campaign.vehicles.embedded.control.kernels import (
    GRAVITY_M_S2,
    allocate_motor_thrusts,
    clamp,
    low_pass_share,
    quaternion_from_euler,
    quaternion_product,
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
from wil_campaign.worlds.jit import F64, Int, jit_compiled

GAINS = (
    "MPC_XY_P",
    "MPC_Z_P",
    "MPC_XY_VEL_P_ACC",
    "MPC_XY_VEL_I_ACC",
    "MPC_XY_VEL_D_ACC",
    "MPC_Z_VEL_P_ACC",
    "MPC_Z_VEL_I_ACC",
    "MPC_Z_VEL_D_ACC",
    "MPC_VELD_LP",
    "MPC_TILTMAX_AIR",
    "MC_ROLL_P",
    "MC_PITCH_P",
    "MC_YAW_P",
    "MC_YAW_WEIGHT",
    "MC_ROLLRATE_MAX",
    "MC_PITCHRATE_MAX",
    "MC_YAWRATE_MAX",
    "MC_ROLLRATE_P",
    "MC_PITCHRATE_P",
    "MC_YAWRATE_P",
    "MC_ROLLRATE_I",
    "MC_PITCHRATE_I",
    "MC_YAWRATE_I",
    "MC_ROLLRATE_D",
    "MC_PITCHRATE_D",
    "MC_YAWRATE_D",
    "MC_YAW_TQ_CUTOFF",
    "IMU_DGYRO_CUTOFF",
    "MPC_ACC_HOR",
    "MPC_JERK_AUTO",
    "MPC_ACC_UP_MAX",
    "MPC_YAWRAUTO_MAX",
    "MC_REF_W_N",
    "MC_REF_FF",
    "MC_REF_FF_MAX",
)
"""The law's gains in their order in the array; angles in rad there."""

DEGREES = ("MPC_TILTMAX_AIR", "MC_ROLLRATE_MAX", "MC_PITCHRATE_MAX", "MC_YAWRATE_MAX",
           "MPC_YAWRAUTO_MAX", "MC_REF_FF_MAX")  # fmt: skip

_SPEED_GAIN = 5.0
"""1/s. PX4's trajectories change speed as fast as the jerk allows; this smooths the end."""
_MOST_INTEGRAL_M_S2 = 1e3
"""No flight comes near it; it bounds the integral when gains make the anti-windup diverge."""
_LEAST_W_N_RAD_S = 1.0
"""The smallest documented value of MC_REF_W_N; at 0 the reference would not move."""

# Of the state: 0 trajectory (9), 9 heading setpoint, 10 velocity integral (3), 13 velocity (3),
# 16 its filtered rate (3), 19 acceleration setpoint (3), 22 rate integral (3), 25 rates (3),
# 28 their filtered rate (3), 31 filtered yaw torque, 32 whether a trajectory is flown,
# 33 whether anything was flown, 35 turn rate without a heading, 36 attitude reference (4),
# 40 its body rates (3), 43 its turn of this step (3).


@jit_compiled
def step_px4_law(law: F64, m: F64, outer: int) -> Int:
    """Advance PX4's law by a step; its position part by `outer` steps, not at all for 0."""
    s, g, body, t, out = law[0:48], law[48:84], law[84:94], law[94:106], law[106:110]
    dt = law[110]
    if outer > 0:
        _position(s, g, m, t, dt * outer)
    _attitude(s, g, body, m, dt, out)
    return 0


@jit_compiled
def advance_px4_body(body: F64, late: F64, number: int, outer: int) -> Int:
    """Set a body's motion and estimate as `read_and_estimate_motion`; then run the law, if any."""
    bits = read_and_estimate_motion(body, late, number, outer)
    if outer >= 0 and bits & (FINITE | WRECKED) == FINITE:
        step_px4_law(body[57:168], body[42:57], outer)
        bits |= FLOWN
    return bits


@jit_compiled
def _position(s: F64, g: F64, m: F64, t: F64, dt: float) -> Int:
    """Set the acceleration setpoint from position and velocity, and the heading setpoint."""
    across, up, down = t[8], t[9], t[10]
    if t[11] == 0.0:
        if s[32] == 0.0:
            s[0], s[1], s[2] = m[0], m[1], m[2]
            s[3], s[4], s[5] = m[3], m[4], m[5]
            s[6] = s[7] = s[8] = 0.0
            s[32] = 1.0
        shape_horizontal(s, t, across, g[28], g[29], g[0], _SPEED_GAIN, dt)
        shape_vertical(s, t, up, down, g[30], g[29], g[1], _SPEED_GAIN, dt)
        pn, pe, pd, vn, ve, vd, an, ae, ad = s[0], s[1], s[2], s[3], s[4], s[5], s[6], s[7], s[8]
    else:
        s[32] = 0.0
        pn, pe, pd, vn, ve, vd = t[0], t[1], t[2], t[3], t[4], t[5]
        an = ae = ad = 0.0
    # Position: its velocity has priority over the feed-forward when their sum exceeds the limit.
    if pn == pn:
        fn, fe = (pn - m[0]) * g[0], (pe - m[1]) * g[0]
        size = math.hypot(fn, fe)
        if size > across:
            fn, fe, vn, ve = fn * across / size, fe * across / size, 0.0, 0.0
        vn, ve = vn + fn, ve + fe
    size = math.hypot(vn, ve)
    if size > across:
        vn, ve = vn * across / size, ve * across / size
    if pd == pd:
        vd += (pd - m[2]) * g[1]
    vd = min(max(vd, -up), down)
    # Velocity.
    share = low_pass_share(g[8], dt)
    for i in range(3):
        if s[33] == 0.0:
            s[13 + i] = m[3 + i]
        s[16 + i] += share * ((m[3 + i] - s[13 + i]) / dt - s[16 + i])
        s[13 + i] = m[3 + i]
    s[33] = 1.0
    en, ee, ed = vn - m[3], ve - m[4], vd - m[5]
    north = g[2] * en + s[10] - g[4] * s[16] + an
    east = g[2] * ee + s[11] - g[4] * s[17] + ae
    downwards = g[5] * ed + s[12] - g[7] * s[18] + ad
    # At the tilt limit, the horizontal part of the thrust that height control demands is what is
    # produced (tilt by horizontal acceleration against gravity alone, MPC_ACC_DECOUPLE).
    most = GRAVITY_M_S2 * math.tan(g[9])
    size = math.hypot(north, east)
    share = most / size if size > most else 1.0
    produced = share * max(1.0 - downwards / GRAVITY_M_S2, 0.0)
    missing = max(1.0 - produced, 0.0)
    wound_n, wound_e = north * missing, east * missing
    north, east = north * share, east * share
    # Anti-windup: the part that was not produced is subtracted from the integrated error.
    s[10] = clamp(s[10] + g[3] * (en - 2.0 / g[2] * wound_n) * dt, _MOST_INTEGRAL_M_S2)
    s[11] = clamp(s[11] + g[3] * (ee - 2.0 / g[2] * wound_e) * dt, _MOST_INTEGRAL_M_S2)
    s[12] = clamp(s[12] + g[6] * ed * dt, GRAVITY_M_S2)
    s[19], s[20], s[21] = north, east, downwards
    # Heading: a trajectory turns no faster than its limit, a setpoint is used as it is.
    turn = t[7] * dt
    if t[6] == t[6]:
        turn = wrap_angle(t[6] - s[9])
    if t[11] == 0.0:
        turn = clamp(turn, g[31] * dt)
    s[9] = wrap_angle(s[9] + turn)
    s[35] = t[7] if t[6] != t[6] else 0.0
    return 0


@jit_compiled
def _attitude(s: F64, g: F64, body: F64, m: F64, dt: float, out: F64) -> Int:
    """Set the motors' thrusts from the acceleration and heading setpoints."""
    north, east, up = s[19], s[20], GRAVITY_M_S2 - s[21]
    # Tilt by horizontal acceleration against gravity alone (MPC_ACC_DECOUPLE).
    size = math.sqrt(north * north + east * east + GRAVITY_M_S2 * GRAVITY_M_S2)
    zx, zy, zz = -north / size, -east / size, GRAVITY_M_S2 / size
    thrust = body[0] * max(up, 0.0) / zz
    yaw = s[9]
    cos, sin = math.cos(yaw), math.sin(yaw)
    # The body axis z tilts the vehicle by (roll, pitch) in the heading's frame.
    right, forward = zy * cos - zx * sin, zx * cos + zy * sin
    roll_sp = -math.asin(min(max(right, -1.0), 1.0))
    pitch_sp = math.atan2(forward, zz)
    _smooth(s, g, quaternion_from_euler(roll_sp, pitch_sp, yaw), dt)
    q = quaternion_from_euler(m[6], m[7], m[8])
    p_sp, q_sp, r_sp = _rate_setpoint(s, g, q)
    share = low_pass_share(g[27], dt)
    for i in range(3):
        s[28 + i] += share * ((m[9 + i] - s[25 + i]) / dt - s[28 + i])
        s[25 + i] = m[9 + i]
    ep, eq, er = p_sp - m[9], q_sp - m[10], r_sp - m[11]
    roll = body[7] * (g[17] * ep + s[22] - g[23] * s[28])
    pitch = body[8] * (g[18] * eq + s[23] - g[24] * s[29])
    turn = body[9] * (g[19] * er + s[24] - g[25] * s[30])
    s[22] = clamp(s[22] + g[20] * ep * dt, 0.3)
    s[23] = clamp(s[23] + g[21] * eq * dt, 0.3)
    s[31] += low_pass_share(g[26], dt) * (turn - s[31])
    lacking = allocate_motor_thrusts(
        body, thrust, body[1] * roll, body[2] * pitch, body[3] * s[31], out
    )
    # The yaw torque that the motors cannot produce is not integrated.
    if lacking * er <= 0.0:
        s[24] = clamp(s[24] + g[22] * er * dt, 0.3)
    return 0


@jit_compiled
def _smooth(s: F64, g: F64, qd: tuple[float, float, float, float], dt: float) -> Int:
    """Advance the attitude reference towards a setpoint: second order, critically damped.

    Solved exactly over dt, so stable at any frequency (MC_REF_W_N, rad/s).
    """
    if s[36] == 0.0 and s[37] == 0.0 and s[38] == 0.0 and s[39] == 0.0:
        s[36], s[37], s[38], s[39] = qd
        s[40] = s[41] = s[42] = 0.0
    w, x, y, z = quaternion_product((s[36], -s[37], -s[38], -s[39]), qd)
    size = math.sqrt(x * x + y * y + z * z)
    factor = 2.0 if w >= 0.0 else -2.0
    if size > 1e-9:
        factor = 2.0 * math.atan2(math.copysign(size, w), abs(w)) / size
    turn = (x * factor, y * factor, z * factor)
    w_n = max(g[32], _LEAST_W_N_RAD_S)
    decay = math.exp(-w_n * dt)
    for i in range(3):
        pull = w_n * turn[i] - s[40 + i]
        s[43 + i] = turn[i] - (turn[i] + pull * dt) * decay
        s[40 + i] = (s[40 + i] + w_n * pull * dt) * decay
    x, y, z = s[43], s[44], s[45]
    angle = math.sqrt(x * x + y * y + z * z)
    factor = math.sin(0.5 * angle) / angle if angle > 1e-9 else 0.5
    w, x, y, z = quaternion_product(
        (s[36], s[37], s[38], s[39]), (math.cos(0.5 * angle), x * factor, y * factor, z * factor)
    )
    size = math.sqrt(w * w + x * x + y * y + z * z)
    s[36], s[37], s[38], s[39] = w / size, x / size, y / size, z / size
    return 0


@jit_compiled
def _rate_setpoint(
    s: F64, g: F64, q: tuple[float, float, float, float]
) -> tuple[float, float, float]:
    """Return the body rates (rad/s) that turn an attitude to the reference."""
    w, x, y, z = q
    ex, ey, ez = 2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)
    qd = (s[36], s[37], s[38], s[39])
    w, x, y, z = qd
    zx, zy, zz = 2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)
    # Reduced attitude: the shortest turn that aligns z alone, then yaw with its weight.
    dot = ex * zx + ey * zy + ez * zz
    rw, rx, ry, rz = 1.0 + dot, ey * zz - ez * zy, ez * zx - ex * zz, ex * zy - ey * zx
    norm = math.sqrt(rw * rw + rx * rx + ry * ry + rz * rz)
    if norm > 1e-3:
        reduced = quaternion_product((rw / norm, rx / norm, ry / norm, rz / norm), q)
    else:
        reduced = qd
    mix = quaternion_product((reduced[0], -reduced[1], -reduced[2], -reduced[3]), qd)
    sign = 1.0 if mix[0] >= 0.0 else -1.0
    weight = g[13]
    half_c, half_s = min(max(sign * mix[0], -1.0), 1.0), min(max(sign * mix[3], -1.0), 1.0)
    qd = quaternion_product(
        reduced, (math.cos(weight * math.acos(half_c)), 0.0, 0.0,
                  math.sin(weight * math.asin(half_s)))
    )  # fmt: skip
    e = quaternion_product((q[0], -q[1], -q[2], -q[3]), qd)
    sign = 2.0 if e[0] >= 0.0 else -2.0
    # The heading rate in body axes, and the feed-forward of the reference's rates.
    turn, ahead, most = s[35], g[33], g[34]
    p_sp = sign * e[1] * g[10] + turn * earth_down_in_body(q, 0) + clamp(ahead * s[40], most)
    q_sp = sign * e[2] * g[11] + turn * earth_down_in_body(q, 1) + clamp(ahead * s[41], most)
    r_sp = (
        sign * e[3] * g[12] / max(weight, 1e-4)
        + turn * earth_down_in_body(q, 2)
        + clamp(ahead * s[42], most)
    )
    return clamp(p_sp, g[14]), clamp(q_sp, g[15]), clamp(r_sp, g[16])


@jit_compiled
def earth_down_in_body(q: tuple[float, float, float, float], axis: int) -> float:
    """Return the earth's down in body axes, one component."""
    w, x, y, z = q
    if axis == 0:
        return 2.0 * (x * z - w * y)
    if axis == 1:
        return 2.0 * (y * z + w * x)
    return 1.0 - 2.0 * (x * x + y * y)
