"""When what the mixtures of a run showed proves that it proves nothing."""

from dataclasses import replace

import pytest

from wil_campaign.recipes.visibility.coverage import (
    VisibilityCoverage,
    VisibilityFault,
    uncovered_objects,
)
from wil_campaign.recipes.visibility.model import FrameVisibility, ObjectVisibility


def seen(
    t_s: float, *, in_view: bool = True, shown: bool = True, offset: float = 2.0, name: str = "gate"
) -> FrameVisibility:
    found = ObjectVisibility(
        name=name,
        in_view=in_view,
        expected=0.1 if in_view else 0.0,
        shown=1.0 if shown else 0.0,
        is_shown=shown and in_view,
        offset=offset if shown and in_view else None,
        limit=10.0,
        unit="px",
    )
    return FrameVisibility(t_s, (found,))


def flown(frames: list[FrameVisibility]) -> tuple[VisibilityCoverage, VisibilityFault | None]:
    coverage = VisibilityCoverage()
    faults = [coverage.observe(frame) for frame in frames]
    return coverage, next((fault for fault in faults if fault is not None), None)


def test_an_object_shown_in_its_place_is_no_fault() -> None:
    coverage, fault = flown([seen(k / 5) for k in range(50)])
    assert fault is None
    assert coverage.never_shown() is None
    assert uncovered_objects([coverage]) is None
    gate = coverage.objects["gate"]
    assert (gate.in_view, gate.shown, list(gate.offsets)) == (50, 50, [2.0] * 50)


def test_an_object_in_view_for_two_seconds_and_never_shown_is_a_fault_at_once() -> None:
    _, fault = flown([seen(3.0 + k / 5, shown=False) for k in range(50)])
    assert fault == VisibilityFault(
        3.0, "the mixture never showed gate: it was in view in 11 measured frames, 0 showed it"
    )


def test_an_object_never_shown_is_a_fault_at_the_end_of_a_short_flight() -> None:
    coverage, fault = flown([seen(k / 5, shown=False) for k in range(6)])
    assert fault is None
    never = coverage.never_shown()
    assert never is not None
    assert never.text.startswith("the mixture never showed gate")


def test_an_object_that_was_never_in_view_need_not_be_shown() -> None:
    coverage, fault = flown([seen(k / 5, in_view=False) for k in range(50)])
    assert fault is None
    assert coverage.never_shown() is None
    assert uncovered_objects([coverage]) is None


@pytest.mark.parametrize(
    ("in_view", "frames", "is_fault"),
    [(4, 5, True), (4, 4, True), (2, 30, True), (1, 1, True), (1, 30, False)],
    ids=["1 Hz", "a goal of 0.7 s", "two frames", "the only frame", "one of many"],
)
def test_an_object_never_shown_is_a_fault_also_in_few_frames(
    in_view: int, frames: int, is_fault: bool
) -> None:
    """One frame of many may be at the edge of the picture; two, or the only one, are not."""
    coverage, fault = flown(
        [seen(float(k), in_view=k >= frames - in_view, shown=False) for k in range(frames)]
    )
    assert fault is None
    found = uncovered_objects([coverage])
    assert (found is not None) == is_fault
    if found is not None:
        said = f"it was in view in {in_view} measured frames, 0 showed it"
        assert found.text == f"the mixture never showed gate: {said}"


@pytest.mark.parametrize("shown", [1, 2])
def test_a_share_of_few_frames_is_no_fault(shown: int) -> None:
    coverage, _ = flown([seen(float(k), shown=k < shown) for k in range(4)])
    assert uncovered_objects([coverage]) is None


@pytest.mark.parametrize(
    ("shown", "is_fault"),
    [(range(0, 50, 9), True), (range(2, 50, 2), True), (range(0, 50, 2), False)],
)
def test_an_object_hardly_shown_is_a_fault_at_the_end(shown: range, is_fault: bool) -> None:
    coverage, fault = flown([seen(k / 5, shown=k in shown) for k in range(50)])
    assert fault is None
    found = uncovered_objects([coverage])
    assert (found is not None) == is_fault
    if found is not None:
        assert "hardly showed gate" in found.text
        assert f"in view in 50 measured frames, {len(shown)} showed it" in found.text


