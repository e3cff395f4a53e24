"""Compiled kernels: the body's motion from JSBSim's numbers, its estimate, and samples of it.

A motion array holds position (NED, m), velocity (m/s), Euler angles (rad), body rates (rad/s) and
specific force (body, m/s2), three values each, as `Motion` does.

A body array holds all that a step of a vehicle reads and sets (views of it: RAW and on), so that
Python passes one array to the kernel: each takes as long as the arithmetic of a step.
"""

import math
from collections.abc import Callable

from wil_campaign.worlds.jit import F64, Float, Int, jit_compiled, jit_inlined

NUMBERS = 15
RAW, ZERO, TRUTH, ERRORS, ESTIMATE, LAW = (
    slice(0, 15), slice(15, 18), slice(18, 33), slice(33, 42), slice(42, 57), slice(57, 168)
)  # fmt: skip
"""Places in a body array: the plant's numbers, its origin, the true motion, the estimate's errors
(of position, velocity, angles), the estimate's motion array, the array of the control law."""
BODY_NUMBERS = 168
FINITE, NEAR_GROUND, WRECKED, FLOWN = 1, 2, 4, 8
"""Bits of the result of `read`, and of a law's `advance`: the law was run."""
NO_LAW = -1
"""In place of the law's `outer` steps: it is not run."""
Advance = Callable[[F64, F64, int, int], int]
"""`read_and_estimate_motion`, or the kernel of a law that runs the law after it."""

_METRES_PER_FOOT = 0.3048
_NEAR_M = 0.5
"""Above this height over the start no leg can touch the flat ground, even upside down."""
_WRECK_HEIGHT_M = 0.15
"""Half the body's width: tilted far over below this height, a propeller strikes the ground."""
_WRECK_COSINE = 0.5


@jit_inlined
def _wrap(angle_rad: Float) -> Float:
    """Return an angle wrapped to [-pi, pi)."""
    return (angle_rad + math.pi) % (2.0 * math.pi) - math.pi


@jit_compiled
def read_plant_motion(raw: F64, zero: F64, out: F64) -> Int:
    """Set a motion array from JSBSim's numbers (feet, up); return its bits, 0 if not finite.

    WRECKED: it lies on the ground, tilted far over, and is set to rest: its legs do not carry it.
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
    if height_m < _NEAR_M:
        bits |= NEAR_GROUND
    if height_m < _WRECK_HEIGHT_M and math.cos(out[6]) * math.cos(out[7]) < _WRECK_COSINE:
        bits |= WRECKED
        for i in range(3):
            out[3 + i] = 0.0
            out[9 + i] = 0.0
    return bits


@jit_compiled
def estimate_motion(truth: F64, errors: F64, late: F64, step: int, out: F64) -> Int:
    """Set the estimate's motion array: position and velocity delayed, errors on all but rates.

    errors: of position, velocity, angles. late: a ring buffer of positions and velocities (n, 6),
    as long as the delay; step: the number of earlier calls.
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


@jit_compiled
def read_and_estimate_motion(body: F64, late: F64, step: int, outer: int) -> Int:  # noqa: ARG001
    """Call `read`, then `estimate`, on a body array that no law flies: `outer` is not used."""
    truth = body[18:33]
    bits = read_plant_motion(body[0:15], body[15:18], truth)
    if bits != 0:
        estimate_motion(truth, body[33:42], late, step, body[42:57])
    return bits
