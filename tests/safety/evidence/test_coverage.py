"""What makes a signal no evidence, and what does not."""

import math
import re
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wil_campaign.safety.evidence.evidence import Evidence
from wil_campaign.safety.evidence.terms import (
    STAMP_S,
    SignalTerms,
    position_limit_s,
    status_limit_s,
)
from wil_campaign.safety.model.oracle_results import EvidenceResult
from wil_campaign.safety.model.samples import (
    DoubtSample,
    DropOutSample,
    LinkSample,
    PoseSample,
    ReportSample,
    Stage,
    StageSample,
    StateSample,
)
from wil_campaign.vehicles.autopilots.autopilot import FlightMode
from wil_campaign.worlds.frames import Pose

LIMIT_S = 0.1
END_S = 10.0


def terms(signal: str = "pose", *, required: bool = True, over_link: bool = False) -> SignalTerms:
    return SignalTerms(
        signal=signal,
        vehicle="real",
        source="mocap",
        limit_s=LIMIT_S,
        required=required,
        over_link=over_link,
    )


def pose(t_s: float, north_m: float | None = None) -> PoseSample:
    return PoseSample(t_s, "real", Pose((t_s if north_m is None else north_m, 0, -1)), (1, 0, 0))


class Flight:
    """Feeds evidence the samples of a flight from takeoff at 1 s to landed at 9 s."""

    def __init__(self, *signals: SignalTerms) -> None:
        self.evidence = Evidence(signals or (terms(),))
        self.silent: list[tuple[float, float]] = []
        self.frozen: tuple[float, float] = (math.inf, math.inf)
        self.deaf: tuple[float, float] = (math.inf, math.inf)
        self.late_s = 0.0
        self.landed = False

    def fly(self) -> EvidenceResult:
        stages: dict[int, Stage] = {
            100: "takeoff", 200: "at_height", 300: "goal", 600: "done", 700: "land", 900: "landed"
        }  # fmt: skip
        late: list[PoseSample] = []
        for tick in range(1, int(END_S * 100)):
            t_s = tick / 100
            if tick in stages:
                self.evidence.stage(StageSample(t_s, stages[tick]))
            if tick % 2 == 0 and not any(low <= t_s < high for low, high in self.silent):
                begin_s, end_s = self.frozen
                late.append(pose(t_s, begin_s if begin_s <= t_s < end_s else None))
            while late and late[0].t_s <= t_s - self.late_s:
                self.evidence.pose(late.pop(0))
            if tick % 10 == 0:
                if not self.deaf[0] <= t_s < self.deaf[1]:
                    self.evidence.received(LinkSample(t_s - 0.001, "real"))
                up = 2.0 <= t_s < 8.9 and not self.landed
                self.evidence.state(
                    StateSample(t_s, "real", True, FlightMode.GUIDED, landed=not up)
                )
                self.evidence.tick(t_s)
        self.evidence.stage(StageSample(END_S, "end"))
        return self.evidence.results()[0]


def test_a_whole_flight_is_evidence_from_takeoff_to_landed() -> None:
    flight = Flight()
    result = flight.fly()
    assert flight.evidence.events == []
    assert (result.verdict, result.reason, result.count) == ("PASS", "", 401)
    assert (result.first_s, result.last_s) == (1.0, 9.0)
    assert result.largest_gap_s == pytest.approx(0.02)


@pytest.mark.parametrize("silent", [(1.0, 1.2), (4.0, 4.12), (7.5, 8.5), (8.8, 11.0), (0.5, 11.0)])
def test_a_gap_anywhere_between_takeoff_and_landed_is_invalid_at_its_time(
    silent: tuple[float, float],
) -> None:
    flight = Flight()
    flight.silent = [silent]
    result = flight.fly()
    (event,) = flight.evidence.events
    assert (event.kind, event.source) == ("INVALID", "evidence/pose/real")
    since_s = max(1.0, silent[0] - 0.02)
    assert event.t_s == pytest.approx(since_s + LIMIT_S)
    found = re.match(r"pose of real from mocap: no sample for (\d+\.\d\d) s", event.text)
    assert found is not None, "the text has the silence's length, not times of the run clock"
    assert LIMIT_S < float(found[1]) <= min(silent[1] - since_s, LIMIT_S + 0.65) + 0.005
    assert result.verdict == "INVALID"
    assert result.gap_at_s == pytest.approx(since_s)