def test_an_object_that_is_not_shown_any_more_is_a_fault_after_two_seconds() -> None:
    """Shown in the first half of its frames and in none of the last 5 s, it was a PASS."""
    _, fault = flown([seen(k / 5, shown=k < 25) for k in range(50)])
    text = "the mixture does not show gate any more from 5.000 s on, though in view in 11 measured"
    assert fault == VisibilityFault(5.0, f"{text} frames in a row")


@pytest.mark.parametrize("is_gone", [True, False])
def test_an_object_that_was_out_of_view_or_shown_between_is_not_lost(is_gone: bool) -> None:
    frames = [
        seen(k / 5, in_view=bool(k % 8) or not is_gone, shown=k < 5 or not k % 8) for k in range(30)
    ]
    assert flown(frames)[1] is None


@pytest.mark.parametrize(("shown", "is_fault"), [(25, True), (4, False)])
def test_an_object_is_lost_also_while_another_one_is_shown(shown: int, is_fault: bool) -> None:
    """What was shown in a frame or two may have been another object beside it."""

    def frame(k: int) -> FrameVisibility:
        return FrameVisibility(
            k / 5,
            (*seen(k / 5, name="person").objects, *seen(k / 5, shown=k < shown).objects),
        )

    _, fault = flown([frame(k) for k in range(50)])
    assert (fault is not None) == is_fault
    if fault is not None:
        assert fault.t_s == 5.0
        assert "does not show gate any more from 5.000 s on" in fault.text


def test_what_another_combination_shows_is_not_lost_from_this_one() -> None:
    """Of two cameras one may show the gate, and the other a person who leaves its view."""

    def frame(k: int) -> FrameVisibility:
        person = seen(k / 5, in_view=k < 20, name="person").objects
        return FrameVisibility(k / 5, (*person, *seen(k / 5, shown=False).objects))

    assert flown([frame(k) for k in range(50)])[1] is None


def test_another_sensor_may_show_it() -> None:
    blind, _ = flown([seen(k / 5, shown=False) for k in range(8)])
    lidar, _ = flown([seen(k / 5) for k in range(8)])
    assert uncovered_objects([blind, lidar]) is None
    assert uncovered_objects([blind]) is not None


def test_one_displaced_frame_is_looked_at_more_closely_and_two_are_a_fault() -> None:
    coverage = VisibilityCoverage()
    assert coverage.observe(seen(1.0, offset=87.0)) is None
    assert coverage.is_suspect()
    assert coverage.observe(seen(1.07)) is None
    assert not coverage.is_suspect()
    assert coverage.observe(seen(2.0, offset=87.0)) is None
    fault = coverage.observe(seen(2.067, offset=86.0))
    assert fault is not None
    said = "the mixture shows gate 86 px from its place at 2.067 s; the limit is 10 px"
    assert fault.text == said


def test_a_missed_frame_is_looked_at_more_closely_until_a_second_one_confirms_it() -> None:
    """What stays missed is measured no oftener than what is shown."""
    coverage = VisibilityCoverage()
    suspect = []
    for k, is_shown in enumerate((True, False, True, False, False, False)):
        coverage.observe(seen(float(k), shown=is_shown))
        suspect.append(coverage.is_suspect())
    assert suspect == [False, True, False, True, False, False]
    coverage.observe(seen(9.0))
    coverage.observe(seen(10.0, shown=False))
    coverage.observe(seen(11.0, in_view=False))
    assert not coverage.is_suspect()


