"""The registration error: where the virtual was drawn against where it belongs, in pixels."""

import math
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wil_campaign.campaigns.expansion.expansion import ExpansionOptions, load_campaign
from wil_campaign.campaigns.setup.vehicle_setups import VehicleLink
from wil_campaign.campaigns.values.external_setups import PoseAccuracy, PoseSource, SourceSetup
from wil_campaign.campaigns.values.sensor_setups import CameraSetup
from wil_campaign.orchestrator.run.perception.mixing_loop import Registration, RegistrationError
from wil_campaign.orchestrator.run.perception.registration_error import (
    Registrar,
    registration_error_px,
    seen_points,
    uncertainty_px,
)
from wil_campaign.orchestrator.state.run_setup import RunOrder, RunSetup
from wil_campaign.vehicles.driver.estimate_accuracy import ReportedAccuracy
from wil_campaign.vehicles.links.link_strings import parse_link
from wil_campaign.vehicles.poses.pose_history import PoseHistory
from wil_campaign.vehicles.readings import CameraReading
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose, Vec3

ROOT = Path(__file__).parents[4]
CAMERA = Intrinsics.from_fov(640, 480, math.radians(69.0))
F_PX = CAMERA.fx_px
GATE: tuple[Vec3, ...] = ((3.0, -0.5, -1.0), (3.0, 0.5, -1.0), (3.0, 0.5, 0.0), (3.0, -0.5, 0.0))
HERE = Pose((0.0, 0.0, -0.5))
LINK = parse_link("udpin://0.0.0.0:14540")


def error_px(drawn_from: Pose, *, moved_m: float = 0.0, things: tuple[Vec3, ...] = GATE) -> float:
    now = [(north, east + moved_m, down) for north, east, down in things]
    found = registration_error_px(
        seen_points(
            zip(things, now, strict=True), intrinsics=CAMERA, drawn_from=drawn_from, reference=HERE
        )
    )
    assert found is not None
    return found


def test_an_image_from_the_right_place_has_no_registration_error() -> None:
    assert error_px(HERE) == 0.0


@pytest.mark.parametrize("aside_m", [0.001, 0.01, 0.1])
def test_a_step_aside_is_seen_by_similar_triangles(aside_m: float) -> None:
    found = error_px(Pose((0.0, aside_m, -0.5)))
    assert found == pytest.approx(aside_m * F_PX / 3.0, rel=1e-6)


def test_a_thing_that_moved_since_it_was_drawn_counts() -> None:
    """The camera stood right, but the picture is of another moment."""
    assert error_px(HERE, moved_m=0.1) == pytest.approx(0.1 * F_PX / 3.0, rel=1e-6)


