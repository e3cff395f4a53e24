"""The compiled body: a rigid quadrotor on flat ground, as JSBSim flies the same airframe.

Lengths in m, forces in N, angles in rad; NED, body x forward, y right, z down. JSBSim's order and
integrators (FGPropagate's defaults): a step moves the body by the forces of the step before, then
computes those of this one. Attitude and rates by Euler, velocity by Adams-Bashforth of order 2,
position of order 3. The earth neither turns nor curves, and air and gravity are those of the start.
"""

import math

from wil_campaign.vehicles.poses.truth import Thrusts
from wil_campaign.worlds.jit import F64, Float, Int, jit_compiled

STATE = 43
"""Of the state: 0 position, 3 velocity, 6 attitude (quaternion, body to NED), 10 body rates, 13
acceleration, 16 that of the step before, 19 velocity of the step before, 22 of the one before that,
25 angular acceleration, 28 specific force, 31 wind, 34 thrusts, 38 commands of the step before,
42 how many legs touch the ground. NED but for rates, angular acceleration and specific force.

Of the constants: 0 mass, 1 inertia (3), 4 motors forward (4), 8 right (4), 12 torque per thrust
(4), 16 weights of the motors' lag (of commands, of thrusts), 18 maximum thrust, 19 drag per speed
squared (3), 22 least speed of drag, 23 drag per speed, 24 torque per body rate, 25 forward of legs
(4), 29 right of legs (4), 33 stiffness, 34 damping, 35 grip (N s/m), 36 gravity, 37 length of
legs."""

_METRES_PER_FOOT = 0.3048
_FRICTION = 0.7
"""Of a sliding leg, as in the aircraft file."""


@jit_compiled
def fly_rigid_body(x: F64, c: F64, commands: Thrusts, dt: Float, raw: F64) -> Int:
    """Advance the compiled body by one step with these commands (N); set JSBSim's numbers of it.

    raw: as of `motion_kernel.read`, in feet, up.
    """
    _move(x, dt)
    for i in range(4):
        thrust = c[16] * (commands[i] + x[38 + i]) + c[17] * x[34 + i]
        x[38 + i] = commands[i]
        x[34 + i] = min(max(thrust, 0.0), c[18])  # what is not a number stays it
    for i in range(3):
        raw[12 + i] = x[28 + i] / _METRES_PER_FOOT
    _accelerate(x, c)
    for i in range(3):
        raw[i] = x[i] / _METRES_PER_FOOT
        raw[3 + i] = x[3 + i] / _METRES_PER_FOOT
        raw[9 + i] = x[10 + i]
    raw[2] = -raw[2]
    qw, qx, qy, qz = x[6], x[7], x[8], x[9]
    raw[6] = math.atan2(2.0 * (qy * qz + qw * qx), 1.0 - 2.0 * (qx * qx + qy * qy))
    raw[7] = math.asin(min(max(2.0 * (qw * qy - qx * qz), -1.0), 1.0))
    raw[8] = math.atan2(2.0 * (qx * qy + qw * qz), 1.0 - 2.0 * (qy * qy + qz * qz))
    return 0


@jit_compiled
def _move(x: F64, dt: Float) -> Int:
    """Integrate the compiled body's state over a step."""
    w, i, j, k = x[6], x[7], x[8], x[9]
    p, q, r = 0.5 * dt * x[10], 0.5 * dt * x[11], 0.5 * dt * x[12]
    w, i, j, k = (
        w - i * p - j * q - k * r,
        i + w * p + j * r - k * q,
        j + w * q - i * r + k * p,
        k + w * r + i * q - j * p,
    )
    size = math.sqrt(w * w + i * i + j * j + k * k)
    x[6], x[7], x[8], x[9] = w / size, i / size, j / size, k / size
    for axis in range(3):
        x[10 + axis] += dt * x[25 + axis]
        v, v_1, v_2 = x[3 + axis], x[19 + axis], x[22 + axis]
        x[axis] += dt / 12.0 * (23.0 * v - 16.0 * v_1 + 5.0 * v_2)
        x[22 + axis], x[19 + axis] = v_1, v
        x[3 + axis] += dt * (1.5 * x[13 + axis] - 0.5 * x[16 + axis])
        x[16 + axis] = x[13 + axis]
    return 0


@jit_compiled
def _accelerate(x: F64, c: F64) -> Int:
    """Set the compiled body's accelerations by the forces at its state."""
    w, i, j, k = x[6], x[7], x[8], x[9]
    # Rows: north, east and down in body axes.
    nx, ny, nz = 1.0 - 2.0 * (j * j + k * k), 2.0 * (i * j - w * k), 2.0 * (i * k + w * j)
    ex, ey, ez = 2.0 * (i * j + w * k), 1.0 - 2.0 * (i * i + k * k), 2.0 * (j * k - w * i)
    dx, dy, dz = 2.0 * (i * k - w * j), 2.0 * (j * k + w * i), 1.0 - 2.0 * (i * i + j * j)
    p, q, r = x[10], x[11], x[12]
    vn, ve, vd = x[3] - x[31], x[4] - x[32], x[5] - x[33]
    u, v, s = nx * vn + ex * ve + dx * vd, ny * vn + ey * ve + dy * vd, nz * vn + ez * ve + dz * vd
    speed = max(math.sqrt(u * u + v * v + s * s), c[22])
    fx, fy = -(c[19] * speed + c[23]) * u, -(c[20] * speed + c[23]) * v
    fz = -(c[21] * speed + c[23]) * s
    tx, ty, tz = -c[24] * p, -c[24] * q, -c[24] * r
    for motor in range(4):
        thrust = x[34 + motor]
        fz -= thrust
        tx -= c[8 + motor] * thrust
        ty += c[4 + motor] * thrust
        tz += c[12 + motor] * thrust
    x[42] = 0.0
    for leg in range(4):
        lx, ly, lz = c[25 + leg], c[29 + leg], c[37]
        depth = x[2] + dx * lx + dy * ly + dz * lz
        if not depth > 0.0:
            continue
        x[42] += 1.0
        # The leg's velocity: of the body, and of its turning, in body axes; then over the ground.
        bx, by, bz = q * lz - r * ly, r * lx - p * lz, p * ly - q * lx
        north = x[3] + nx * bx + ny * by + nz * bz
        east = x[4] + ex * bx + ey * by + ez * bz
        normal = max(c[33] * depth + c[34] * (x[5] + dx * bx + dy * by + dz * bz), 0.0)
        slip = math.hypot(north, east)
        drag = c[35] if slip * c[35] <= _FRICTION * normal else _FRICTION * normal / slip
        gn, ge, gd = -drag * north, -drag * east, -normal
        gx, gy, gz = (
            nx * gn + ex * ge + dx * gd, ny * gn + ey * ge + dy * gd, nz * gn + ez * ge + dz * gd
        )  # fmt: skip
        fx, fy, fz = fx + gx, fy + gy, fz + gz
        tx, ty, tz = tx + ly * gz - lz * gy, ty + lz * gx - lx * gz, tz + lx * gy - ly * gx
    x[28], x[29], x[30] = fx / c[0], fy / c[0], fz / c[0]
    x[13] = nx * x[28] + ny * x[29] + nz * x[30]
    x[14] = ex * x[28] + ey * x[29] + ez * x[30]
    x[15] = dx * x[28] + dy * x[29] + dz * x[30] + c[36]
    x[25] = (tx - (c[3] - c[2]) * q * r) / c[1]
    x[26] = (ty - (c[1] - c[3]) * r * p) / c[2]
    x[27] = (tz - (c[2] - c[1]) * p * q) / c[3]
    return 0