@pytest.mark.parametrize(("shows", "share"), [("MSMMS", 2 / 5), ("SSM", 2 / 3), ("MS", 1 / 2)])
def test_what_only_confirms_a_miss_counts_in_no_share(shows: str, share: float) -> None:
    """Of frames measured one by one, at each phase of what is shown by turns."""
    coverage = VisibilityCoverage()
    for first in range(len(shows)):
        coverage.observe(seen(10.0 * first, shown=shows[first] == "S"))
        following = shows[(first + 1) % len(shows)]
        if coverage.is_suspect():
            confirming = seen(10.0 * first + 0.07, shown=following == "S")
            coverage.observe(replace(confirming, confirms=True))
        coverage.observe(seen(10.0 * first + 5.0, in_view=False))
    gate = coverage.objects["gate"]
    assert gate.due_shown / gate.due == pytest.approx(share)
    assert gate.is_covered == (share >= 0.5)
    fault = uncovered_objects([coverage])
    assert (fault is None) == (share >= 0.5)
    if fault is not None:
        assert "in view in 5 measured frames, 2 showed it" in fault.text


def test_what_only_confirms_hides_no_object_that_every_second_frame_displaces() -> None:
    """With it a third of the frames, no more, would be displaced."""
    by_turns = [
        frame
        for k in range(6)
        for frame in (
            seen(k, offset=87.0),
            replace(seen(k + 0.07), confirms=True),
            seen(k + 0.2),
        )
    ]
    _, fault = flown([seen(-1.0), seen(-0.8), *by_turns])
    assert fault is not None
    assert fault.text.startswith("the mixture shows gate 87 px from its place")


def test_objects_left_out_by_name_are_counted() -> None:
    coverage, fault = flown([FrameVisibility(float(k), not_mixed=("intruder",)) for k in range(4)])
    assert fault is None
    assert coverage.not_mixed == {"intruder": 4}
    assert uncovered_objects([coverage]) is None


def test_something_virtual_where_nothing_is_due_is_a_fault() -> None:
    coverage = VisibilityCoverage()
    frame = FrameVisibility(1.0, elsewhere=0.05, is_unexpected=True)
    assert coverage.observe(frame) is None
    fault = coverage.observe(frame)
    assert fault is not None
    assert "5.0 % of the reading" in fault.text


def test_a_frame_that_cannot_be_measured_is_reported_and_not_counted() -> None:
    coverage, fault = flown([FrameVisibility(1.0, not_measured="no reference pose")] * 20)
    assert fault is None
    assert (coverage.frames, coverage.why_not_measured()) == (0, "no reference pose")


def test_a_flight_without_a_mixture_is_not_measured() -> None:
    assert VisibilityCoverage().why_not_measured() == "no mixture was made while the goal was flown"
    assert flown([seen(1.0)])[0].why_not_measured() == ""


@pytest.mark.parametrize("shown", [True, False], ids=["in its place", "not shown"])
def test_every_second_mixture_elsewhere_is_a_fault(shown: bool) -> None:
    frames = [seen(k / 5, offset=80.0) if k % 2 else seen(k / 5, shown=shown) for k in range(20)]
    _, fault = flown(frames)
    assert fault is not None
    assert fault.text.startswith("the mixture shows gate 80 px from its place at ")


def test_one_mixture_elsewhere_now_and_then_is_no_fault() -> None:
    _, fault = flown([seen(k / 5, offset=80.0 if k % 4 == 3 else 2.0) for k in range(40)])
    assert fault is None


def test_a_displaced_object_that_stays_missed_is_measured_at_the_usual_pace() -> None:
    frames = [seen(0.0), seen(0.2, offset=80.0), seen(0.3, shown=False), seen(0.4, shown=False)]
    assert [flown(frames[: k + 1])[0].is_suspect() for k in range(4)] == [False, True, True, False]


@pytest.mark.parametrize(("sees_at", "is_fault"), [(-1, True), (6, False)])
def test_a_real_sensor_that_is_covered_for_two_seconds_is_a_fault(
    sees_at: int, is_fault: bool
) -> None:
    coverage = VisibilityCoverage()
    faults = [
        coverage.observe(FrameVisibility(1.0 + k / 5, is_blind=k != sees_at)) for k in range(12)
    ]
    found = next((fault for fault in faults if fault is not None), None)
    assert (found is not None) == is_fault
    if found is not None:
        assert found.t_s == 1.0
        assert found.text.startswith("the mixture has nothing of the real sensor from 1.000 s on")
