"""Sound: bands are kept, blocks join without a click, and sums stand at their times."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from recipes.operations.audio import band_pass_kernel
from recipes.working import CannotMixError, Masked
from tests.recipes.samples import build, sound

RATE = 8000


def blocks(samples: Any, size: int, start_s: float = 1.0) -> list[Any]:
    return [
        sound(samples[first : first + size], t_s=start_s + first / RATE, seq=first // size)
        for first in range(0, len(samples), size)
    ]


def tone(hz: float, seconds: float = 0.5, amplitude: float = 8000.0) -> Any:
    return np.rint(amplitude * np.sin(2 * np.pi * hz * np.arange(int(seconds * RATE)) / RATE))


def through(step: Any, parts: list[Any]) -> list[Any]:
    return [step(Masked(part), None).reading for part in parts]


@settings(max_examples=25, deadline=None)
@given(st.floats(50, 3950))
def test_a_tone_passes_within_the_band_and_not_outside(hz: float) -> None:
    made = through(build("band_pass", low_hz=800.0, high_hz=1600.0), blocks(tone(hz), 400))
    heard = np.concatenate([part.samples for part in made])[1000:]
    level = np.sqrt(2 * np.mean(np.square(heard, dtype=float))) / 8000
    if 950 < hz < 1450:
        assert level == pytest.approx(1.0, abs=0.02)
    elif hz < 650 or hz > 1750:
        assert level < 0.003


def test_the_time_of_what_passes_is_that_at_which_it_sounded() -> None:
    samples = np.zeros(4000)
    samples[2000:2400] = tone(1000.0, 0.05)
    made = through(build("band_pass", low_hz=800.0, high_hz=1200.0, taps=201), blocks(samples, 500))
    whole = np.concatenate([part.samples for part in made]).astype(float)
    times = made[0].t_s + np.arange(len(whole)) / RATE
    energy = whole**2
    assert (times * energy).sum() / energy.sum() == pytest.approx(1.0 + 2200 / RATE, abs=0.0005)
    assert [len(part.samples) for part in made] == [500] * 8


@settings(deadline=None, max_examples=20)
@given(st.sampled_from([100, 160, 250, 800]))
def test_blocks_join_as_if_they_were_one(size: int) -> None:
    samples = np.random.default_rng(1).integers(-9000, 9000, 4000)
    one = through(build("band_pass", high_hz=900.0), blocks(samples, 4000))[0].samples
    many = through(build("band_pass", high_hz=900.0), blocks(samples, size))
    assert np.abs(np.concatenate([m.samples for m in many]) - one.astype(int)).max() <= 1


def test_after_a_gap_the_filter_begins_from_silence() -> None:
    step = build("band_pass", high_hz=900.0)
    loud, quiet = sound(tone(300.0, 0.1)), sound(np.zeros(400), t_s=9.0)
    assert step(Masked(loud), None).reading.samples.any()
    assert not step(Masked(quiet), None).reading.samples.any()


def test_ends_of_a_band_may_be_open() -> None:
    high = band_pass_kernel(0.2, 0.5, 101)
    assert abs(high.sum()) < 1e-9
    assert band_pass_kernel(0.0, 0.2, 101).sum() == pytest.approx(1.0)
    with pytest.raises(CannotMixError, match="beyond"):
        build("band_pass", low_hz=5000.0)(Masked(sound([1, 2])), None)
    with pytest.raises(ValueError, match="low_hz must be below"):
        build("band_pass", low_hz=300.0, high_hz=200.0)


def test_decimation_keeps_low_tones_and_has_no_aliases() -> None:
    for hz, passes in ((300.0, True), (3100.0, False)):
        made = through(build("decimate_sound", every=4), blocks(tone(hz), 400))
        heard = np.concatenate([part.samples for part in made])[100:]
        level = np.sqrt(2 * np.mean(np.square(heard, dtype=float))) / 8000
        assert (made[0].sample_rate_hz, len(made[0].samples)) == (2000, 100)
        assert level == pytest.approx(1.0, abs=0.02) if passes else level < 0.01
    with pytest.raises(CannotMixError, match="cannot divide"):
        build("decimate_sound", every=3)(Masked(sound(np.zeros(400))), None)


@settings(deadline=None)
@given(st.integers(-300, 300), st.sampled_from([80, 160, 333]))
def test_sounds_are_added_at_their_times(shift: int, size: int) -> None:
    """Whatever the twin's blocks, the sum is that of the two whole recordings."""
    rng = np.random.default_rng(5)
    real = rng.integers(-4000, 4000, 1600)
    twin = rng.integers(-4000, 4000, 4000)
    step = build("add", twin_gain=0.5)
    parts = blocks(twin, size, 1.0 - 1000 / RATE + shift / RATE)
    heard = []
    for block in blocks(real, 160):
        due = [part for part in parts if part.t_s < block.t_s + 160 / RATE]
        for part in due[-4:]:
            mixed = step({"real": Masked(replace(block, source="real")), "twin": Masked(part)})
        heard.append(mixed.samples)
    first = 1000 - shift
    expected = real + np.rint(0.5 * twin[first : first + 1600])
    apart = np.abs(np.concatenate(heard).astype(int)[: 1600 - size] - expected[: 1600 - size])
    assert apart.max() <= 1


def test_full_scales_differ_and_the_sum_is_cut_off_at_the_reals() -> None:
    step = build("add")
    real, twin = sound([1000, 32000], "real"), sound([1000, 32000], full_scale_pa=20.0)
    made = step({"real": Masked(real), "twin": Masked(twin)})
    assert made.samples.tolist() == [3000, 32767]
    with pytest.raises(CannotMixError, match="16000 Hz over sound of 8000 Hz"):
        build("add")({"real": Masked(real), "twin": Masked(sound([1], rate=16000))})
