"""Models of lidars and rangefinders: what the beams meet, and their noise."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.vehicles.sensors.sensor_rigs import HOVER, require_repeatable, rng
from wil_campaign.plugins.lidar.beams import RangeNoise, disturb_hits, grid_directions
from wil_campaign.plugins.lidar.lidar import SCAN_NOISE, SCAN_NOISES, LidarScanSensor
from wil_campaign.plugins.lidar.lidar_points import GridPattern, LidarPointsSensor
from wil_campaign.plugins.lidar.rangefinder import (
    RANGEFINDER_NOISE,
    RANGEFINDER_NOISES,
    RangefinderSensor,
)
from wil_campaign.vehicles.readings.checks import reading_fault, reading_rest_fault
from wil_campaign.vehicles.sensors.beams import Directions, RayHits
from wil_campaign.vehicles.sensors.noise_sets import NoiseSetName
from wil_campaign.vehicles.sensors.truth import Truth
from wil_campaign.worlds.frames import Pose
from wil_campaign.worlds.geodesy import LocalFrame


def box_room(sensor: Pose, directions_frd: Directions, t_s: float) -> RayHits:
    """A floor at down 0 (object 1) and a wall at north 5 m (object 2), nothing else."""
    north, _, down = sensor.position_ned_m
    hits = [sensor.to_parent(tuple(d)) for d in directions_frd.tolist()]
    ranges, ids = [], []
    for n, _, d in hits:
        to_wall = (5.0 - north) / (n - north) if n - north > 1e-9 else math.inf
        to_floor = -down / (d - down) if d - down > 1e-9 else math.inf
        ranges.append(min(to_wall, to_floor))
        ids.append(0 if min(to_wall, to_floor) == math.inf else 1 if to_floor < to_wall else 2)
    return RayHits(np.array(ranges, np.float32), np.array(ids, np.uint8))


def test_a_scan_sees_the_wall_where_it_is() -> None:
    level = Truth(Pose.of(0.0, 0.0, 1.0, yaw_rad=math.pi / 2))  # facing east
    reading = LidarScanSensor(source="twin", cast=box_room).sample(level, 1.0, rng())
    to_the_left = int(np.argmin(np.abs(reading.angles_rad + math.pi / 2)))  # so north
    assert reading.ranges_m[to_the_left] == pytest.approx(5.0, abs=1e-3)
    assert reading.object_ids is not None
    assert reading.object_ids[to_the_left] == 2
    ahead = int(np.argmin(np.abs(reading.angles_rad)))
    assert math.isinf(reading.ranges_m[ahead]) or reading.ranges_m[ahead] > 11.0
    assert reading_fault(reading) is None


def test_points_lie_on_surfaces_that_the_beams_met() -> None:
    sensor = LidarPointsSensor(
        source="twin", cast=box_room, pattern=GridPattern(columns=60, rings=5)
    )
    truth = Truth(Pose.of(0.0, 0.0, 2.0, yaw_rad=0.3, pitch_rad=0.1))
    reading = sensor.sample(truth, 1.0, rng())
    assert 20 < len(reading.points_frd_m) < 300
    assert reading.object_ids is not None
    for point, number in zip(reading.points_frd_m.tolist(), reading.object_ids, strict=True):
        north, _, down = truth.pose.to_parent(tuple(point))
        assert (north if number == 2 else down) == pytest.approx(
            5.0 if number == 2 else 0.0, abs=1e-4
        )
    assert reading_fault(reading) is None
    earth = LocalFrame(47.4, 8.5, 488.0)
    assert reading_rest_fault(reading, pose=truth.pose, frame=earth) is None
    in_mm = replace(reading, points_frd_m=reading.points_frd_m * np.float32(1000.0))
    assert "its unit is wrong" in str(reading_rest_fault(in_mm, pose=truth.pose, frame=earth))


def test_a_rangefinder_looks_down_and_tells_nothing_beyond_its_reach() -> None:
    sensor = RangefinderSensor(source="real", cast=box_room, half_angle_rad=0.0)
    near = sensor.sample(Truth(Pose.of(0.0, 0.0, 3.0)), 0.0, rng())
    assert near.range_m == pytest.approx(3.0, abs=1e-4)
    assert math.isinf(sensor.sample(Truth(Pose.of(0.0, 0.0, 30.0)), 0.1, rng()).range_m)
    assert math.isinf(sensor.sample(Truth(Pose.of(0.0, 0.0, 0.05)), 0.2, rng()).range_m)


def test_a_wide_beam_reports_the_nearest_thing() -> None:
    def edge(sensor: Pose, directions_frd: Directions, t_s: float) -> RayHits:
        near = np.where(directions_frd[:, 1] > 0.01, np.float32(1.0), np.float32(4.0))
        return RayHits(near, np.zeros(len(near), np.uint8))

    sensor = RangefinderSensor(source="real", cast=edge)
    assert sensor.sample(HOVER, 0.0, rng()).range_m == 1.0


def test_range_noise_grows_with_distance_and_leaves_the_void_alone() -> None:
    hits = RayHits(
        np.repeat(np.array([2.0, 8.0, np.inf], np.float32), 5000), np.full(15_000, 7, np.uint8)
    )
    seen = disturb_hits(hits, SCAN_NOISE, rng())
    near, far, void = np.split(seen.ranges_m, 3)
    assert near.std() == pytest.approx(0.02, rel=0.05)
    assert far.std() == pytest.approx(0.08, rel=0.05)
    assert np.isinf(void).all()
    assert (np.split(seen.object_ids, 3)[2] == 0).all()
    assert hits.ranges_m[0] == 2.0


def test_dropouts_and_outliers_come_as_often_as_asked() -> None:
    noise = RangeNoise(0.1, 10.0, dropout=0.1, outlier=0.2)
    hits = RayHits(np.full(20_000, 5.0, np.float32), np.ones(20_000, np.uint8))
    seen = disturb_hits(hits, noise, rng()).ranges_m
    assert np.isinf(seen).mean() == pytest.approx(0.1, abs=0.01)
    early = seen[np.isfinite(seen)] < 5.0
    assert early.mean() == pytest.approx(0.2, abs=0.01)


def test_a_beam_that_meets_nothing_does_not_shift_the_noise_of_another() -> None:
    full = np.full(50, 5.0, np.float32)
    holed = full.copy()
    holed[3] = np.inf
    ids = np.ones(50, np.uint8)
    a = disturb_hits(RayHits(full, ids), SCAN_NOISE, rng()).ranges_m
    b = disturb_hits(RayHits(holed, ids), SCAN_NOISE, rng()).ranges_m
    assert np.array_equal(np.delete(a, 3), np.delete(b, 3))


@given(st.integers(1, 40), st.integers(1, 8))
def test_grids_are_unit_vectors(columns: int, rings: int) -> None:
    grid = grid_directions(np.linspace(-3.0, 3.0, columns), np.linspace(-0.5, 0.5, rings))
    assert grid.shape == (columns * rings, 3)
    assert np.linalg.norm(grid, axis=1) == pytest.approx(1.0)


def test_a_rangefinders_noise_is_that_of_its_datasheet() -> None:
    sensor = RangefinderSensor(source="real", cast=box_room, noise=RANGEFINDER_NOISE)
    generator = rng()
    ranges = [sensor.sample(HOVER, k / 50, generator).range_m for k in range(600)]
    assert np.std(ranges) == pytest.approx(RANGEFINDER_NOISE.sigma_m, rel=0.1)


def sensors(kind: NoiseSetName) -> list[Any]:
    return [
        LidarScanSensor(source="real", cast=box_room, noise=SCAN_NOISES.named(kind)),
        RangefinderSensor(source="real", cast=box_room, noise=RANGEFINDER_NOISES.named(kind)),
    ]


@pytest.mark.parametrize("kind", ["ideal", "datasheet"])
def test_equal_seeds_give_equal_readings_and_others_do_not(kind: NoiseSetName) -> None:
    require_repeatable(sensors, kind)
