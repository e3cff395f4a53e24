"""Where the objects of a scene are in a camera's view, and which of them can show."""

import numpy as np

from wil_campaign.worlds.jit import F64, Float, Int, jit_compiled, jit_inlined
from wil_campaign.worlds.render.arrays import ViewArrays

NEAR_M = 0.05
"""Nearer than this to the image plane nothing is drawn."""
Numbers = tuple[Float, ...]


@jit_inlined
def write_object_visibility(view: ViewArrays, spheres: F64, k: Int) -> None:
    """Write whether object k may be in view, and whether its backs are hidden.

    They are where it is closed, as one_sided says before, and surely does not contain the camera.
    """
    radius_m = spheres[k, 3]
    m, shift = view.rotations[k], view.shifts[k]
    a, b, c = spheres[k, 0], spheres[k, 1], spheres[k, 2]
    x = m[0, 0] * a + m[0, 1] * b + m[0, 2] * c + shift[0]
    y = m[1, 0] * a + m[1, 1] * b + m[1, 2] * c + shift[1]
    z = m[2, 0] * a + m[2, 1] * b + m[2, 2] * c + shift[2]
    left, right = view.cx + 0.5, view.width - 0.5 - view.cx
    above, below = view.cy + 0.5, view.height - 0.5 - view.cy
    is_shown = (
        z + radius_m > NEAR_M
        and (view.fx * x + left * z) / np.hypot(view.fx, left) > -radius_m
        and (right * z - view.fx * x) / np.hypot(view.fx, right) > -radius_m
        and (view.fy * y + above * z) / np.hypot(view.fy, above) > -radius_m
        and (below * z - view.fy * y) / np.hypot(view.fy, below) > -radius_m
    )
    view.shown[k] = 1 if is_shown else 0
    if np.sqrt(x * x + y * y + z * z) <= radius_m + 2.0 * NEAR_M:
        view.one_sided[k] = 0


@jit_compiled
def place_objects(
    q_wxyz: Numbers,
    at_ned_m: Numbers,
    rotations: F64,
    positions_m: F64,
    spheres: F64,
    view: ViewArrays,
) -> None:
    """Write the arrays of a camera's view; one_sided holds 1 for what is closed, and stays or is 0.

    q_wxyz, at_ned_m: the camera's pose in the world, FRD axes. rotations: (objects, 3, 3) to NED,
    positions_m: (objects, 3). spheres: as of the geometry.
    """
    w, x, y, z = q_wxyz
    # From NED to optical axes: the transpose of the camera's matrix, its rows in another order.
    turn = np.empty((3, 3))
    turn[2, 0], turn[2, 1] = 1 - 2 * (y * y + z * z), 2 * (x * y + w * z)
    turn[2, 2], turn[0, 0] = 2 * (x * z - w * y), 2 * (x * y - w * z)
    turn[0, 1], turn[0, 2] = 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)
    turn[1, 0], turn[1, 1] = 2 * (x * z + w * y), 2 * (y * z - w * x)
    turn[1, 2] = 1 - 2 * (x * x + y * y)
    for i in range(3):
        view.up[i] = -turn[i, 2]
    for k in range(len(positions_m)):
        north = positions_m[k, 0] - at_ned_m[0]
        east = positions_m[k, 1] - at_ned_m[1]
        down = positions_m[k, 2] - at_ned_m[2]
        for i in range(3):
            view.shifts[k, i] = turn[i, 0] * north + turn[i, 1] * east + turn[i, 2] * down
            a, b, c = rotations[k, 0, i], rotations[k, 1, i], rotations[k, 2, i]
            for j in range(3):
                view.rotations[k, j, i] = turn[j, 0] * a + turn[j, 1] * b + turn[j, 2] * c
            # Towards the lamp, and upwards.
            view.lights[k, 0, i] = -0.5 * a + 0.3 * b - 0.81 * c
            view.lights[k, 1, i] = -c
        write_object_visibility(view, spheres, k)
