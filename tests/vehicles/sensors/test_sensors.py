"""Sensor models against truth, statistics of their noise, and their repeatability."""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wil_campaign.vehicles.readings import CameraReading, Reading
from wil_campaign.vehicles.readings.checks import fault_of
from wil_campaign.vehicles.sensors.beams import (
    Directions,
    RangeNoise,
    RayHits,
    disturb,
    grid_directions,
)
from wil_campaign.vehicles.sensors.depth import DepthNoise, DepthSensor
from wil_campaign.vehicles.sensors.gauss_markov import GaussMarkovWalk
from wil_campaign.vehicles.sensors.gps import GPS_NOISES, GpsNoise, GpsSensor
from wil_campaign.vehicles.sensors.imu import IMU_NOISES, ImuNoise, ImuSensor
from wil_campaign.vehicles.sensors.lidar import (
    RANGEFINDER_NOISE,
    RANGEFINDER_NOISES,
    SCAN_NOISE,
    SCAN_NOISES,
    GridPattern,
    LidarPointsSensor,
    LidarScanSensor,
    RangefinderSensor,
)
from wil_campaign.vehicles.sensors.microphone import (
    MICROPHONE_NOISES,
    QUIET,
    MicrophoneNoise,
    MicrophoneSensor,
    RotorSound,
    pressure_of,
)
from wil_campaign.vehicles.sensors.noise_sets import NoiseSetName
from wil_campaign.vehicles.sensors.timing import Timing
from wil_campaign.vehicles.sensors.truth import Truth, motor_speeds
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose
from wil_campaign.worlds.geodesy import LocalFrame

HOME = LocalFrame(47.397742, 8.545594, 488.0)
HOVER = Truth(Pose.of(1.0, 2.0, 3.0, yaw_rad=0.5), motor_speeds_rad_s=(469.0,) * 4)


def rng(seed: int = 1) -> np.random.Generator:
    return np.random.default_rng(seed)


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


@given(
    rate_hz=st.floats(0.1, 1000.0),
    start_s=st.floats(0.0, 100.0),
    after_s=st.floats(0.0, 200.0),
    span_s=st.floats(0.0, 1.0),
)
def test_ticks_are_complete_and_never_twice(
    rate_hz: float, start_s: float, after_s: float, span_s: float
) -> None:
    timing = Timing(rate_hz, start_s=start_s)
    first = timing.index_after(after_s)
    assert timing.time_of(first) > after_s or first == 0
    assert first == 0 or timing.time_of(first - 1) <= after_s
    middle, end = after_s + span_s / 3.0, after_s + span_s
    parts = [*timing.between(after_s, middle), *timing.between(middle, end)]
    assert parts == [*timing.between(after_s, end)]


@pytest.mark.parametrize("wrong", [{"rate_hz": 0.0}, {"rate_hz": math.nan}, {"latency_s": -1.0}])
def test_a_timing_that_cannot_be(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=r"rate|latency"):
        Timing(**{"rate_hz": 10.0, **wrong})


def test_nothing_arrives_before_it_was_sampled() -> None:
    timing, generator = Timing(10.0, latency_s=0.001, jitter_s=0.01), rng()
    late = [timing.arrival_s(1.0, generator) - 1.0 for _ in range(500)]
    assert min(late) == 0.0
    assert max(late) > 0.02


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


def test_a_scan_sees_the_wall_where_it_is() -> None:
    level = Truth(Pose.of(0.0, 0.0, 1.0, yaw_rad=math.pi / 2))  # facing east
    reading = LidarScanSensor(source="twin", cast=box_room).sample(level, 1.0, rng())
    to_the_left = int(np.argmin(np.abs(reading.angles_rad + math.pi / 2)))  # so north
    assert reading.ranges_m[to_the_left] == pytest.approx(5.0, abs=1e-3)
    assert reading.object_ids is not None
    assert reading.object_ids[to_the_left] == 2
    ahead = int(np.argmin(np.abs(reading.angles_rad)))
    assert math.isinf(reading.ranges_m[ahead]) or reading.ranges_m[ahead] > 11.0
    assert fault_of(reading) is None


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
    assert fault_of(reading) is None


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
    seen = disturb(hits, SCAN_NOISE, rng())
    near, far, void = np.split(seen.ranges_m, 3)
    assert near.std() == pytest.approx(0.02, rel=0.05)
    assert far.std() == pytest.approx(0.08, rel=0.05)
    assert np.isinf(void).all()
    assert (np.split(seen.object_ids, 3)[2] == 0).all()
    assert hits.ranges_m[0] == 2.0


