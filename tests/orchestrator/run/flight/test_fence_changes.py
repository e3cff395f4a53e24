"""The operator changes the fences in flight: obeyed, refused, and what is judged by afterwards."""

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.orchestrator.conftest import BRIEF
from tests.orchestrator.flights import all_landed, log_of
from wil_campaign.orchestrator.run_results.run_result import FenceChange, RunResult
from wil_campaign.safety.guard.core.operator_command import OperatorCommand

Fly = Callable[..., tuple[RunResult, Path]]
TIGHTER = "box: {north_m: [-0.9, 4.7], east_m: [-1.5, 1.5], up_m: [-0.5, 2.0]}"
NARROW = "box: {north_m: [-0.9, 1.5], east_m: [-1.5, 1.5], up_m: [-0.5, 2.0]}"
ELSEWHERE = "box: {north_m: [20, 24], east_m: [-1.5, 1.5], up_m: [-0.5, 2.0]}"


AHEAD = (*BRIEF, "autonomy.with={speed_m_s: 0.4, for_s: 5}")
BAD = (
    ELSEWHERE,
    "box: {north_m: [4, -4], east_m: [-1, 1], up_m: [0, 2]}",
    "real: {}",
    "no fence at all",
    "{",
    '{"type": "FeatureCollection", "features": []}',
    "keep_m: 3\n" + TIGHTER,
)


class Asks:
    """Changes the fence when it is polled for the 300th time, and again at every fifth."""

    def __init__(self, *documents: str) -> None:
        self.documents = list(documents)
        self.polled = 0

    def poll(self) -> OperatorCommand | None:
        self.polled += 1
        if self.polled < 300 or self.polled % 5 or not self.documents:
            return None
        return OperatorCommand(
            "geofence", "anna", document=self.documents.pop(0), command_id=f"a{self.polled}"
        )


def guard_events(folder: Path) -> list[tuple[str, str]]:
    kinds = {"geofence", "refused", "fence"}
    lines = [line for line in log_of(folder) if line["event"] == "guard" and line["kind"] in kinds]
    return [(line["kind"], line["text"]) for line in lines]


def test_a_new_fence_holds_for_both_and_the_flight_goes_on(fly_run: Fly) -> None:
    result, folder = fly_run(boots=True, inbox=Asks(TIGHTER), sets=AHEAD)
    assert (result.verdict, result.reason) == ("PASS", "")
    assert guard_events(folder) == [("geofence", "anna changed the fence of real and twin")]
    (asked,) = [line for line in log_of(folder) if line["event"] == "operator"]
    assert (asked["kind"], asked["who"]) == ("geofence", "anna")
    (answered,) = [line for line in log_of(folder) if line["event"] == "answer"]
    (change,) = result.fence_changes
    assert change.at_s == pytest.approx(answered["t_s"], abs=1e-6)
    assert change == FenceChange(change.at_s, "anna", ("real", "twin"))


def test_a_first_fence_holds_where_there_was_none(fly_run: Fly) -> None:
    sets = ("geofence=null", "oracles={landed: {}, reached: {required: false}}", "controls={}")
    result, folder = fly_run(boots=True, inbox=Asks(TIGHTER), sets=(*AHEAD, *sets))
    assert (result.verdict, result.reason) == ("PASS", "")
    assert guard_events(folder) == [("geofence", "anna changed the fence of real and twin")]
    narrow, fallen = fly_run(boots=True, inbox=Asks(NARROW), sets=sets)
    assert narrow.verdict == "FAIL"
    assert [kind for kind, _ in guard_events(fallen)][:2] == ["geofence", "fence"]
    assert all_landed(fallen)


def test_a_vehicle_that_leaves_the_new_fence_is_brought_down(fly_run: Fly) -> None:
    result, folder = fly_run(boots=True, inbox=Asks(NARROW))
    assert result.verdict == "FAIL"
    assert [kind for kind, _ in guard_events(folder)][:2] == ["geofence", "fence"]
    assert all_landed(folder)


def test_impossible_fences_are_refused_and_the_old_one_holds(fly_run: Fly) -> None:
    result, folder = fly_run(boots=True, inbox=Asks(*BAD), mode="sim", sets=AHEAD)
    assert (result.verdict, result.reason) == ("PASS", "")
    answers = [line for line in log_of(folder) if line["event"] == "answer"]
    assert [line["ok"] for line in answers] == [False] * len(BAD)
    assert not [line for line in answers if "landing" in line["text"]]
    assert not [line for line in answers if "in progress" in line["text"]]
    ((kind, said),) = guard_events(folder)
    assert kind == "refused"
    assert "outside of the fence's" in said
    assert result.fence_changes == ()
