"""The body's motion from JSBSim's numbers, and the estimate of it, compiled.

A motion array holds position (NED, m), velocity (m/s), Euler angles (rad), body rates (rad/s) and
specific force (body, m/s2), three values each, as `Motion` does.
"""

import math

from worlds.jit import F64, Float, Int, compiled, inlined

NUMBERS = 15
FINITE, NEAR_GROUND, WRECKED = 1, 2, 4
"""Bits of what `read` returns."""

_METRES_PER_FOOT = 0.3048


@inlined
def _wrap(angle_rad: Float) -> Float:
    """Return an angle wrapped to [-pi, pi)."""
    return (angle_rad + math.pi) % (2.0 * math.pi) - math.pi


@compiled
def read(raw: F64, zero: F64, near_m: float, wreck_m: float, wreck_cosine: float, out: F64) -> Int:
    """Set a motion array from JSBSim's numbers (feet, up); return the bits of what holds.

    near_m: below this height the ground is near. wreck_m, wreck_cosine: lower than this and tilted
    so far that the cosine is smaller, the body lies on the ground.
    """
    for i in range(NUMBERS):
        if not math.isfinite(raw[i]):
            return 0
    for i in range(3):
        out[i] = raw[i] * _METRES_PER_FOOT - zero[i]
        out[3 + i] = raw[3 + i] * _METRES_PER_FOOT
        out[6 + i] = raw[6 + i]
        out[9 + i] = raw[9 + i]
        out[12 + i] = raw[12 + i] * _METRES_PER_FOOT
    out[2] = -raw[2] * _METRES_PER_FOOT - zero[2]
    out[8] = _wrap(raw[8])
    bits, height_m = FINITE, -out[2]
    if height_m < near_m:
        bits |= NEAR_GROUND
    if height_m < wreck_m and math.cos(out[6]) * math.cos(out[7]) < wreck_cosine:
        bits |= WRECKED
    return bits


@compiled
def estimate(truth: F64, errors: F64, late: F64, step: int, out: F64) -> Int:
    """Set the estimate's motion array: position and velocity late, all but rates with errors.

    errors: of position, velocity, angles. late: a ring of positions and velocities (n, 6), as long
    as the delay; step: how many were taken before this one.
    """
    slots = late.shape[0]
    here = step % slots
    for i in range(6):
        late[here, i] = truth[i]
    oldest = 0 if step < slots else (step + 1) % slots
    for i in range(6):
        out[i] = late[oldest, i] + errors[i]
    for i in range(6, 9):
        out[i] = truth[i] + errors[i]
    out[8] = _wrap(out[8])
    for i in range(9, NUMBERS):
        out[i] = truth[i]
    return 0