@pytest.mark.parametrize("silent", [(0.2, 0.9), (4.0, 4.05), (9.1, 11.0)])
def test_samples_may_be_missing_on_the_ground_and_within_the_limit(
    silent: tuple[float, float],
) -> None:
    flight = Flight()
    flight.silent = [silent]
    assert flight.fly().verdict == "PASS"


def test_a_late_sample_is_no_gap() -> None:
    flight = Flight()
    flight.late_s = 0.3
    assert flight.fly().verdict == "PASS"


def test_a_source_that_ended_is_found_in_flight() -> None:
    flight = Flight()
    flight.silent = [(4.0, math.inf)]
    flight.fly()
    (event,) = flight.evidence.events
    assert "no sample for 0.72 s; 1.08 s after the goal" in event.text


def test_a_gap_just_beyond_the_limit_is_shown_beyond_it() -> None:
    evidence = Evidence((replace(terms(), limit_s=1.0),))
    evidence.stage(StageSample(1.0, "takeoff"))
    evidence.pose(pose(1.0))
    evidence.pose(pose(2.0004))
    (event,) = evidence.events
    assert "no sample for 1.0004 s against 1 s" in event.text


def test_a_silent_link_is_judged_by_others_before_its_gap_counts() -> None:
    flight = Flight(terms(over_link=True))
    flight.silent = [(4.0, 6.0)]
    flight.deaf = (4.05, 6.0)
    flight.fly()
    (event,) = flight.evidence.events
    assert event.t_s == pytest.approx(6.0)
    assert "no sample for 2.02 s against 0.1 s" in event.text


def test_a_link_that_brings_all_but_positions_hides_nothing() -> None:
    flight = Flight(terms(over_link=True))
    flight.silent = [(4.0, 6.0)]
    flight.fly()
    (event,) = flight.evidence.events
    assert event.t_s == pytest.approx(3.98 + LIMIT_S)


@pytest.mark.parametrize("since_s", [2.5, 4.0, 7.2])
def test_positions_that_repeat_in_the_air_are_none(since_s: float) -> None:
    flight = Flight()
    flight.frozen = (since_s, since_s + 0.2)
    result = flight.fly()
    (event,) = flight.evidence.events
    assert event.t_s == pytest.approx(since_s + LIMIT_S)
    assert "it repeats one position" in result.reason


def test_nothing_has_to_move_on_the_ground() -> None:
    for frozen in ((0.0, 1.99), (8.9, 11.0)):
        flight = Flight()
        flight.frozen = frozen
        assert flight.fly().verdict == "PASS"


def test_a_vehicle_that_reports_standing_is_not_believed_in_the_air() -> None:
    flight = Flight()
    flight.landed, flight.frozen = True, (4.0, 5.0)
    assert flight.fly().verdict == "INVALID"


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_pose_that_is_no_number_is_invalid_and_not_judged(value: float) -> None:
    for signals in ((terms(),), ()):
        evidence = Evidence(signals)
        evidence.stage(StageSample(1.0, "takeoff"))
        assert evidence.pose(pose(1.05))
        assert not evidence.pose(pose(1.1, value))
        (event,) = evidence.events
        assert (event.t_s, event.kind) == (1.1, "INVALID")
        assert "it is not a number" in event.text


def test_a_signal_that_nothing_required_rests_on_is_only_reported() -> None:
    flight = Flight(terms(required=False))
    flight.silent = [(4.0, 5.0)]
    assert flight.fly().verdict == "INVALID"
    assert flight.evidence.events == []


