"""The kernel that places objects in a view does what the matrices say."""

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from wil_campaign.worlds.frames import Quat, matrix_from_quat, quat_from_euler
from wil_campaign.worlds.render.arrays import ViewArrays
from wil_campaign.worlds.render.placing import NEAR_M, place_objects

OPTICAL_FROM_FRD = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
LIGHTS_NED = np.array([[-0.5, 0.3, -0.81], [0.0, 0.0, -1.0]])
ANGLES = st.tuples(*(st.floats(-math.pi, math.pi) for _ in range(3)))
PLACES = st.tuples(*(st.floats(-20.0, 20.0) for _ in range(3)))
FX, FY, CX, CY, WIDTH, HEIGHT = 60.0, 80.0, 33.0, 22.0, 64, 48


def placed(
    q_wxyz: Quat, at: tuple[float, ...], turns: np.ndarray, places: np.ndarray
) -> ViewArrays:
    """Return the view of three closed unit spheres around a place of their own frames."""
    count = len(places)
    view = ViewArrays(
        rotations=np.empty((count, 3, 3)),
        shifts=np.empty((count, 3)),
        lights=np.empty((count, 2, 3)),
        up=np.empty(3),
        shown=np.empty(count, np.uint8),
        one_sided=np.ones(count, np.uint8),
        fx=FX,
        fy=FY,
        cx=CX,
        cy=CY,
        width=WIDTH,
        height=HEIGHT,
    )
    place_objects(q_wxyz, at, turns, places, np.tile([0.5, 0.0, -0.5, 1.0], (count, 1)), view)
    return view


@settings(max_examples=60, deadline=None)
@given(ANGLES, PLACES, st.lists(st.tuples(ANGLES, PLACES), min_size=3, max_size=3))
def test_objects_are_placed_as_the_matrices_say(
    angles: tuple[float, ...],
    at: tuple[float, ...],
    objects: list[tuple[tuple[float, ...], tuple[float, ...]]],
) -> None:
    q_wxyz = quat_from_euler(*angles)
    turns = np.array([matrix_from_quat(quat_from_euler(*turn)) for turn, _ in objects])
    places = np.array([place for _, place in objects])
    view = placed(q_wxyz, at, turns, places)
    optical = OPTICAL_FROM_FRD @ matrix_from_quat(q_wxyz).T
    np.testing.assert_allclose(view.rotations, optical @ turns, atol=1e-12)
    np.testing.assert_allclose(view.shifts, (places - np.array(at)) @ optical.T, atol=1e-12)
    np.testing.assert_allclose(view.lights, LIGHTS_NED @ turns, atol=1e-12)
    np.testing.assert_allclose(view.up, optical @ [0.0, 0.0, -1.0], atol=1e-12)
    centers = view.rotations @ [0.5, 0.0, -0.5] + view.shifts
    # Distances from the planes of near and of the image's four sides; within a hair either counts.
    inward = np.array(
        [
            [FX, 0.0, CX + 0.5],
            [-FX, 0.0, WIDTH - 0.5 - CX],
            [0.0, FY, CY + 0.5],
            [0.0, -FY, HEIGHT - 0.5 - CY],
        ]
    )
    inward /= np.linalg.norm(inward, axis=1, keepdims=True)
    outside_m = np.minimum((centers @ inward.T).min(axis=1), centers[:, 2] - NEAR_M) + 1.0
    clear = np.abs(outside_m) > 1e-9
    assert (view.shown[clear] == (outside_m > 0.0)[clear]).all()
    free_m = np.linalg.norm(centers, axis=1) - 1.0 - 2.0 * NEAR_M
    clear = np.abs(free_m) > 1e-9
    assert (view.one_sided[clear] == (free_m > 0.0)[clear]).all()
