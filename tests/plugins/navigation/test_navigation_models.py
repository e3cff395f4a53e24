"""Models of GPS receivers and IMUs: truth, their noise, and that it repeats."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.vehicles.sensors.sensor_rigs import HOVER, require_repeatable, rng
from wil_campaign.plugins.navigation.gauss_markov import GaussMarkovWalk
from wil_campaign.plugins.navigation.gps import GPS_NOISES, GpsNoise, GpsSensor
from wil_campaign.plugins.navigation.imu import IMU_NOISES, ImuNoise, ImuSensor
from wil_campaign.vehicles.readings.checks import reading_rest_fault
from wil_campaign.vehicles.sensors.noise_sets import NoiseSetName
from wil_campaign.worlds.geodesy import LocalFrame

HOME = LocalFrame(47.397742, 8.545594, 488.0)


def test_a_walk_keeps_its_spread_and_its_memory() -> None:
    walk, generator = GaussMarkovWalk(sigma=(2.0,), time_constant_s=1.0), rng()
    values = np.array([walk.at(k * 0.1, generator)[0] for k in range(20_000)])
    assert values.std() == pytest.approx(2.0, rel=0.1)
    remembered = np.corrcoef(values[:-10], values[10:])[0, 1]
    assert remembered == pytest.approx(math.exp(-1.0), abs=0.08)


def test_an_imu_without_noise_feels_the_truth() -> None:
    truth = replace(HOVER, rates_frd_rad_s=(0.1, 0.2, 0.3))
    reading = ImuSensor(source="twin").sample(truth, 2.0, rng())
    assert reading.rates_frd_rad_s == truth.rates_frd_rad_s
    assert reading.specific_force_frd_m_s2 == truth.specific_force_frd_m_s2
    assert (reading.t_s, reading.seq, reading.source) == (2.0, 0, "twin")


def test_imu_noise_has_its_density_and_its_bias() -> None:
    noise = ImuNoise(gyro_random_walk=0.0, accel_random_walk=0.0)
    sensor, generator = ImuSensor(source="real", noise=noise), rng()
    readings = [sensor.sample(HOVER, k / 200.0, generator) for k in range(4000)]
    rates = np.array([reading.rates_frd_rad_s for reading in readings])
    forces = np.array([reading.specific_force_frd_m_s2 for reading in readings])
    assert rates.std(axis=0) == pytest.approx(noise.gyro_density * math.sqrt(200.0), rel=0.1)
    assert forces.std(axis=0) == pytest.approx(noise.accel_density * math.sqrt(200.0), rel=0.1)
    biases = np.abs(rates.mean(axis=0))
    assert (biases > 1e-4).all()
    assert (biases < 4.0 * noise.gyro_turn_on_rad_s).all()
    assert [reading.seq for reading in readings] == list(range(4000))


def test_an_imu_bias_walks() -> None:
    noise = ImuNoise(gyro_density=0.0, gyro_turn_on_rad_s=0.0)
    generator = rng()
    starts = [
        ImuSensor(source="real", noise=noise).sample(HOVER, 0.0, generator).rates_frd_rad_s[0]
        for _ in range(2000)
    ]
    stationary = noise.gyro_random_walk * math.sqrt(noise.gyro_bias_time_s / 2.0)
    assert np.std(starts) == pytest.approx(stationary, rel=0.1)


def test_a_fix_is_above_the_ellipsoid_and_the_worlds_origin_above_sea_level() -> None:
    above = replace(HOME, undulation_m=47.5)
    reading = GpsSensor(source="twin", frame=above).sample(HOVER, 4.0, rng())
    at_sea_level = GpsSensor(source="twin", frame=HOME).sample(HOVER, 4.0, rng())
    assert reading.altitude_m == pytest.approx(at_sea_level.altitude_m + 47.5)
    assert reading_rest_fault(reading, pose=HOVER.pose, frame=above) is None
    highest = replace(reading, altitude_m=reading.altitude_m + 990.0)  # of the 1000 m let pass
    assert reading_rest_fault(highest, pose=HOVER.pose, frame=above) is None
    assert reading_rest_fault(highest, pose=HOVER.pose, frame=HOME) is not None


def test_a_fix_lies_on_the_globe_and_is_late() -> None:
    reading = GpsSensor(source="twin", frame=HOME).sample(HOVER, 4.0, rng())
    back = HOME.to_ned(reading.latitude_deg, reading.longitude_deg, reading.altitude_m)
    assert back == pytest.approx((1.0, 2.0, -3.0), abs=1e-6)
    assert reading.arrived_s == pytest.approx(4.11)


def test_half_of_all_fixes_lie_within_the_cep() -> None:
    noise, generator = GpsNoise(), rng()
    misses = []
    for _ in range(2000):
        r = GpsSensor(source="real", frame=HOME, noise=noise).sample(HOVER, 0.0, generator)
        north, east, _ = HOME.to_ned(r.latitude_deg, r.longitude_deg, r.altitude_m)
        misses.append(math.hypot(north - 1.0, east - 2.0))
    assert np.median(misses) == pytest.approx(2.5, rel=0.07)


def sensors(kind: NoiseSetName) -> list[Any]:
    imu = ImuSensor(source="real", noise=IMU_NOISES.named(kind))
    return [imu, GpsSensor(source="real", frame=HOME, noise=GPS_NOISES.named(kind))]


@pytest.mark.parametrize("kind", ["ideal", "datasheet"])
def test_equal_seeds_give_equal_readings_and_others_do_not(kind: NoiseSetName) -> None:
    require_repeatable(sensors, kind)
