"""The model of a microphone: the rotors' tones, their loudness, and what is around them."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.vehicles.sensors.sensor_rigs import HOVER, require_repeatable, rng
from wil_campaign.plugins.microphone.microphone import (
    MICROPHONE_NOISES,
    QUIET,
    MicrophoneNoise,
    MicrophoneSensor,
    RotorSound,
    pressure_of_level,
)
from wil_campaign.vehicles.sensors.noise_sets import NoiseSetName
from wil_campaign.vehicles.sensors.truth import Truth


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
    assert 20 * math.log10(levels[0] / pressure_of_level(sound.hover_level_db)) == pytest.approx(
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


def sensors(kind: NoiseSetName) -> list[Any]:
    return [MicrophoneSensor(source="real", noise=MICROPHONE_NOISES.named(kind))]


@pytest.mark.parametrize("kind", ["datasheet"])
def test_equal_seeds_give_equal_readings_and_others_do_not(kind: NoiseSetName) -> None:
    require_repeatable(sensors, kind)
