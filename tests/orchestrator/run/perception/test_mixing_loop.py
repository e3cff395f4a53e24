"""Mixing in flight: who meets whom, who waits and for how long, and what spoils a flight."""

import asyncio
import math
import time
from collections.abc import Awaitable, Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.recipes.samples import beam, camera, sound
from wil_campaign.foundation.clocks.sleeping import sleep_until
from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.foundation.files.documents import parse_document
from wil_campaign.orchestrator.run.perception.mixing_budget import MixingBudgetWatch
from wil_campaign.orchestrator.run.perception.mixing_loop import (
    MixingLoop,
    Registration,
    RegistrationError,
)
from wil_campaign.orchestrator.state.mixtures import MixedFrame
from wil_campaign.orchestrator.state.run_state import RunState
from wil_campaign.recipes.language.recipe_document import load_recipe
from wil_campaign.recipes.model.recipe import MixingBudget
from wil_campaign.recipes.pipeline.budgets import budget_breach
from wil_campaign.recipes.pipeline.pipeline import compile_recipe
from wil_campaign.recipes.visibility.coverage import VisibilityCoverage
from wil_campaign.recipes.visibility.model import FrameVisibility, ObjectVisibility
from wil_campaign.recipes.working import StepError
from wil_campaign.vehicles.cameras.rendered_cameras import NoImageError
from wil_campaign.vehicles.poses.pose_history import PoseHistory
from wil_campaign.vehicles.readings import Reading
from wil_campaign.worlds.frames import Pose


class Rig:
    """A mixing loop, what it reported, and what it complained of."""

    def __init__(
        self,
        body: str = "merge: {aggregate: min}",
        *,
        sensor: str = "rangefinder",
        twin: Any = None,
        period_s: float = 0.02,
        rate_hz: float | None = None,
        registration: Registration | None = None,
    ) -> None:
        text = (
            f"schema: wil/recipe/1\nsensors: {{s: {{type: {sensor}}}}}\n"
            f"combine:\n  - {{sensor: s, {body}}}\n"
        )
        (mixer,) = compile_recipe(
            load_recipe(parse_document(text.encode(), name="r.yaml")), object_ids={}
        )
        self.frames: list[tuple[float, MixedFrame]] = []
        self.troubles: list[str] = []
        self.poses = PoseHistory(2.0)
        self.loop = MixingLoop(
            name="s",
            mixer=mixer,
            twin=twin,
            poses=self.poses,
            wait_s=0.05,
            period_s=period_s,
            rate_hz=rate_hz,
            registration=registration,
            on_mixture=lambda frame: self.frames.append((asyncio.get_running_loop().time(), frame)),
            on_fault=self.troubles.append,
        )

    def real(self, t_s: float, late_s: float = 0.0, made: Any = None) -> None:
        self._at(t_s, late_s, made or beam(2.0, "real"), self.loop.real_reading)

    def twin(self, t_s: float, late_s: float = 0.0, made: Any = None) -> None:
        self._at(t_s, late_s, made or beam(1.0), self.loop.twin_reading)

    def _at(self, t_s: float, late_s: float, made: Any, take: Callable[[Any], None]) -> None:

        reading = replace(made, t_s=t_s, arrived_s=t_s + late_s, seq=round(t_s * 1000))
        asyncio.get_running_loop().call_at(t_s + late_s, take, reading)

    async def run(self, until_s: float) -> None:
        task = asyncio.ensure_future(self.loop.run())
        await sleep_until(until_s)
        task.cancel()
        await asyncio.wait([task])
        if not task.cancelled():
            task.result()

    @property
    def provenances(self) -> list[Any]:
        return [frame.mixed.provenance for _, frame in self.frames]


def flown(rig_of: Callable[[], Rig], feed: Callable[[Rig], None], until_s: float = 2.0) -> Rig:
    async def run() -> Rig:
        rig = rig_of()
        feed(rig)
        await rig.run(until_s)
        return rig

    return run_virtual(run())


def test_a_reading_waits_for_the_twins_of_its_moment() -> None:
    def feed(rig: Rig) -> None:
        for k in range(10):
            rig.real(1 + k * 0.02)
            rig.twin(1 + k * 0.02, late_s=0.008)

    rig = flown(Rig, feed)
    assert [provenance.skew_ms for provenance in rig.provenances] == [0.0] * 10
    assert [provenance.latency_ms for provenance in rig.provenances] == pytest.approx([8.0] * 10)
    assert [provenance.real_seq for provenance in rig.provenances] == [
        1000 + 20 * k for k in range(10)
    ]
    assert [provenance.twin_seq for provenance in rig.provenances] == [
        1000 + 20 * k for k in range(10)
    ]


