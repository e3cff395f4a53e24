"""Obstacle avoidance climbs away from a box that grows, in time, and from no other."""

import math
from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pytest

from tests.campaigns.autonomies.point_mass import (
    BLANK,
    CAMERA,
    Corners,
    Flight,
    GeometryFinder,
    fly,
)
from wil_campaign.campaigns.autonomies.avoid import AvoidAutonomy, line_slope
from wil_campaign.plugins.detector.detector import Detection
from wil_campaign.vehicles.autonomy import Telemetry
from wil_campaign.vehicles.readings import CameraReading
from wil_campaign.worlds.frames import Pose, Vec3

START_S = 4.0
STANDS = {
    7: """\
57x19 58x20 59x21 59x21 61x21 61x22 61x21 61x20 62x22 62x22 55x20 54x20 57x22 53x20 54x21 54x22
51x24 56x23 58x23 56x21 59x20 58x20 64x22 67x23 68x24 71x26 75x28 81x30 79x30 79x30 79x30
""",
    10: """\
60x20 60x20 59x19 60x19 60x18 60x18 63x18 62x17 65x19 63x19 64x18 64x18 64x17 64x17 64x17 63x17
63x16 62x20 66x24 66x28 70x27 70x30 75x32 69x31 69x38 69x39 66x33 67x42 68x41 70x37 70x27
""",
    13: """\
64x19 64x22 62x19 61x17 63x16 62x14 60x15 61x16 58x15 63x19 63x19 64x20 69x25 70x26 72x28 68x33
69x33 70x33 66x28 70x32 74x38 80x34 - 78x32 75x27 79x39 74x26 71x21
""",
    38: """\
61x16 61x16 62x17 64x18 63x18 63x18 63x18 63x18 63x18 63x18 63x18 62x18 61x18 65x20 66x22 67x23
71x25 73x27 72x28 72x28 72x28 69x27 71x31 - 74x39 78x35 77x29 - 79x35 75x29 74x21
""",
}
"""Boxes of the shipped detector, width x height in pixels, one for each image (15 a second).

Of flights of avoid.yaml, mode sim, seed 1, by repetition; the other drone stands on the floor."""
COMES = """\
60x9 67x13 68x12 67x12 67x12 68x12 68x12 68x12 68x12 70x12 70x12 69x12 69x12 69x12 69x12 69x12
68x11 69x12 70x12 78x14 77x14 79x15 82x15 82x16 81x15 78x15 81x14 81x13 83x12 86x13 88x14 82x15
85x17 101x18 103x17 96x17 100x17 102x16 107x17 110x17 104x19 114x20 114x19 115x20 117x20 116x20
113x19 121x19 136x24 147x21 145x22 145x24 163x25 170x25 177x26 171x27 213x30 250x32 192x35
"""
"""The same of repetition 40, in which it comes and is there 8.7 s after the goal. From 3.5 s on."""


def drone_at(place: Callable[[float], Vec3]) -> Corners:
    def corners(t_s: float) -> list[Vec3]:
        north, east, down = place(t_s)
        return [(north, east + side, down + low) for side in (-0.15, 0.15) for low in (-0.03, 0.05)]

    return corners


def coming(speed_m_s: float) -> Callable[[float], Vec3]:
    return lambda t_s: (2.5 - speed_m_s * max(0.0, t_s - START_S), 0.0, -1.2)


def avoid(place: Callable[[float], Vec3], noise_px: float = 1.0, **parameters: object) -> Flight:
    autonomy = AvoidAutonomy(goal={"altitude_m": 1.2}, parameters=parameters, seed=1)
    finder = GeometryFinder(drone_at(place), noise_px=noise_px)
    autonomy._finder = finder  # type: ignore[assignment]  # stands in for a detector
    return fly(autonomy, finder, 15.0)


@pytest.mark.parametrize("speed_m_s", [0.5, 1.0])
def test_it_climbs_above_an_intruder_before_that_arrives(speed_m_s: float) -> None:
    flight = avoid(coming(speed_m_s))
    there_s = START_S + (2.5 - 0.3) / speed_m_s
    up_m = [-place[2] for t_s, place in flight.path if t_s >= there_s]
    assert min(up_m) > 1.2 + 0.2
    before = [-place[2] for t_s, place in flight.path if t_s <= START_S]
    assert max(before) < 1.25
    assert max(up_m) == pytest.approx(1.8, abs=0.1)
    assert flight.commands[-1].done


