"""The operator changes the fences in flight: obeyed, refused, and what is judged by afterwards."""

from collections.abc import Callable
from pathlib import Path

import pytest

from orchestrator.model.results import FenceChange, RunResult
from safety.guard.core.operator_command import OperatorCommand
from tests.orchestrator.flights import all_landed, log_of

Fly = Callable[..., tuple[RunResult, Path]]
TIGHTER = "box: {north_m: [-0.9, 4.7], east_m: [-1.5, 1.5], up_m: [-0.5, 2.0]}"
NARROW = "box: {north_m: [-0.9, 1.5], east_m: [-1.5, 1.5], up_m: [-0.5, 2.0]}"
ELSEWHERE = "box: {north_m: [20, 24], east_m: [-1.5, 1.5], up_m: [-0.5, 2.0]}"


class Asks:
    """Changes the fence when it is polled for the hundredth time: 5 s after the start of both."""

    def __init__(self, document: str) -> None:
        self.command = OperatorCommand("geofence", "anna", document=document, command_id="a1")
        self.polled = 0

    def poll(self) -> OperatorCommand | None:
        self.polled += 1
        return self.command if self.polled == 300 else None


def guard_events(folder: Path) -> list[tuple[str, str]]:
    kinds = {"geofence", "refused", "fence"}
    lines = [line for line in log_of(folder) if line["event"] == "guard" and line["kind"] in kinds]
    return [(line["kind"], line["text"]) for line in lines]


def test_a_new_fence_holds_for_both_and_the_flight_goes_on(fly_run: Fly) -> None:
    result, folder = fly_run(inbox=Asks(TIGHTER))
    assert (result.verdict, result.reason) == ("PASS", "")
    assert guard_events(folder) == [("geofence", "anna changed the fence of real and twin")]
    (asked,) = [line for line in log_of(folder) if line["event"] == "operator"]
    assert (asked["kind"], asked["who"]) == ("geofence", "anna")
    (answered,) = [line for line in log_of(folder) if line["event"] == "answer"]
    (change,) = result.fence_changes
    assert change.at_s == pytest.approx(answered["t_s"], abs=1e-6)
    assert change == FenceChange(change.at_s, "anna", ("real", "twin"))


def test_whoever_leaves_the_new_fence_is_brought_down(fly_run: Fly) -> None:
    result, folder = fly_run(inbox=Asks(NARROW))
    assert result.verdict == "FAIL"
    assert [kind for kind, _ in guard_events(folder)][:2] == ["geofence", "fence"]
    assert all_landed(folder)


@pytest.mark.parametrize(
    ("document", "why"),
    [
        (ELSEWHERE, "outside of the fence's side"),
        ("box: {north_m: [4, -4], east_m: [-1, 1], up_m: [0, 2]}", ""),
        ("real: {}", ""),
        ("no fence at all", ""),
        ("{", ""),
        ('{"type": "FeatureCollection", "features": []}', ""),
        ("keep_m: 3\n" + TIGHTER, ""),
    ],
)
def test_a_fence_that_cannot_be_is_refused_and_the_old_one_holds(
    fly_run: Fly, document: str, why: str
) -> None:
    result, folder = fly_run(inbox=Asks(document), mode="sim")
    assert (result.verdict, result.reason) == ("PASS", "")
    said = guard_events(folder)
    assert [kind for kind, _ in said] == (["refused"] if why else [])
    assert not why or why in said[0][1]
    assert result.fence_changes == ()