def test_dropouts_and_outliers_come_as_often_as_asked() -> None:
    noise = RangeNoise(0.1, 10.0, dropout=0.1, outlier=0.2)
    hits = RayHits(np.full(20_000, 5.0, np.float32), np.ones(20_000, np.uint8))
    seen = disturb(hits, noise, rng()).ranges_m
    assert np.isinf(seen).mean() == pytest.approx(0.1, abs=0.01)
    early = seen[np.isfinite(seen)] < 5.0
    assert early.mean() == pytest.approx(0.2, abs=0.01)


def test_a_beam_that_meets_nothing_does_not_shift_the_noise_of_another() -> None:
    full = np.full(50, 5.0, np.float32)
    holed = full.copy()
    holed[3] = np.inf
    ids = np.ones(50, np.uint8)
    a = disturb(RayHits(full, ids), SCAN_NOISE, rng()).ranges_m
    b = disturb(RayHits(holed, ids), SCAN_NOISE, rng()).ranges_m
    assert np.array_equal(np.delete(a, 3), np.delete(b, 3))


@given(st.integers(1, 40), st.integers(1, 8))
def test_grids_are_unit_vectors(columns: int, rings: int) -> None:
    grid = grid_directions(np.linspace(-3.0, 3.0, columns), np.linspace(-0.5, 0.5, rings))
    assert grid.shape == (columns * rings, 3)
    assert np.linalg.norm(grid, axis=1) == pytest.approx(1.0)


def picture(depth_m: float, *, width: int = 160, height: int = 120) -> CameraReading:
    return CameraReading(
        t_s=1.0,
        arrived_s=1.05,
        seq=4,
        source="twin",
        image_bgr=np.zeros((height, width, 3), np.uint8),
        intrinsics=Intrinsics.from_fov(width, height, 1.2),
        depth_m=np.full((height, width), depth_m, np.float32),
    )


def test_stereo_depth_errs_with_the_square_of_distance() -> None:
    noise, sensor, generator = DepthNoise(), DepthSensor(noise=DepthNoise()), rng()
    for distance_m in (1.0, 2.0, 4.0):
        source = picture(distance_m)
        seen = sensor.sample(source, generator)
        sigma = distance_m**2 * noise.subpixel_px / (source.intrinsics.fx_px * noise.baseline_m)
        assert seen.depth_m.std() == pytest.approx(sigma, rel=0.05)
        assert seen.depth_m.dtype == np.float32
        assert (seen.t_s, seen.arrived_s, seen.seq) == (1.0, 1.05, 4)
    assert np.isinf(sensor.sample(picture(11.0), generator).depth_m).all()
    assert np.isinf(sensor.sample(picture(math.inf), generator).depth_m).all()
    a, b = sensor.sample(picture(2.0), generator), sensor.sample(picture(2.0), generator)
    assert not np.array_equal(a.depth_m, b.depth_m)


def test_depth_without_noise_is_the_images_own() -> None:
    source = picture(3.0)
    assert DepthSensor().sample(source, rng()).depth_m is source.depth_m
    with pytest.raises(ValueError, match="no depth_m"):
        DepthSensor().sample(replace(source, depth_m=None), rng())


def recorded(sensor: MicrophoneSensor, truth: Truth, blocks: int) -> "np.ndarray":
    generator = rng()
    return np.concatenate(
        [
            sensor.sample(truth, (k + 1) * sensor.block_s, generator).pressure_pa
            for k in range(blocks)
        ]
    )


def test_rotors_sound_at_their_blade_pass_frequency() -> None:
    sound = replace(RotorSound(), broadband_db=-math.inf)
    sensor = MicrophoneSensor(source="real", rotors=sound, block_samples=500)
    wave = recorded(sensor, HOVER, 32)  # one second
    spectrum = np.abs(np.fft.rfft(wave * np.hanning(len(wave))))
    blade_pass_hz = 2 * 469.0 / (2 * math.pi)
    assert np.argmax(spectrum) == pytest.approx(blade_pass_hz, abs=1.0)
    for harmonic in (2, 3):
        around = spectrum[int(harmonic * blade_pass_hz) - 3 : int(harmonic * blade_pass_hz) + 5]
        assert around.max() > 20 * np.median(spectrum)


def test_loudness_at_hover_is_as_requested_and_falls_with_the_square_of_speed() -> None:
    sound = replace(RotorSound(), broadband_db=-math.inf)
    levels = []
    for speed in (469.0, 234.5):
        sensor = MicrophoneSensor(source="real", rotors=sound)
        # speeds a little apart: rotors of one speed would add or cancel by their phases
        truth = replace(HOVER, motor_speeds_rad_s=(speed, speed * 1.01, speed * 1.02, speed * 0.99))
        levels.append(float(np.sqrt(np.mean(recorded(sensor, truth, 300) ** 2))))
    assert 20 * math.log10(levels[0] / pressure_of(sound.hover_level_db)) == pytest.approx(
        0.0, abs=0.6
    )
    assert levels[0] / levels[1] == pytest.approx(4.0, rel=0.06)


