"""Sound: bands are kept, blocks join without a click, and sums stand at their times."""

import math
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.recipes.samples import build, sound
from wil_campaign.foundation.files.documents import parse_document
from wil_campaign.plugins.microphone.audio import band_pass_kernel
from wil_campaign.recipes.language.recipe_document import load_recipe
from wil_campaign.recipes.pipeline.pipeline import compile_recipe
from wil_campaign.recipes.working import CannotMixError, Masked

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


def test_a_filtered_tone_keeps_the_time_at_which_it_sounded() -> None:
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


class SoundRig:
    """A recipe for sound, its mixtures, and why the twin's sound is missing in some of them."""

    def __init__(self, body: str) -> None:
        text = (
            "schema: wil/recipe/1\nsensors: {s: {type: microphone}}\n"
            f"combine: [{{sensor: s, {body}}}]\n"
        )
        recipe = load_recipe(parse_document(text.encode(), name="r.yaml"))
        (self.mixer,) = compile_recipe(recipe, object_ids={})
        self.mixed: list[Any] = []
        self.dropped: list[str] = []

    def mix(self, reals: list[Any], twins: list[Any]) -> None:
        """Mix each real block once all of the twin's that began before its end have come."""
        waiting, come = list(twins), list[Any]()
        for real in reals:
            now_s = real.t_s + real.duration_s
            while waiting and waiting[0].t_s < now_s - 1e-9:
                come.append(replace(waiting.pop(0), arrived_s=now_s))
                assert self.mixer.offer("twin", come[-1]) is None
            nearest = min(come, key=lambda one: abs(one.t_s - real.t_s))
            block = replace(real, source="real", arrived_s=now_s)
            made = self.mixer.mix(block, nearest, now_s=now_s)
            self.mixed.append(made.reading)
            self.dropped.append(made.provenance.detail)
            assert made.provenance.given_twin_seq == nearest.seq

    def samples_since(self, since: int = 0) -> Any:
        """Return the mixed samples from a mixture on; each block begins where the last ended."""
        made = self.mixed[since:]
        for before, after in pairwise(made):
            assert after.t_s == pytest.approx(before.t_s + before.duration_s, abs=1e-6)
        return np.concatenate([one.samples for one in made]).astype(int)


@settings(deadline=None)
@given(st.integers(-300, 300), st.sampled_from([80, 160, 333]))
def test_sounds_are_added_at_their_times(shift: int, size: int) -> None:
    """Whatever the twin's blocks, the sum is that of the two whole recordings."""
    rng = np.random.default_rng(5)
    real = rng.integers(-4000, 4000, 1600)
    twin = rng.integers(-4000, 4000, 4000)
    rig = SoundRig("merge: {add: {twin_gain: 0.5}}")
    rig.mix(blocks(real, 160), blocks(twin, size, 1.0 - 1000 / RATE + shift / RATE))
    first = 1000 - shift
    expected = real + np.rint(0.5 * twin[first : first + 1600])
    assert rig.dropped == [""] * 10
    assert np.abs(rig.samples_since() - expected).max() <= 1


@pytest.mark.parametrize("late_s", [0.0, 0.012, 0.5 / RATE])
@pytest.mark.parametrize("side", ["twin", "real", "both"])
def test_a_filter_of_one_side_loses_no_sound_of_the_sum(side: str, late_s: float) -> None:
    """The filter passes all that is here: only its delay counts."""
    real, twin = np.full(4000, 1000), tone(300.0)
    rig = SoundRig(f"filter: [{{band_pass: {{high_hz: 3900, on: {side}}}}}], merge: add")
    rig.mix(blocks(real, 200, 2.0), blocks(twin, 128, 2.0 - late_s))
    # The twin's sound before the first block was never mixed; its end is not known for the last.
    assert set(rig.dropped[1:-1]) == {""}
    made = rig.samples_since(since=2)[:-200]
    delayed = 400 - 200 + math.floor(late_s * RATE + 0.001)
    assert np.abs(made - 1000 - twin[delayed : delayed + len(made)]).max() < 30


def test_sound_that_is_not_known_for_the_whole_time_is_left_out_and_counted() -> None:
    parts = blocks(np.full(1600, 500), 80)
    del parts[5]
    parts[12] = replace(parts[12], t_s=parts[12].t_s + 2 / RATE)
    rig = SoundRig("merge: add")
    rig.mix(blocks(np.full(1600, 1000), 160), parts)
    assert rig.dropped == ["", "", "the twin's sound covers 50 % of the block", *[""] * 7]
    assert [int(one.samples[40]) for one in rig.mixed] == [1500, 1500, 1000, *[1500] * 7]
    assert dict(rig.mixer.counts().dropped) == {"no_twin": 1}


