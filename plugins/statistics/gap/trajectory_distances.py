"""Distances between two trajectories, metres; pure.

Both are sampled at the same even times, (samples, 3), from the moment the goal was given. Dynamic
time warping: Sakoe and Chiba, IEEE Trans. ASSP 26 (1978), the mean distance along the cheapest
alignment. Discrete Frechet: Eiter and Mannila, CD-TR 94/64 (1994), the longest leash that the best
alignment needs. Both ignore when something was done; the root mean square at equal times does not.
"""

import numpy as np
from numpy.typing import NDArray

from wil_campaign.worlds.jit import F64, jit_compiled

IntArray = NDArray[np.int64]


def time_aligned_rmse_m(one: F64, other: F64) -> float:
    """Return the root mean square distance at equal times; the shorter one stays at its end."""
    longer = max(len(one), len(other))
    apart = _extended(one, longer) - _extended(other, longer)
    return float(np.sqrt(np.mean(np.sum(apart**2, axis=1))))


def dtw_distance_m(one: F64, other: F64) -> float:
    """Return the mean distance along the cheapest alignment."""
    first, second = cheapest_alignment(one, other)
    return float(np.mean(np.linalg.norm(one[first] - other[second], axis=1)))


def cheapest_alignment(one: F64, other: F64) -> tuple[IntArray, IntArray]:
    """Return the cheapest alignment: which samples of both are matched, in order."""
    path = _cheapest_path(np.ascontiguousarray(one), np.ascontiguousarray(other))
    return path[:, 0], path[:, 1]


def frechet_distance_m(one: F64, other: F64) -> float:
    """Return the discrete Frechet distance."""
    return float(_frechet(np.ascontiguousarray(one), np.ascontiguousarray(other)))


def _extended(positions_m: F64, count: int) -> F64:
    """Return positions that stay at their last until there are so many."""
    return np.concatenate([positions_m, np.repeat(positions_m[-1:], count - len(positions_m), 0)])


@jit_compiled
def _cheapest_path(one: F64, other: F64) -> IntArray:
    """Return the pairs (steps, 2) of the alignment with the least sum of distances."""
    rows, columns = one.shape[0], other.shape[0]
    cost = np.full((rows + 1, columns + 1), np.inf)
    cost[0, 0] = 0.0
    for i in range(rows):
        for j in range(columns):
            apart = 0.0
            for axis in range(one.shape[1]):
                apart += (one[i, axis] - other[j, axis]) ** 2
            before = min(cost[i, j], cost[i, j + 1], cost[i + 1, j])
            cost[i + 1, j + 1] = np.sqrt(apart) + before
    path = np.empty((rows + columns, 2), np.int64)
    i, j, count = rows, columns, 0
    while i > 0 and j > 0:
        path[count, 0], path[count, 1] = i - 1, j - 1
        count += 1
        diagonal, up, left = cost[i - 1, j - 1], cost[i - 1, j], cost[i, j - 1]
        if diagonal <= up and diagonal <= left:
            i, j = i - 1, j - 1
        elif up <= left:
            i -= 1
        else:
            j -= 1
    return path[:count][::-1].copy()


@jit_compiled
def _frechet(one: F64, other: F64) -> float:
    """Return the discrete Frechet distance of positions, row by row."""
    rows, columns = one.shape[0], other.shape[0]
    leash = np.full(columns + 1, np.inf)
    leash[0] = 0.0
    for i in range(rows):
        diagonal = leash[0]
        leash[0] = np.inf
        for j in range(columns):
            apart = 0.0
            for axis in range(one.shape[1]):
                apart += (one[i, axis] - other[j, axis]) ** 2
            before = min(diagonal, leash[j + 1], leash[j])
            diagonal = leash[j + 1]
            leash[j + 1] = max(np.sqrt(apart), before)
    return float(leash[columns])