def test_sound_runs_on_from_block_to_block() -> None:
    sound = replace(RotorSound(), broadband_db=-math.inf, harmonics=1)
    sensor, generator = MicrophoneSensor(source="real", rotors=sound, block_samples=160), rng()
    wave = [sensor.sample(HOVER, 0.01, generator)]
    faster = replace(HOVER, motor_speeds_rad_s=(560.0,) * 4)
    wave += [sensor.sample(faster, 0.02 + 0.01 * k, generator) for k in range(3)]
    joined = np.concatenate([block.pressure_pa for block in wave])
    steepest = 2.0 * 560.0 / 16_000 * np.abs(joined).max()
    assert np.abs(np.diff(joined)).max() < 1.3 * steepest
    assert [round(block.t_s, 6) for block in wave] == [0.0, 0.01, 0.02, 0.03]


def test_tones_beyond_half_the_sample_rate_do_not_fold_back() -> None:
    sound = replace(
        RotorSound(), broadband_db=-math.inf, harmonics=4, fall_db=0.0, hover_speed_rad_s=9425.0
    )
    fast = replace(HOVER, motor_speeds_rad_s=(2 * math.pi * 1500.0,))  # 3, 6, 9, 12 kHz
    sensor = MicrophoneSensor(source="real", rotors=sound, block_samples=1600)
    spectrum = np.abs(np.fft.rfft(recorded(sensor, fast, 10)))
    loud_hz = np.flatnonzero(spectrum > 0.1 * spectrum.max())
    assert set(loud_hz.tolist()) <= {2999, 3000, 3001, 5999, 6000, 6001}


def test_a_hall_without_rotors_has_its_ambient_level() -> None:
    noise = MicrophoneNoise(ambient_level_db=60.0)
    still = replace(HOVER, motor_speeds_rad_s=(0.0,) * 4)
    wave = recorded(MicrophoneSensor(source="real", noise=noise), still, 60)
    assert 20 * math.log10(wave.std() / 20e-6) == pytest.approx(60.0, abs=0.3)
    silent = recorded(MicrophoneSensor(source="twin", noise=QUIET), Truth(HOVER.pose), 3)
    assert not silent.any()


def test_rotor_speed_from_thrust() -> None:
    assert motor_speeds((0.5 * 9.80665 / 4, 0.0, -1.0)) == pytest.approx((469.1, 0.0, 0.0), abs=0.2)


def _sampled(sensor: Any, t_s: float, generator: np.random.Generator) -> Reading:
    reading: Reading = sensor.sample(HOVER, t_s, generator)
    return reading


def sensors(kind: NoiseSetName) -> list[Callable[[float, np.random.Generator], Reading]]:
    imu = ImuSensor(source="real", noise=IMU_NOISES.named(kind))
    gps = GpsSensor(source="real", frame=HOME, noise=GPS_NOISES.named(kind))
    scan = LidarScanSensor(source="real", cast=box_room, noise=SCAN_NOISES.named(kind))
    below = RangefinderSensor(source="real", cast=box_room, noise=RANGEFINDER_NOISES.named(kind))
    ear = MicrophoneSensor(source="real", noise=MICROPHONE_NOISES.named(kind))
    return [partial(_sampled, sensor) for sensor in (imu, gps, scan, below, ear)]


def flat(reading: Reading) -> str:
    return "".join(
        value.tobytes().hex() if isinstance(value, np.ndarray) else repr(value)
        for name in reading.__slots__
        for value in [getattr(reading, name)]
    )


@pytest.mark.parametrize("kind", ["ideal", "datasheet"])
def test_equal_seeds_give_equal_readings_and_others_do_not(kind: NoiseSetName) -> None:
    def run(seed: int) -> list[str]:
        generator = rng(seed)
        return [flat(sample(0.1 * k, generator)) for sample in sensors(kind) for k in range(1, 4)]

    assert run(3) == run(3)
    noisy = kind == "datasheet"
    assert [a == b for a, b in zip(run(3), run(4), strict=True)][:12] == [not noisy] * 12


@pytest.mark.parametrize("kind", ["ideal", "datasheet"])
def test_every_sensor_gives_readings_without_fault(kind: NoiseSetName) -> None:
    generator = rng()
    for sample in sensors(kind):
        assert fault_of(sample(1.0, generator)) is None


def test_a_rangefinders_noise_is_that_of_its_datasheet() -> None:
    sensor = RangefinderSensor(source="real", cast=box_room, noise=RANGEFINDER_NOISE)
    generator = rng()
    ranges = [sensor.sample(HOVER, k / 50, generator).range_m for k in range(600)]
    assert np.std(ranges) == pytest.approx(RANGEFINDER_NOISE.sigma_m, rel=0.1)