def test_points_that_neither_camera_sees_do_not_count() -> None:
    behind = (-3.0, 0.0, -0.5)
    aside = (3.0, 9.0, -0.5)
    here = Pose((0.0, 0.01, -0.5))
    assert error_px(here, things=(*GATE, behind, aside)) == pytest.approx(error_px(here))
    found = registration_error_px(
        seen_points(
            [(behind, behind), (aside, aside)], intrinsics=CAMERA, drawn_from=here, reference=HERE
        )
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
    x, y, z = (float(part) * math.sin(half) for part in axis)
    turn = (math.cos(half), x, y, z)
    moved = Pose(
        (
            float(shift[0]) * position_m,
            east + float(shift[1]) * position_m,
            down - 0.5 + float(shift[2]) * position_m,
        ),
        turn,
    )
    found = registration_error_px(
        seen_points(
            zip(GATE, GATE, strict=True), intrinsics=CAMERA, drawn_from=moved, reference=here
        )
    )
    accuracy = PoseAccuracy(position_m=position_m, attitude_rad=attitude_rad)
    bound_px = uncertainty_px(GATE, intrinsics=CAMERA, camera=here, accuracy=accuracy)
    assert found is not None
    assert found <= bound_px + 1e-6


def test_the_bound_is_three_standard_deviations_in_pixels() -> None:
    """A millimetre at 3 m in the middle of the picture is f / 3000 pixels, three times over."""
    accuracy = PoseAccuracy(position_m=0.001, attitude_rad=0.0)
    middle = [(3.0, 0.0, -0.5)]
    bound_px = uncertainty_px(middle, intrinsics=CAMERA, camera=HERE, accuracy=accuracy)
    assert bound_px == pytest.approx(3 * 0.001 * F_PX / 3.0)
    assert uncertainty_px([], intrinsics=CAMERA, camera=HERE, accuracy=accuracy) == 0.0


class Blind:
    """A station without truth: a vehicle that is not ours."""

    def __init__(self) -> None:
        self.truth = PoseHistory(2.0)
        self.poses = PoseHistory(2.0)
        for k in range(100):
            self.poses.add(k / 100, Pose((0.0, k / 100, -0.5)))


@dataclass
class Scene:
    """A registrar over the gate campaign, with vehicles of which nobody knows the truth."""

    setup: RunSetup
    real: Any
    twin: Any

    def registration(self, source: SourceSetup | None = None) -> Registration:
        """Return the registration of the camera; source: where its real pictures come from."""
        contexts = {"real": self.real, "twin": self.twin}
        registrar = Registrar(setup=self.setup, contexts=contexts, events={})
        return registrar.of(replace(self.camera, source=source))

    @property
    def camera(self) -> CameraSetup:
        (camera,) = self.setup.vehicle("real").cameras
        return camera

    def drawn(self, t_s: float) -> CameraReading:
        """Return a twin's picture, drawn from where the real vehicle was."""
        lens = self.camera.intrinsics
        image = np.zeros((lens.height_px, lens.width_px, 3), np.uint8)
        pose = self.camera.mount.camera_pose(self.real.poses.at(t_s).pose)
        return CameraReading(t_s, t_s, 0, "twin", image, lens, camera_pose=pose)


@pytest.fixture
def scene(tmp_path: Path) -> Scene:
    campaign = load_campaign(ROOT / "campaigns" / "gate.yaml", ExpansionOptions(modes=("wil",)))
    order = RunOrder(plan=campaign.runs[0], folder=tmp_path, clock="virtual")
    return Scene(RunSetup.of(order), Blind(), Blind())


def within(found: RegistrationError) -> float:
    assert found.error_px is None
    assert found.bound_px is not None
    return found.bound_px


def test_without_a_reference_there_is_a_bound_and_with_one_an_error(scene: Scene) -> None:
    registered = scene.registration()
    right, late = (within(registered(scene.drawn(t_s), 0.5)) for t_s in (0.5, 0.6))
    # 2 mm and half a degree, three times: 12 px at this camera; and a tenth of a metre beside it.
    assert 10.0 < right < 20.0
    assert 12.0 < late - right < 20.0
    for k in range(100):
        scene.real.truth.add(k / 100, Pose((0.0, k / 100, -0.5)))
    assert registered(scene.drawn(0.5), 0.5) == RegistrationError(0.0)
    assert registered(replace(scene.drawn(0.5), camera_pose=None), 0.5) == RegistrationError()


def test_what_is_drawn_into_the_image_although_it_is_beside_it_has_a_bound_too(
    scene: Scene,
) -> None:
    scene.real.poses = PoseHistory(2.0)
    for k in range(100):  # nothing virtual is in view of the place at half a second
        yaw_rad = math.radians(80.0) * (1.0 - abs(k - 50) / 50)
        scene.real.poses.add(k / 100, Pose.of(0.0, 0.0, 0.5, yaw_rad=yaw_rad))
    found = scene.registration()(scene.drawn(0.6), 0.5)
    seen = within(found)
    scene.real.truth = scene.real.poses
    error_px = scene.registration()(scene.drawn(0.6), 0.5).error_px
    assert error_px is not None
    assert seen > error_px + 10.0


def test_the_truth_of_a_vehicle_is_no_reference_for_images_from_outside(scene: Scene) -> None:
    for k in range(100):
        scene.real.truth.add(k / 100, Pose((0.0, k / 100, -0.5)))
    live = scene.registration(SourceSetup(kind="rtp", address="rtp://127.0.0.1:5600"))
    assert within(live(scene.drawn(0.5), 0.5)) > 10.0
    file = scene.registration(SourceSetup(kind="video", address="flight.mp4"))
    assert file(scene.drawn(0.5), 0.5) == RegistrationError()


def test_a_live_picture_of_the_twin_is_of_the_twins_own_place(scene: Scene) -> None:
    twin = scene.setup.vehicle("twin")
    source = SourceSetup(kind="rtp", address="rtp://127.0.0.1:5602")
    seeing = replace(twin, sensors=(replace(twin.cameras[0], source=source),))
    others = tuple(vehicle for vehicle in scene.setup.vehicles if vehicle.name != "twin")
    scene.setup = replace(scene.setup, vehicles=(*others, seeing))
    picture = replace(scene.drawn(0.5), camera_pose=None)
    beside = within(scene.registration()(picture, 0.5))
    scene.twin.poses = PoseHistory(2.0)
    for k in range(100):
        scene.twin.poses.add(k / 100, Pose((0.0, k / 100 + 0.3, -0.5)))
    assert 40.0 < within(scene.registration()(picture, 0.5)) - beside < 60.0
    scene.twin.poses = turning(0.42)
    late_px = within(scene.registration()(picture, 0.5))
    scene.twin.poses = turning(1.0)
    assert late_px > within(scene.registration()(picture, 0.5)) + 30.0
    scene.twin.poses = PoseHistory(2.0)
    found = scene.registration()(picture, 0.5)
    assert found == RegistrationError(unbounded="twin has no pose near the exposure")


@pytest.mark.parametrize(
    ("pose_source", "link", "has_reference"),
    [
        ("simulator", LINK, False),
        ("mavlink", LINK, True),
        ("simulator", "embedded", True),
    ],
)
def test_a_simulators_ground_truth_is_no_reference_for_what_it_has_drawn_itself(
    scene: Scene, pose_source: PoseSource, link: VehicleLink, has_reference: bool
) -> None:
    for k in range(100):
        scene.real.truth.add(k / 100, Pose((0.0, k / 100, -0.5)))
    given = scene.setup.vehicle("real")
    real = replace(given, pose_source=pose_source, link=link, accuracy_given=True)
    others = tuple(vehicle for vehicle in scene.setup.vehicles if vehicle.name != "real")
    scene.setup = replace(scene.setup, vehicles=(real, *others))
    found = scene.registration()(scene.drawn(0.5), 0.5)
    if has_reference:
        assert found == RegistrationError(0.0)
    else:
        assert within(found) > 10.0


def turning(until_s: float) -> PoseHistory:
    """Return the poses, until a time, of a vehicle that turns by a radian a second."""
    poses = PoseHistory(2.0)
    for k in range(round(until_s * 100) + 1):
        poses.add(k / 100, Pose.of(0.0, 0.0, 0.5, yaw_rad=k / 100 - 0.5))
    return poses


LIVE = SourceSetup(kind="rtp", address="rtp://127.0.0.1:5600")


def test_the_bound_includes_what_the_vehicle_turns_while_its_newest_pose_is_old(
    scene: Scene,
) -> None:
    scene.real.poses = turning(0.5)
    drawn = replace(scene.drawn(0.5), t_s=0.5)
    bound_px = within(scene.registration(LIVE)(drawn, 0.58))
    scene.real.truth = turning(1.0)
    error_px = scene.registration()(drawn, 0.58).error_px
    assert error_px is not None
    assert error_px > 30.0
    assert bound_px > error_px


def test_the_bound_includes_how_well_the_clock_of_the_poses_is_known(scene: Scene) -> None:
    """A live image and a pose that seem to be of one moment may be of two."""
    by_its_estimate(scene, "px4", ReportedAccuracy(0.4, 0.002, 0.001), clock_s=0.05)
    scene.real.poses = turning(0.7)
    bound_px = within(scene.registration(LIVE)(scene.drawn(0.5), 0.5))
    scene.real.truth = turning(1.0)
    error_px = scene.registration()(scene.drawn(0.5), 0.55).error_px
    assert error_px is not None
    assert error_px > 20.0
    assert bound_px > error_px


def test_an_image_within_a_gap_of_the_poses_has_no_bound(scene: Scene) -> None:
    """An image drawn by `hold` is shown although nobody knows where the vehicle was."""
    drawn = scene.drawn(0.9)
    scene.real.poses.add(2.0, Pose((0.0, 2.0, -0.5)))
    found = scene.registration()(drawn, 1.2)
    assert (found.error_px, found.bound_px) == (None, None)
    assert found.unbounded == "real has no pose near the exposure"


class Driven:
    """The part of a driver that says who flies, and how exact its estimator takes itself for."""

    def __init__(
        self, autopilot: str, newest: ReportedAccuracy | None, clock_s: float = 0.0
    ) -> None:
        self.clock = SimpleNamespace(uncertainty_s=clock_s)
        self.identity = SimpleNamespace(autopilot=autopilot)
        self.accuracy = SimpleNamespace(newest=newest)


def by_its_estimate(
    scene: Scene, autopilot: str, newest: ReportedAccuracy | None, clock_s: float = 0.0
) -> None:
    """Judge the real vehicle by its estimate, whose accuracy the campaign does not state."""
    real = replace(scene.setup.vehicle("real"), pose_source="mavlink", accuracy_given=False)
    others = tuple(vehicle for vehicle in scene.setup.vehicles if vehicle.name != "real")
    scene.setup = replace(scene.setup, vehicles=(real, *others))
    scene.real.driver = Driven(autopilot, newest, clock_s)


def test_an_estimate_is_bounded_by_the_covariance_that_it_reports(scene: Scene) -> None:
    exact, vague = ReportedAccuracy(0.1, 0.02, 0.005), ReportedAccuracy(0.1, 0.2, 0.05)
    by_its_estimate(scene, "px4", exact)
    few = within(scene.registration()(scene.drawn(0.5), 0.5))
    by_its_estimate(scene, "px4", vague)
    assert within(scene.registration()(scene.drawn(0.5), 0.5)) == pytest.approx(10.0 * few)


@pytest.mark.parametrize(
    ("autopilot", "newest", "said"),
    [
        ("ardupilot", None, "ArduCopter reports no accuracy of its estimate in metres"),
        ("px4", None, "no covariance came in PX4's ODOMETRY"),
        ("px4", ReportedAccuracy(-3.0, 0.02, 0.005), "no covariance came in PX4's ODOMETRY"),
    ],
)
def test_an_estimate_without_a_covariance_has_no_bound_but_a_reason(
    scene: Scene, autopilot: str, newest: ReportedAccuracy | None, said: str
) -> None:
    by_its_estimate(scene, autopilot, newest)
    found = scene.registration()(scene.drawn(0.5), 0.5)
    assert (found.error_px, found.bound_px) == (None, None)
    assert found.unbounded.startswith(said)
    assert "state pose_accuracy" in found.unbounded


def test_an_accuracy_that_the_campaign_states_is_used(scene: Scene) -> None:
    by_its_estimate(scene, "ardupilot", None)
    real = replace(scene.setup.vehicle("real"), accuracy_given=True)
    others = tuple(vehicle for vehicle in scene.setup.vehicles if vehicle.name != "real")
    scene.setup = replace(scene.setup, vehicles=(real, *others))
    assert within(scene.registration()(scene.drawn(0.5), 0.5)) > 0.0