def test_reports_have_a_coverage_of_their_own() -> None:
    evidence = Evidence((terms("battery"),))
    evidence.stage(StageSample(1.0, "takeoff"))
    for index in range(10):
        evidence.report(ReportSample(1.0 + index * 0.05, "real", "battery"))
    assert evidence.events == []
    evidence.stage(StageSample(2.0, "landed"))
    evidence.stage(StageSample(3.0, "end"))
    (event,) = evidence.events
    assert event.text == (
        "battery of real from mocap: no sample for 0.55 s against 0.1 s"
        "; 0.55 s after the takeoff command"
    )


@pytest.mark.parametrize("signals", [(), (terms("camera"),)])
def test_a_doubted_signal_is_invalid_with_its_name_and_time(
    signals: tuple[SignalTerms, ...],
) -> None:
    evidence = Evidence(signals)
    for t_s in (4.5, 5.0):
        evidence.doubt(DoubtSample(t_s, "real", "camera", "mocap", "the gate is not in it"))
    (event,) = evidence.events
    assert (event.t_s, event.text) == (4.5, "camera of real from mocap: the gate is not in it")
    (result,) = evidence.results()
    assert (result.verdict, result.reason) == ("INVALID", event.text)


@given(st.lists(st.floats(0.0, 12.0), max_size=60))
def test_no_order_of_stamps_hides_a_gap(stamps: list[float]) -> None:
    evidence = Evidence((terms("battery"),))
    evidence.stage(StageSample(1.0, "takeoff"))
    for t_s in stamps:
        evidence.report(ReportSample(t_s, "real", "battery"))
    evidence.stage(StageSample(9.0, "landed"))
    evidence.stage(StageSample(10.0, "end"))
    newest, seen = -math.inf, [1.0]
    for t_s in stamps:
        if t_s > newest:
            newest = t_s
            seen.append(min(max(t_s, 1.0), 9.0))
    gaps = [b - a for a, b in zip(seen, [*seen[1:], 9.0], strict=True)]
    assert bool(evidence.events) == (max(gaps) > LIMIT_S)


def test_limits_are_three_periods_of_the_judged_signal() -> None:
    assert position_limit_s(50.0) == pytest.approx(0.06 + STAMP_S)
    assert position_limit_s(100.0, judged_every_s=0.018) == pytest.approx(0.06 + STAMP_S)
    assert position_limit_s(60.0, judged_every_s=0.018) == pytest.approx(0.1 + STAMP_S)
    assert position_limit_s(4.0) == 0.5
    assert status_limit_s(1.0) == pytest.approx(3.5)
    assert status_limit_s(5.0) == 1.5


@pytest.mark.parametrize("heard_first", [True, False])
def test_a_silent_link_is_one_whichever_of_its_first_words_is_taken_first(
    heard_first: bool,
) -> None:
    evidence = Evidence((terms("battery", over_link=True),))
    evidence.stage(StageSample(1.0, "takeoff"))
    evidence.received(LinkSample(1.05, "real"))
    evidence.report(ReportSample(1.05, "real", "battery"))
    if heard_first:
        evidence.received(LinkSample(4.0, "real"))
    evidence.report(ReportSample(4.0, "real", "battery"))
    evidence.received(LinkSample(4.0, "real"))
    evidence.tick(4.1)
    assert [event.t_s for event in evidence.events] == [4.1]


@pytest.mark.parametrize(
    ("left", "required", "verdict"),
    [("real", False, "PASS"), ("real", True, "INVALID"), ("twin", False, "INVALID")],
)
def test_only_a_vehicle_that_left_ends_what_no_oracle_depends_on(
    left: str, required: bool, verdict: str
) -> None:
    """Its positions end with it."""
    evidence = Evidence((terms(required=required),))
    for stage in ("takeoff", "goal"):
        evidence.stage(StageSample(1.0, stage))
    for tick in range(100, 300):
        evidence.pose(pose(tick / 100))
    evidence.drop_out(DropOutSample(3.0, left))
    evidence.stage(StageSample(END_S, "end"))
    assert evidence.results()[0].verdict == verdict