def test_a_twin_that_is_ahead_or_behind_is_met_at_the_nearest_moment() -> None:
    def feed(rig: Rig) -> None:
        for k in range(20):
            rig.twin(1 + k * 0.025)
        for k in range(5):
            rig.real(1.1 + k * 0.05, late_s=0.1)

    rig = flown(Rig, feed)
    assert all(provenance.skew_ms <= 12.5 for provenance in rig.provenances)
    assert len(rig.provenances) == 5


@pytest.mark.parametrize(("rate_hz", "late_s"), [(60, 0.2), (30, 0.45), (15, 0.06)])
def test_the_twins_image_of_a_moment_is_kept_until_the_late_real_one_has_come(
    rate_hz: int, late_s: float
) -> None:
    """A live camera over a radio is late by more than eight images of a fast simulator."""

    def feed(rig: Rig) -> None:
        for k in range(2 * rate_hz):
            rig.twin(1 + k / rate_hz, late_s=0.01, made=camera())
        for k in range(15):
            rig.real(1 + k / 15, late_s=late_s, made=camera(source="real"))

    body = "merge: {overlay: {priority: [real, twin]}}, max_skew_ms: 20"
    rig = flown(lambda: Rig(body, sensor="camera", period_s=1 / 15), feed, 3.5)
    assert [frame.mixed.provenance.dropped for _, frame in rig.frames] == [None] * 15
    assert all(provenance.skew_ms < 1.0 for provenance in rig.provenances)


def test_a_reading_waits_at_most_a_period_and_a_stale_twin_is_dropped() -> None:
    def feed(rig: Rig) -> None:
        rig.twin(1.0)
        for k in range(5):
            rig.real(1.0 + 0.05 * k)

    rig = flown(lambda: Rig("merge: {aggregate: min}, max_skew_ms: 120", period_s=0.01), feed)
    assert [provenance.dropped for provenance in rig.provenances] == [
        None,
        None,
        None,
        "stale",
        "stale",
    ]
    assert [provenance.latency_ms for provenance in rig.provenances] == pytest.approx(
        [0.0, 10, 10, 10, 10]
    )
    values: list[Any] = [frame.mixed.reading for _, frame in rig.frames]
    assert [value.range_m for value in values] == [1.0, 1.0, 1.0, 2.0, 2.0]
    assert dict(rig.loop.mixer.counts().dropped) == {"stale": 2}


def test_a_recipe_may_be_slower_than_its_source() -> None:
    def feed(rig: Rig) -> None:
        for k in range(100):
            rig.real(1 + k / 50)
            rig.twin(1 + k / 50)

    rig = flown(lambda: Rig(rate_hz=20.0), feed, 4.0)
    assert len(rig.frames) == pytest.approx(40, abs=1)
    assert rig.loop.statistics.replaced == 0
    assert rig.loop.statistics.rate_hz == pytest.approx(20.0, rel=0.02)


