"""Person following keeps a box in front, at the distance that its area tells, and holds without."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.campaigns.autonomies.point_mass import Corners, Flight, GeometryFinder, fly
from tests.vehicles.tiny_onnx import INPUT_PX, tiny_detector
from wil_campaign.api import CameraReading, DetectorError, Intrinsics
from wil_campaign.campaigns.autonomies.box_flight import BoxFlightParameters
from wil_campaign.campaigns.autonomies.follow import FollowAutonomy
from wil_campaign.worlds.frames import Vec3


def person_at(east_m: Any, north_m: float = 3.5, width_m: float = 0.46) -> Corners:
    def corners(t_s: float) -> list[Vec3]:
        middle_m = east_m(t_s)
        half_m = width_m / 2.0
        return [
            (north_m, middle_m + side, down) for side in (-half_m, half_m) for down in (0, -1.75)
        ]

    return corners


def aside_and_back(t_s: float) -> float:
    if t_s < 2.0:
        return 0.0
    return max(0.0, 1.5 - abs(1.5 - 1.4 * (t_s - 2.0)))


def follow(finder: GeometryFinder, **parameters: object) -> Flight:
    autonomy = FollowAutonomy(goal={"altitude_m": 1.2}, parameters=parameters, seed=1)
    autonomy._finder = finder  # type: ignore[assignment]  # stands in for a detector
    return fly(autonomy, finder, 15.0)


def test_it_moves_aside_with_the_person_and_back_and_keeps_its_distance() -> None:
    flight = follow(GeometryFinder(person_at(aside_and_back), noise_px=2.0))
    east_m = [place[1] for _, place in flight.path]
    assert 0.9 < max(east_m) < 2.0
    assert abs(east_m[-1]) < 0.3
    for t_s, place in flight.path:
        assert 2.25 < math.hypot(3.5 - place[0], aside_and_back(t_s) - place[1]) < 4.25
        assert place[2] == pytest.approx(-1.2, abs=0.1)
    assert flight.commands[-1].done
    assert flight.path[-1][0] == pytest.approx(12.0, abs=0.1)


@pytest.mark.parametrize("north_m", [2.6, 4.2])
def test_the_area_of_the_box_brings_it_to_the_distance(north_m: float) -> None:
    flight = follow(GeometryFinder(person_at(lambda _: 0.0, north_m)))
    assert north_m - flight.path[-1][1][0] == pytest.approx(3.25, abs=0.15)


def test_a_smaller_person_is_taken_for_one_who_is_farther() -> None:
    flight = follow(GeometryFinder(person_at(lambda _: 0.0, width_m=0.3)))
    assert 3.5 - flight.path[-1][1][0] < 3.0


def test_a_lost_person_is_waited_for_at_the_place() -> None:
    flight = follow(GeometryFinder(person_at(aside_and_back), hidden=(2.8, 99.0)))
    late = [place[1] for t_s, place in flight.path if t_s > 6.0]
    assert max(late) - min(late) < 0.1
    assert flight.notes()[-1] == "search"
    assert "follow" in flight.notes()


def test_it_does_not_move_when_it_sees_nobody() -> None:
    flight = follow(GeometryFinder(person_at(aside_and_back), hidden=(0.0, 99.0)))
    assert all(math.dist(place, (0.0, 0.0, -1.2)) < 0.02 for _, place in flight.path)


@pytest.mark.parametrize(
    ("parameters", "said"),
    [
        ({"speed": 1}, "unknown parameter 'speed'"),
        ({"distance_m": 0}, "distance_m must be greater than 0"),
        ({"kp": "fast"}, "kp must be a number"),
        ({"camera_stabilized": 1}, "must be true or false"),
        ({"model": 3}, "model must be a text"),
        ({"model": "some.onnx", "names": "cat, dog"}, "class 'person'"),
        ({"layout": "v6"}, "layout must be one of auto, v5, v8, end2end, is 'v6'"),
    ],
)
def test_wrong_parameters_are_refused(parameters: dict[str, object], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        FollowAutonomy(goal={"altitude_m": 1.2}, parameters=parameters, seed=1)
    with pytest.raises(ValueError, match="altitude_m must be"):
        FollowAutonomy(goal={}, parameters={}, seed=1)


def test_an_own_detector_has_the_given_layout(tmp_path: Path) -> None:
    """Its output for one class is that of two layouts."""
    model = tmp_path / "own.onnx"
    model.write_bytes(tiny_detector("end2end"))
    parameters = {"model": str(model), "names": "person", "input_px": INPUT_PX}
    image = np.zeros((INPUT_PX, INPUT_PX, 3), np.uint8)
    image[: INPUT_PX // 2, : INPUT_PX // 2] = (0, 0, 255)
    own = CameraReading(1.0, 1.1, 0, "mixed", image, Intrinsics.from_fov(INPUT_PX, INPUT_PX, 1.0))
    with pytest.raises(DetectorError, match="state layout: v5 or end2end"):
        BoxFlightParameters(**parameters).finder("person").find(own)  # type: ignore[arg-type]
    given = BoxFlightParameters(**parameters, layout="end2end")  # type: ignore[arg-type]
    box = given.finder("person").find(own)
    assert box is not None
    assert (box.left_px, box.top_px, box.right_px, box.bottom_px) == (0, 0, 16, 16)
