"""The registration error: where the virtual was drawn against where it belongs, in pixels."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from campaigns.expansion import Options, load_campaign
from campaigns.outside_setups import PoseAccuracy
from orchestrator.run.mixing import Registered
from orchestrator.run.registration import Registrar, registration_error_px, uncertainty_px
from orchestrator.run.setup import RunOrder, RunSetup
from vehicles.pose_history import PoseHistory
from vehicles.readings import CameraReading
from worlds.camera import Intrinsics
from worlds.frames import Pose, Vec3

ROOT = Path(__file__).parents[2]
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


@given(
    st.floats(-0.5, 0.5),
    st.floats(-0.3, 0.3),
    st.floats(0.0, 0.05),
    st.floats(0.0, math.radians(2.0)),
    st.integers(0, 2**32 - 1),
)
def test_a_pose_within_one_standard_deviation_is_seen_within_the_bound(
    east: float, down: float, position_m: float, attitude_rad: float, seed: int
) -> None:
    """Whatever the direction of a shift and of a turn, both as large as one deviation."""
    here = Pose((0.0, east, down - 0.5))
    rng = np.random.default_rng(seed)
    shift, axis = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
    half = attitude_rad / 2
    turn = (math.cos(half), *(float(part) * math.sin(half) for part in axis))
    moved = Pose(
        (
            float(shift[0]) * position_m,
            east + float(shift[1]) * position_m,
            down - 0.5 + float(shift[2]) * position_m,
        ),
        turn,
    )
    found = registration_error_px(
        zip(GATE, GATE, strict=True), intrinsics=CAMERA, drawn_from=moved, reference=here
    )
    accuracy = PoseAccuracy(position_m=position_m, attitude_rad=attitude_rad)
    bound_px = uncertainty_px(GATE, intrinsics=CAMERA, camera=here, accuracy=accuracy)
    assert found is not None
    assert found <= bound_px + 1e-6


def test_the_bound_is_as_large_as_it_must_be() -> None:
    """A millimetre at 3 m in the middle of the picture is f / 3000 pixels, three times over."""
    accuracy = PoseAccuracy(position_m=0.001, attitude_rad=0.0)
    middle = [(3.0, 0.0, -0.5)]
    bound_px = uncertainty_px(middle, intrinsics=CAMERA, camera=HERE, accuracy=accuracy)
    assert bound_px == pytest.approx(3 * 0.001 * F_PX / 3.0)
    aside = [(3.0, 9.0, -0.5)]
    assert uncertainty_px(aside, intrinsics=CAMERA, camera=HERE, accuracy=accuracy) == 0.0


class Blind:
    """A station without truth: a vehicle that is not ours."""

    def __init__(self) -> None:
        self.truth = PoseHistory(2.0)
        self.poses = PoseHistory(2.0)
        for k in range(100):
            self.poses.add(k / 100, Pose((0.0, k / 100, -0.5)))


def test_without_a_reference_there_is_a_bound_and_with_one_an_error(tmp_path: Path) -> None:
    campaign = load_campaign(ROOT / "campaigns" / "gate.yaml", Options(modes=("wil",)))
    order = RunOrder(plan=campaign.runs[0], folder=tmp_path, clock="virtual")
    setup = RunSetup.of(order)
    station: Any = Blind()
    (camera,) = setup.vehicle("real").cameras
    registered = Registrar(setup=setup, stations={"real": station}, events={}).of(camera)

    def drawn(t_s: float) -> CameraReading:
        pose = camera.mount.camera_pose(station.poses.at(t_s).pose)
        lens = camera.intrinsics
        image = np.zeros((lens.height_px, lens.width_px, 3), np.uint8)
        return CameraReading(t_s, t_s, 0, "twin", image, lens, camera_pose=pose)

    right, late = registered(drawn(0.5), 0.5), registered(drawn(0.6), 0.5)
    assert right.error_px is None
    assert late.error_px is None
    assert right.bound_px is not None
    assert late.bound_px is not None
    # 2 mm and half a degree, three times: 12 px at this camera; and a tenth of a metre beside it.
    assert 10.0 < right.bound_px < 20.0
    assert 12.0 < late.bound_px - right.bound_px < 20.0
    for k in range(100):
        station.truth.add(k / 100, Pose((0.0, k / 100, -0.5)))
    assert registered(drawn(0.5), 0.5) == Registered(0.0)
    assert registered(replace(drawn(0.5), camera_pose=None), 0.5) == Registered()