def played(
    real: int,
    twin: int,
    *,
    ahead_s: float = 0.0,
    body: str = "merge: add",
    lost: range = range(0),
) -> Rig:
    """Return a rig that was played two constant sounds in blocks of so many samples, as they came.

    ahead_s: by how much the twin's blocks begin earlier. lost: the twin's blocks that never come.
    """
    rate = 16_000

    def feed(rig: Rig) -> None:
        for k in range(rate // real):
            block = sound(np.full(real, 1000), "real", rate)
            rig.real(1.0 + k * real / rate, late_s=real / rate, made=block)
        for k in range(rate // twin + 2):
            if k not in lost:
                block = sound(np.full(twin, 500), "twin", rate)
                rig.twin(1.0 - ahead_s + k * twin / rate, late_s=twin / rate + 0.01, made=block)

    return flown(lambda: Rig(body, sensor="microphone", period_s=real / rate), feed, 2.5)


@pytest.mark.parametrize("ahead_s", [0.0, 0.012, 0.00003])
@pytest.mark.parametrize(
    ("real", "twin"), [(512, 512), (1024, 512), (512, 1024), (512, 4096), (1000, 160)]
)
def test_all_of_the_twins_sound_is_in_the_mixtures(real: int, twin: int, ahead_s: float) -> None:
    rig = played(real, twin, ahead_s=ahead_s)
    assert len(rig.frames) == 16_000 // real
    first_s = 1.0 - ahead_s + twin / 16_000 + 0.01
    mixed: list[Any] = [frame.mixed for t_s, frame in rig.frames if t_s >= first_s]
    assert len(mixed) > 16_000 // real - 10
    assert {one.provenance.dropped for one in mixed} == {None}
    assert all((one.reading.samples == 1500).all() for one in mixed)
    assert max(one.provenance.skew_ms for one in mixed) == 0.0
    # A block waits for the one of the twin that ends after it.
    waits_ms = 1000.0 * (real + twin) / 16_000 + 10.0
    assert all(one.provenance.latency_ms <= waits_ms + 0.1 for one in mixed)


def test_a_filter_of_the_twins_sound_hears_all_of_it() -> None:
    passes = "filter: [{band_pass: {high_hz: 4000}}], merge: add"
    rig = played(1024, 512, body=passes)
    blocks: list[Any] = [frame.mixed.reading for _, frame in rig.frames]
    assert {provenance.dropped for provenance in rig.provenances} == {None}
    assert all(abs(block.samples - 1500).max() <= 1 for block in blocks[1:])
    # From the second on, each begins where the last one ended.
    times = [block.t_s for block in blocks]
    assert times == pytest.approx([1.0 - 200 / 16_000 + 0.064 * k for k in range(15)])


def test_sound_of_the_twin_that_is_lost_is_counted_and_delays_nothing() -> None:
    rig = played(1024, 512, lost=range(7, 9))
    dropped = {
        k: provenance.detail for k, provenance in enumerate(rig.provenances) if provenance.dropped
    }
    said = "the twin's sound covers 50 % of the block"
    assert dropped == {3: said, 4: said}
    assert dict(rig.loop.mixer.counts().dropped) == {"no_twin": 2}
    assert (len(rig.frames), rig.loop.statistics.replaced) == (15, 0)
    silent = played(512, 512, lost=range(10, 100))
    assert [provenance.dropped for provenance in silent.provenances] == [None] * 10 + [
        "no_twin"
    ] * 21
    assert max(provenance.latency_ms for provenance in silent.provenances) < 120.0


class Slow:
    """A twin that takes its time to answer."""

    def __init__(self, takes_s: float, answer: Any = None) -> None:
        self.takes_s = takes_s
        self.answer = answer or camera()
        self.asked: list[tuple[Pose, float]] = []

    async def ask(self, body: Pose, t_s: float, **_: bool) -> Any:

        self.asked.append((body, t_s))
        await asyncio.sleep(self.takes_s)
        now_s = asyncio.get_running_loop().time()
        return replace(self.answer, t_s=t_s, arrived_s=now_s, seq=len(self.asked))


REGISTERED = "transform: [register], merge: overlay"


def film(rig: Rig, rate_hz: float, *, seconds: float = 3.0, jitter_s: float = 0.0) -> None:
    """Feed the images of a live camera, and the poses that its vehicle has meanwhile."""
    loop = asyncio.get_running_loop()
    for k in range(round(100 * (seconds + 2.0))):
        pose = Pose((k * 0.01, 0, 0))
        loop.call_at(k * 0.01, rig.poses.add, k * 0.01, pose, (1.0, 0.0, 0.0))
    for k in range(round(rate_hz * seconds)):
        early_s = jitter_s * (-1) ** k
        rig.real(1 + k / rate_hz + early_s, late_s=0.02, made=camera(source="real"))


@pytest.mark.parametrize("rate_hz", [15.0, 30.0, 45.0, 100.0])
@pytest.mark.parametrize("takes_s", [0.0, 0.04])
def test_a_live_camera_of_any_rate_is_mixed_at_the_recipe_s(rate_hz: float, takes_s: float) -> None:
    rig = flown(
        lambda: Rig(
            REGISTERED, sensor="camera", twin=Slow(takes_s), period_s=1 / rate_hz, rate_hz=15.0
        ),
        lambda rig: film(rig, rate_hz),
        5.0,
    )
    assert {told.dropped for told in rig.provenances} == {None}
    assert rig.loop.mixer.counts().faults == ()
    assert len(rig.frames) == pytest.approx(45, abs=2)


def test_jitter_of_its_stamps_loses_no_image_of_a_camera_at_the_recipe_s_rate() -> None:
    rig = flown(
        lambda: Rig(REGISTERED, sensor="camera", twin=Slow(0.0), period_s=1 / 15, rate_hz=15.0),
        lambda rig: film(rig, 15.0, jitter_s=0.01),
        5.0,
    )
    assert len(rig.frames) == 45


def test_a_step_that_chooses_by_time_also_sees_readings_that_are_not_due() -> None:
    body = "transform: [register, {delay: {by_ms: 30, on: real}}], merge: overlay"
    rig = flown(
        lambda: Rig(body, sensor="camera", twin=Slow(0.04), period_s=1 / 45, rate_hz=15.0),
        lambda rig: film(rig, 45.0),
        5.0,
    )
    delays_s = [told.given_real_seq / 1000 - told.real_t_s for told in rig.provenances[1:]]
    assert delays_s == pytest.approx([2 / 45] * len(delays_s), abs=1e-3)
    assert rig.loop.mixer.counts().faults == ()


class Unsteady(Slow):
    """A twin whose simulator gives no image, or a late one, for some of the questions."""

    def __init__(self, *, fails: range = range(0), is_late: range = range(0)) -> None:
        super().__init__(0.0)
        self._fails, self._is_late = fails, is_late

    async def ask(self, body: Pose, t_s: float, **more: bool) -> Any:
        number = len(self.asked)
        self.takes_s = 0.4 if number in self._is_late else 0.0
        answer = await super().ask(body, t_s, **more)
        if number in self._fails:
            raise NoImageError("the simulator did not answer in 0.2 s")
        return answer


def watched(twin: Unsteady, budget: str = "") -> tuple[Rig, RunState]:
    """Return what came of a flight whose simulator is unsteady, its goal flown from 1 s on."""

    async def run() -> tuple[Rig, RunState]:
        run_state = RunState(time=asyncio.get_running_loop().time)
        rig = Rig(REGISTERED + budget, sensor="camera", twin=twin, period_s=1 / 15)
        watch = MixingBudgetWatch(run_state=run_state, is_any_silent=lambda _: False)
        watch.watch(rig.loop, 1 / 15)
        watching = asyncio.ensure_future(watch.run(lambda: None))
        film(rig, 15.0, seconds=5.0)
        asyncio.get_running_loop().call_at(1.0, run_state.enter, "goal")
        task = asyncio.ensure_future(rig.run(6.5))
        asyncio.get_running_loop().call_at(5.9, run_state.enter, "done")
        await task
        watching.cancel()
        await asyncio.wait([watching])
        return rig, run_state

    return run_virtual(run())


def test_an_image_that_is_missing_is_a_dropped_frame() -> None:
    rig, run_state = watched(Unsteady(fails=range(20, 23)))
    assert run_state.decisive == []
    assert rig.loop.statistics.missed == 3
    assert rig.loop.statistics.last_miss == "the simulator did not answer in 0.2 s"
    # Nothing is delivered for it: a bare image would say that nothing virtual is there.
    assert len(rig.frames) == 75 - 3
    assert {told.dropped for told in rig.provenances} == {None}


def test_a_step_that_chooses_by_time_sees_also_images_that_are_not_mixed() -> None:
    """Those that newer ones replaced, and those for which the twin's source gave no image."""
    body = "transform: [register, {delay: {by_ms: 60, on: real}}], merge: overlay"

    def chosen_by(twin: Slow) -> list[float]:
        rig = flown(
            lambda: Rig(body, sensor="camera", twin=twin, period_s=1 / 30),
            lambda rig: film(rig, 30.0),
            5.0,
        )
        assert rig.loop.mixer.counts().faults == ()
        assert rig.loop.statistics.replaced + rig.loop.statistics.missed > 20
        return [told.given_real_seq / 1000 - told.real_t_s for told in rig.provenances[2:]]

    for twin in (Slow(0.1), Unsteady(fails=range(1, 1000, 2))):
        delays_s = chosen_by(twin)
        assert delays_s == pytest.approx([2 / 30] * len(delays_s), abs=1e-3)


def test_an_image_that_is_late_is_a_dropped_frame() -> None:
    rig, run_state = watched(Unsteady(is_late=range(20, 21)), ", max_latency_ms: 200")
    assert run_state.decisive == []
    assert rig.loop.statistics.missed == 1
    assert rig.loop.statistics.last_miss.startswith("the twin's image came 4")


@pytest.mark.parametrize(
    ("budget", "fails", "said"),
    [
        ("", range(20, 40), "no mixed reading for more than 1 s: the simulator did not answer"),
        (", min_rate_hz: 13", range(20, 23), "min_rate_hz: "),
    ],
)
def test_more_than_the_budget_forgives_is_invalid(budget: str, fails: range, said: str) -> None:
    _, run_state = watched(Unsteady(fails=fails), budget)
    (event,) = run_state.decisive
    assert event.kind == "INVALID"
    assert event.text.startswith(f"mixing of s: {said}")


def test_images_that_come_while_one_is_mixed_make_way_for_the_newest() -> None:
    twin = Slow(0.1)

    def feed(rig: Rig) -> None:
        for k in range(300):
            rig.poses.add(k * 0.01, Pose((k * 0.01, 0, 0)), (1.0, 0.0, 0.0))
        for k in range(30):
            rig.real(1 + k / 30, made=camera(source="real"))

    rig = flown(lambda: Rig(REGISTERED, sensor="camera", twin=twin), feed, 3.0)
    # Every 100 ms, at most 33 ms old when its turn comes.
    assert len(rig.frames) + rig.loop.statistics.replaced == 30
    assert 9 <= len(rig.frames) <= 12
    assert max(provenance.latency_ms for provenance in rig.provenances) < 201
    assert [provenance.skew_ms for provenance in rig.provenances] == [0.0] * len(rig.provenances)


def test_small_readings_that_come_in_a_burst_are_all_mixed() -> None:
    def feed(rig: Rig) -> None:
        for k in range(20):
            one = replace(beam(2.0, "real"), t_s=1 + k * 0.005, arrived_s=1.2)
            asyncio.get_running_loop().call_at(1.2, rig.loop.real_reading, one)
            rig.twin(1 + k * 0.005)

    rig = flown(lambda: Rig(period_s=0.005), feed)
    assert len(rig.frames) == 20
    assert rig.loop.statistics.replaced == 0
    assert all(provenance.skew_ms == pytest.approx(0.0, abs=1e-6) for provenance in rig.provenances)


def test_a_picture_waits_for_the_pose_of_its_exposure() -> None:
    twin = Slow(0.0)

    def feed(rig: Rig) -> None:
        for k in range(200):
            add = (k * 0.01, Pose((k * 0.01, 0, 0)))
            asyncio.get_running_loop().call_at(k * 0.01 + 0.03, rig.poses.add, *add)
        rig.real(1.005, made=camera(source="real"))

    rig = flown(lambda: Rig(REGISTERED, sensor="camera", twin=twin), feed, 3.0)
    ((pose, t_s),) = twin.asked
    assert pose.position_ned_m[0] == pytest.approx(1.005)
    assert t_s == 1.005
    (provenance,) = rig.provenances
    assert provenance.alignment == "interpolated"
    assert provenance.latency_ms == pytest.approx(35.0, abs=2.1)


def test_a_frame_without_a_pose_is_dropped() -> None:
    twin = Slow(0.0)

    def feed(rig: Rig) -> None:
        rig.real(1.0, made=camera(source="real"))

    rig = flown(lambda: Rig(REGISTERED, sensor="camera", twin=twin), feed)
    assert (rig.provenances, twin.asked) == ([], [])
    statistics = rig.loop.statistics
    assert (statistics.missed, statistics.last_miss) == (1, "no pose for the exposure")


def test_a_vehicle_that_falls_silent_is_no_time_that_runs_backwards() -> None:
    """First its pose is predicted, then it is too old to be: the run was INVALID, not lost."""
    twin = Slow(0.0)

    def feed(rig: Rig) -> None:
        rig.poses.add(1.0, Pose((1.0, 0, 0)), (1.0, 0.0, 0.0))
        for k in range(3):
            rig.real(1.015 + k / 30, made=camera(source="real"))

    rig = flown(lambda: Rig(REGISTERED, sensor="camera", twin=twin), feed)
    assert [t_s for _, t_s in twin.asked] == [1.015]
    assert len(rig.provenances) == 1
    assert (rig.loop.statistics.missed, rig.loop.statistics.last_miss) == (
        2,
        "no pose for the exposure",
    )
    assert (rig.troubles, rig.loop.mixer.counts().faults) == ([], ())


@pytest.mark.parametrize(
    ("bad", "said"),
    [(beam(math.nan), "not a number"), (beam(-1.0), "-1.0 m"), (camera(), "of type camera")],
)
def test_a_bad_reading_of_the_twin_is_reported_and_never_mixed(bad: Any, said: str) -> None:
    def feed(rig: Rig) -> None:
        rig.twin(1.0)
        rig.twin(1.01, made=bad)
        rig.real(1.01)

    rig = flown(Rig, feed)
    (trouble,) = rig.troubles
    assert said in trouble
    (provenance,) = rig.provenances
    assert (provenance.twin_seq, provenance.dropped) == (1000, None)
    assert dict(rig.loop.mixer.counts().faults)


def test_time_that_runs_backwards_is_reported() -> None:
    def feed(rig: Rig) -> None:
        rig.twin(1.1)
        rig.twin(1.0, late_s=0.2)
        rig.real(1.1)

    rig = flown(Rig, feed)
    assert "time does not advance" in rig.troubles[0]


def test_the_registration_error_stands_in_the_provenance() -> None:
    twin = Slow(0.0)

    def feed(rig: Rig) -> None:
        rig.poses.add(1.0, Pose((0, 0, 0)))
        rig.real(1.0, made=camera(source="real"))

    rig = flown(
        lambda: Rig(
            REGISTERED, sensor="camera", twin=twin, registration=lambda *_: RegistrationError(1.25)
        ),
        feed,
    )
    assert rig.provenances[0].registration_error_px == 1.25
    assert rig.loop.statistics.registration_error_px.percentiles().p50 == 1.25


def test_the_registration_error_is_that_of_the_real_exposure() -> None:
    """A twin's picture of a later pose is not held against the truth of that later moment."""
    reported: list[tuple[float, float]] = []

    def registered(twin: Reading, exposed_s: float) -> RegistrationError:
        reported.append((twin.t_s, exposed_s))
        return RegistrationError(bound_px=2.5)

    def feed(rig: Rig) -> None:
        for k in range(200):
            rig.poses.add(k / 100, Pose((0, 0, 0)))
        rig.real(1.0, late_s=0.09, made=camera(source="real"))

    body = REGISTERED.replace("register", "{register: {align: latest}}")
    rig = flown(lambda: Rig(body, sensor="camera", twin=Slow(0.0), registration=registered), feed)
    assert rig.provenances[0].registration_error_px is None
    assert rig.provenances[0].registration_bound_px == 2.5
    ((drawn_s, exposed_s),) = reported
    assert drawn_s == pytest.approx(1.09)
    assert exposed_s == 1.0


def test_the_latency_includes_what_the_mixing_itself_takes() -> None:
    """On a clock that goes on meanwhile the autonomy gets the mixture only then."""

    def registered(_twin: Reading, _exposed_s: float) -> RegistrationError:
        time.sleep(0.05)
        return RegistrationError(bound_px=2.5)

    async def run() -> Rig:
        rig = Rig(REGISTERED, sensor="camera", twin=Slow(0.0), registration=registered)
        t_s = asyncio.get_running_loop().time()
        rig.poses.add(t_s, Pose((0, 0, 0)))
        rig.real(t_s, made=camera(source="real"))
        await rig.run(t_s + 0.2)
        return rig

    rig = asyncio.run(run())
    ((came_s, frame),) = rig.frames
    reading, provenance = frame.mixed.reading, frame.mixed.provenance
    assert frame.real is not None
    assert reading is not None
    assert provenance.latency_ms is not None
    assert reading.arrived_s == pytest.approx(came_s, abs=0.01)
    assert provenance.latency_ms == pytest.approx((came_s - frame.real.t_s) * 1e3, abs=10)
    assert provenance.latency_ms >= 50.0
    budget = MixingBudget(max_skew_s=0.1, max_latency_s=0.045)
    assert budget_breach(budget, provenance) is not None


def test_a_step_that_fails_ends_the_mixing_with_its_place(tmp_path: Any) -> None:
    (tmp_path / "mine.py").write_text("def half(work, other):\n    return 1 / 0\n")
    body = f"filter: [{{use: '{tmp_path}/mine.py:half'}}], merge: {{aggregate: min}}"

    def feed(rig: Rig) -> None:
        rig.twin(1.0)
        rig.real(1.0)

    with pytest.raises(StepError, match=r"r.yaml:4: step .*half, frame 0: ZeroDivisionError"):
        flown(lambda: Rig(body), feed)


class Flight:
    """A course in its goal, a mixing that is watched, and what was decided."""

    def __init__(self, body: str, period_s: float = 0.1) -> None:
        self.run_state = RunState(time=asyncio.get_running_loop().time)
        self.silent = False
        run_state = self.run_state
        self.watch = MixingBudgetWatch(run_state=run_state, is_any_silent=lambda _: self.silent)
        self.rig = Rig(body, period_s=period_s)
        self.watch.watch(self.rig.loop, period_s)

    def reason(self) -> tuple[str, str, float] | None:
        if not self.run_state.decisive:
            return None
        event = self.run_state.decisive[0]
        return event.kind, event.text, event.t_s

    def deliver(
        self, t_s: float, *, twin_s: float | None = None, late_s: float = 0.0, unbounded: str = ""
    ) -> None:

        def mix() -> None:
            now_s = asyncio.get_running_loop().time()
            real = replace(beam(2.0, "real"), t_s=t_s, arrived_s=now_s)
            at_s = t_s if twin_s is None else twin_s
            twin = replace(beam(1.0), t_s=at_s, arrived_s=now_s)
            mixed: Any = self.rig.loop.mixer.mix(real, twin, now_s=now_s)
            self.rig.loop.statistics.delivered(now_s)
            self.watch.frame(MixedFrame("s", "s", real, twin, mixed, unbounded=unbounded))

        asyncio.get_running_loop().call_at(t_s + late_s, mix)


def test_the_watch_stays_alive_after_it_has_decided_the_run() -> None:
    """Else the watchdog takes it for blocked, while an operator holds the vehicles in the air."""

    async def run() -> list[float]:
        flight, loop, alive_s = Flight(BODY), asyncio.get_running_loop(), list[float]()
        task = asyncio.ensure_future(flight.watch.run(lambda: alive_s.append(loop.time())))
        flight.run_state.enter("goal")
        flight.watch.note_doubt("the camera stopped")
        await asyncio.sleep(20.0)
        assert flight.reason() == ("INVALID", "the camera stopped", 0.0)
        assert len(flight.run_state.decisive) == 1
        task.cancel()
        await asyncio.wait([task])
        return alive_s

    assert run_virtual(run())[-1] > 19.0


def judged(
    body: str, feed: Callable[[Flight], Awaitable[None]], *, period_s: float = 0.1
) -> Flight:
    async def run() -> Flight:
        flight = Flight(body, period_s)
        task = asyncio.ensure_future(flight.watch.run(lambda: None))
        await feed(flight)
        task.cancel()
        await asyncio.wait([task])
        return flight

    return run_virtual(run())


async def goal_at(flight: Flight, t_s: float, until_s: float) -> None:
    await sleep_until(t_s)
    flight.run_state.enter("goal")
    await sleep_until(until_s)


BODY = "merge: {aggregate: min}"


@pytest.mark.parametrize(("silent_s", "decided"), [(0.95, 0), (1.05, 1), (1.2, 1)])
def test_a_stall_at_the_end_of_the_goal_counts_between_two_looks(
    silent_s: float, decided: int
) -> None:
    async def feed(flight: Flight) -> None:
        for k in range(40):
            flight.deliver(k * 0.1)
        await goal_at(flight, 1.0, 3.9 + silent_s)
        flight.run_state.enter("done")
        await sleep_until(8.0)

    texts = [event.text for event in judged(BODY, feed).run_state.decisive]
    assert texts == ["mixing of s: no mixed reading for more than 1 s"] * decided


def test_good_mixing_is_left_alone() -> None:
    async def feed(flight: Flight) -> None:
        for k in range(60):
            flight.deliver(k * 0.1)
        await goal_at(flight, 1.0, 5.9)

    assert judged(f"{BODY}, max_skew_ms: 20, min_rate_hz: 9", feed).reason() is None


@pytest.mark.parametrize(
    ("limit", "twin_s", "late_s", "said"),
    [
        ("max_skew_ms: 20", 2.95, 0.0, "exposures 50 ms apart, more than 20 ms"),
        ("max_skew_ms: 50", 2.9497, 0.0, "exposures 50.3 ms apart, more than 50 ms"),
        ("max_latency_ms: 40", 3.0, 0.06, "60 ms old at delivery, more than 40 ms"),
    ],
)
def test_one_reading_beyond_its_budget_makes_the_flight_invalid(
    limit: str, twin_s: float, late_s: float, said: str
) -> None:
    async def feed(flight: Flight) -> None:
        for k in range(60):
            bad = k == 30
            flight.deliver(k * 0.1, twin_s=twin_s if bad else None, late_s=late_s if bad else 0.0)
        await goal_at(flight, 1.0, 5.9)

    found = judged(f"{BODY}, {limit}", feed).reason()
    assert found is not None
    kind, text, t_s = found
    assert (kind, text) == ("INVALID", f"mixing of s: {said}")
    assert t_s == pytest.approx(3.0 + late_s)


@pytest.mark.parametrize("limit_px", [None, 8.0])
def test_a_limit_that_cannot_be_checked_makes_the_flight_invalid(
    limit_px: float | None,
) -> None:
    async def feed(flight: Flight) -> None:
        mixer: Any = flight.rig.loop.mixer
        budget = replace(mixer.combination.budget, max_registration_error_px=limit_px)
        mixer.combination = replace(mixer.combination, budget=budget)
        for k in range(60):
            flight.deliver(k * 0.1, unbounded="nobody knows" if k == 30 else "")
        await goal_at(flight, 1.0, 5.9)

    found = judged(BODY, feed).reason()
    said = "mixing of s: max_registration_error_px: 8, and nobody knows"
    assert (found and found[:2]) == (None if limit_px is None else ("INVALID", said))


def test_bad_mixing_before_the_goal_spoils_nothing() -> None:
    async def feed(flight: Flight) -> None:
        for k in range(60):
            flight.deliver(k * 0.1, twin_s=k * 0.1 - 0.5 if k < 9 else None)
        await goal_at(flight, 1.0, 5.9)

    assert judged(f"{BODY}, max_skew_ms: 20", feed).reason() is None


@pytest.mark.parametrize(
    ("stop_s", "until_s", "period_s", "is_good"),
    [
        (1.0, 1.9, 0.1, 0),
        (1.2, 1.9, 0.1, 1),
        (1, 1.2, 0.1, 1),
        (1, 6.0, 1000, 0),
        (1, 1.9, 1000, 1),
    ],
)
def test_a_short_flight_without_a_mixture_is_invalid(
    stop_s: float, until_s: float, period_s: float, is_good: int
) -> None:
    """`rate_hz: 0.001` of a recipe is no reason to pass without a mixture."""

    async def feed(flight: Flight) -> None:
        for k in range(round(stop_s * 10)):
            flight.deliver(k * 0.1)
        await goal_at(flight, 1.0, until_s)
        flight.run_state.enter("done")

    found = judged(BODY, feed, period_s=period_s).reason()
    said = "mixing of s: no mixed reading while the goal was flown"
    assert (found and found[:2]) == (None if is_good else ("INVALID", said))


@pytest.mark.parametrize(
    ("limit", "stop_s", "said"),
    [
        ("max_skew_ms: 20", 3.0, "mixing of s: no mixed reading for more than 1 s"),
        ("min_rate_hz: 9", 3.0, "mixing of s: min_rate_hz: "),
    ],
)
def test_a_source_that_stalls_or_slows_down_is_noticed(
    limit: str, stop_s: float, said: str
) -> None:
    async def feed(flight: Flight) -> None:
        for k in range(int(stop_s * 10)):
            flight.deliver(k * 0.1)
        await goal_at(flight, 1.0, 5.9)

    found = judged(f"{BODY}, {limit}", feed).reason()
    assert found is not None
    assert found[0] == "INVALID"
    assert found[1].startswith(said)
    assert stop_s < found[2] < stop_s + 1.5


def test_nothing_is_blamed_on_the_mixing_while_a_vehicle_is_silent() -> None:
    async def feed(flight: Flight) -> None:
        for k in range(30):
            flight.deliver(k * 0.1)
        flight.silent = True
        await goal_at(flight, 1.0, 7.1)
        assert flight.reason() is None
        flight.silent = False
        await sleep_until(8.0)

    found = judged(BODY, feed).reason()
    assert found is not None
    assert found[0] == "INVALID"
    # What `link` and the guard say of the silence comes first.
    assert found[2] > 7.1


def test_a_breach_is_not_forgotten_over_a_link_that_comes_and_goes() -> None:
    async def feed(flight: Flight) -> None:
        flight.run_state.enter("goal")
        for _ in range(10):
            flight.silent = True
            await asyncio.sleep(0.9)
            flight.silent = False
            await asyncio.sleep(0.3)

    found = judged(BODY, feed).reason()
    assert found is not None
    assert found[0] == "INVALID"


def seen_by(publish: str, **shown: bool) -> Any:
    """Return a mixing loop of which ten mixtures were measured, each with these objects in view."""
    coverage = VisibilityCoverage()
    for k in range(10):
        objects = tuple(
            ObjectVisibility(name, True, 0.1, 1.0 if is_shown else 0.0, is_shown, None, 10.0, "px")
            for name, is_shown in shown.items()
        )
        coverage.observe(FrameVisibility(k * 0.2, objects))
    mixer = SimpleNamespace(
        publish=(publish,), combination=SimpleNamespace(budget=MixingBudget(max_skew_s=0.02))
    )
    probe = SimpleNamespace(coverage=coverage, why_nothing=lambda: "")
    told = SimpleNamespace(last_delivery_s=0.0)
    return SimpleNamespace(name=f"camera.{publish}", mixer=mixer, probe=probe, statistics=told)


@pytest.mark.parametrize(
    ("twins", "verdicts"), [({"gate": True, "wall": True}, ["INVALID"]), ({"gate": True}, [])]
)
def test_images_of_the_twins_autonomy_prove_nothing_for_the_judged_vehicle(
    twins: dict[str, bool], verdicts: list[str]
) -> None:
    async def fly() -> RunState:
        run_state = RunState(time=asyncio.get_running_loop().time)
        watch = MixingBudgetWatch(run_state=run_state, is_any_silent=lambda _: False)
        reals = {"gate": True} if not verdicts else {"gate": True, "wall": False}
        for loop in (seen_by("real", **reals), seen_by("twin", **twins)):
            watch.watch(loop, 0.1)
        run_state.enter("goal")
        run_state.enter("done")
        return run_state

    run_state = run_virtual(fly())
    assert [event.kind for event in run_state.decisive] == verdicts
    assert all("wall" in event.text for event in run_state.decisive)


def test_what_was_never_shown_is_named_beside_what_was_not_delivered() -> None:
    """Of two reasons the second was lost; a control may ask for either."""

    async def fly() -> RunState:
        loop = asyncio.get_running_loop()
        run_state = RunState(time=loop.time)
        watch = MixingBudgetWatch(run_state=run_state, is_any_silent=lambda _: False)
        watch.watch(seen_by("real", gate=False), 0.1)
        vars(watch.loops[0].statistics)["last_miss"] = ""
        await asyncio.sleep(1.0)
        run_state.enter("goal")
        await asyncio.sleep(1.15)
        run_state.enter("done")
        return run_state

    texts = [event.text for event in run_virtual(fly()).decisive]
    assert [text.partition(": ")[2][:14] for text in texts] == ["no mixed readi", "the mixture ne"]