def test_real_sound_is_whole_whatever_the_jitter_of_its_time_stamps() -> None:
    rng = np.random.default_rng(5)
    real = blocks(rng.integers(-4000, 4000, 3200), 160)
    late = rng.integers(-20, 20, len(real)) / RATE
    shifted = [replace(one, t_s=one.t_s + s) for one, s in zip(real, late, strict=True)]
    rig = SoundRig("merge: add")
    rig.mix(shifted, blocks(np.full(4800, 500), 100, 0.9))
    for block, mixed in zip(real, rig.mixed, strict=True):
        assert (mixed.samples == block.samples + 500).all()


def test_a_twin_whose_stamps_deviate_by_milliseconds_is_whole() -> None:
    rng = np.random.default_rng(5)
    twin = [
        replace(block, t_s=block.t_s + rng.uniform(-0.002, 0.002))
        for block in blocks(np.full(16_000, 500), 100, 0.9)
    ]
    real = np.full(12_800, 1000)
    rig = SoundRig("merge: add")
    rig.mix(blocks(real, 160), twin)
    assert set(rig.dropped[1:-1]) == {""}
    # The line follows the stamps by a sample a block.
    assert np.mean(rig.samples_since(1)[:-160] != 1500) < 0.01


def test_a_twin_whose_stamps_jump_back_by_milliseconds_comes_to_its_stamps_again() -> None:
    sounds = np.zeros(40_000)
    sounds[30_000] = 8000
    late_s = -40 / RATE
    twin = [
        replace(block, t_s=block.t_s + late_s) if block.t_s > 1.5 else block
        for block in blocks(sounds, 100, 0.9)
    ]
    rig = SoundRig("merge: add")
    rig.mix(blocks(np.zeros(39_000), 160), twin)
    assert set(rig.dropped[1:-1]) == {""}
    (heard,) = np.flatnonzero(rig.samples_since())
    sounded_s = 0.9 + 30_000 / RATE + late_s
    assert abs(1.0 + heard / RATE - sounded_s) <= 2.5 / RATE


def test_a_twin_of_another_rate_is_cut_so_that_a_step_can_convert_it() -> None:
    twin = np.rint(8000 * np.sin(2 * np.pi * 300 * np.arange(8000) / 16000))
    parts = [
        sound(twin[first : first + 300], t_s=1.0 + first / 16000, rate=16000, seq=first)
        for first in range(0, 8000, 300)
    ]
    rig = SoundRig("filter: [{decimate_sound: 2}], merge: add")
    rig.mix(blocks(np.zeros(4000), 160), parts)
    assert set(rig.dropped) == {""}
    made = rig.samples_since(since=1)
    first = 160 - 16
    expected = tone(300.0)[first : first + len(made)]
    assert np.abs(made - expected).max() < 60


@pytest.mark.parametrize("more", ["", ", {resample: hold}"])
@pytest.mark.parametrize("on", ["real", "twin"])
def test_a_delayed_side_is_added_at_the_time_at_which_it_sounded(on: str, more: str) -> None:
    rng = np.random.default_rng(5)
    real, twin = rng.integers(-4000, 4000, 3200), rng.integers(-4000, 4000, 3200)
    rig = SoundRig(f"transform: [{{delay: {{by_ms: 30, on: {on}}}}}{more}], merge: add")
    rig.mix(blocks(real, 160), blocks(twin, 100))
    assert "" not in rig.dropped[:1]
    since = next(k for k, why in enumerate(rig.dropped) if not why)
    assert set(rig.dropped[since:]) == {""}
    made = rig.samples_since(since)
    first = round((rig.mixed[since].t_s - 1.0) * RATE)
    assert np.abs(made - (real + twin)[first : first + len(made)]).max() <= 1


def test_full_scales_differ_and_the_sum_is_cut_off_at_the_reals() -> None:
    step = build("add")
    real, twin = sound([1000, 32000], "real"), sound([1000, 32000], full_scale_pa=20.0)
    made = step({"real": Masked(real), "twin": Masked(twin)})
    assert made.samples.tolist() == [3000, 32767]
    with pytest.raises(CannotMixError, match="16000 Hz over sound of 8000 Hz"):
        build("add")({"real": Masked(real), "twin": Masked(sound([1], rate=16000))})