def test_a_slower_approach_is_evaded_nearer() -> None:
    at_s = {
        speed: next(t for (t, _), note in zip(f.path, f.notes(), strict=True) if note == "evade")
        for speed in (0.5, 1.0)
        for f in (avoid(coming(speed), 0.0),)
    }
    away_m = {speed: 2.5 - speed * (t - START_S) for speed, t in at_s.items()}
    assert away_m[0.5] < away_m[1.0]


@pytest.mark.parametrize(
    "place",
    [
        lambda _: (2.5, 0.0, -1.2),
        lambda t_s: (2.5 + 0.15 * t_s, 0.0, -1.2),
        lambda t_s: (2.5, 0.9 * math.sin(t_s), -1.2),
        lambda t_s: (2.5, 0.0, -min(0.1 + 0.3 * t_s, 1.2)),
    ],
    ids=["hovers", "leaves", "passes", "climbs"],
)
def test_it_evades_nothing_that_comes_no_nearer(place: Callable[[float], Vec3]) -> None:
    flight = avoid(place)
    assert set(flight.notes()) == {"watch"}
    assert all(math.dist(at, (0.0, 0.0, -1.2)) < 0.05 for _, at in flight.path)


def test_boxes_that_jump_are_no_approach() -> None:
    rises = drone_at(lambda t_s: (2.5, 0.0, -min(0.1 + 0.3 * t_s, 1.2)))
    boxes = {}
    for standard_errors in (0, 2):
        autonomy = AvoidAutonomy(
            goal={"altitude_m": 1.2}, parameters={"standard_errors": standard_errors}, seed=1
        )
        finder = GeometryFinder(rises, noise_px=8.0)
        autonomy._finder = finder  # type: ignore[assignment]  # stands in for a detector
        boxes[standard_errors] = set(fly(autonomy, finder, 15.0).notes())
    assert boxes == {0: {"watch", "evade"}, 2: {"watch"}}


def evades_at(boxes: str, begin_s: float, score: float = 0.7) -> float | None:
    """Return when the autonomy evades by boxes; None where it does not."""
    autonomy = AvoidAutonomy(goal={"altitude_m": 1.2}, parameters={}, seed=1)
    found: list[Detection | None] = []
    autonomy._finder = SimpleNamespace(find=lambda _: found[-1])  # type: ignore[assignment]
    for k, box in enumerate(boxes.split()):
        t_s = begin_s + k / 15.0
        if autonomy.act(Telemetry(t_s, Pose((0.0, 0.0, -1.2)), (0.0, 0.0, 0.0))).note == "evade":
            return t_s
        width, _, height = box.partition("x")
        found.append(None)
        if height:
            sides = float(width), float(height)
            found.append(Detection("quadrotor", score, 0.0, 0.0, *sides))
        autonomy.perceive(CameraReading(t_s, t_s, 0, "mixed", BLANK, CAMERA))
    return None


@pytest.mark.parametrize("repetition", STANDS)
def test_boxes_of_a_drone_that_stands_are_no_approach(repetition: int) -> None:
    assert evades_at(STANDS[repetition], -0.7) is None


def test_boxes_of_a_drone_that_comes_are_one_in_time() -> None:
    """A climb takes 1.2 s."""
    at_s = evades_at(COMES, 3.5)
    assert at_s is not None
    assert 5.0 < at_s < 7.4
    assert evades_at(COMES, 3.5, score=0.6) is None, "the detector is too unsure of their sides"


def test_the_slope_of_a_line() -> None:
    slope, error = line_slope(((0.0, 1.0), (1.0, 3.0), (2.0, 5.0)))
    assert slope == pytest.approx(2.0)
    assert error == pytest.approx(0.0, abs=1e-12)
    assert line_slope(((1.0, 1.0), (1.0, 9.0))) == (0.0, 0.0)
    x, y = np.arange(8.0), np.array([1.0, 3.1, 4.9, 7.2, 8.8, 11.0, 13.3, 14.9])
    _, covariance = np.polyfit(x, y, 1, cov=True)
    _, error = line_slope(tuple(zip(x.tolist(), y.tolist(), strict=True)))
    assert error == pytest.approx(math.sqrt(covariance[0][0]))


def test_wrong_parameters_are_refused() -> None:
    with pytest.raises(ValueError, match="growth_per_s must be greater than 0"):
        AvoidAutonomy(goal={"altitude_m": 1.2}, parameters={"growth_per_s": 0}, seed=1)
