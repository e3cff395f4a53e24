"""The registration error: where the virtual was drawn against where it belongs, in pixels."""

import math

import pytest

from orchestrator.run.registration import registration_error_px
from worlds.camera import Intrinsics
from worlds.frames import Pose, Vec3

CAMERA = Intrinsics.from_fov(640, 480, math.radians(69.0))
F_PX = CAMERA.fx_px
GATE: tuple[Vec3, ...] = ((3.0, -0.5, -1.0), (3.0, 0.5, -1.0), (3.0, 0.5, 0.0), (3.0, -0.5, 0.0))
HERE = Pose((0.0, 0.0, -0.5))


def error_px(drawn_from: Pose, *, moved_m: float = 0.0, things: tuple[Vec3, ...] = GATE) -> float:
    now = [(north, east + moved_m, down) for north, east, down in things]
    found = registration_error_px(
        zip(things, now, strict=True), intrinsics=CAMERA, drawn_from=drawn_from, reference=HERE
    )
    assert found is not None
    return found


def test_from_the_right_place_nothing_is_off() -> None:
    assert error_px(HERE) == 0.0


@pytest.mark.parametrize("aside_m", [0.001, 0.01, 0.1])
def test_a_step_aside_is_seen_by_similar_triangles(aside_m: float) -> None:
    found = error_px(Pose((0.0, aside_m, -0.5)))
    assert found == pytest.approx(aside_m * F_PX / 3.0, rel=1e-6)


def test_a_thing_that_moved_since_it_was_drawn_counts() -> None:
    """The camera stood right, but the picture is of another moment."""
    assert error_px(HERE, moved_m=0.1) == pytest.approx(0.1 * F_PX / 3.0, rel=1e-6)


def test_what_neither_camera_sees_does_not_count() -> None:
    behind = (-3.0, 0.0, -0.5)
    aside = (3.0, 9.0, -0.5)
    here = Pose((0.0, 0.01, -0.5))
    assert error_px(here, things=(*GATE, behind, aside)) == pytest.approx(error_px(here))
    found = registration_error_px(
        [(behind, behind), (aside, aside)], intrinsics=CAMERA, drawn_from=here, reference=HERE
    )
    assert found is None
