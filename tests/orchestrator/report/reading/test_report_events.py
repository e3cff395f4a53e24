"""Which lines of log.jsonl a report keeps, and the cause and time that it takes from them."""

from dataclasses import replace
from pathlib import Path

from tests.orchestrator.report.recorded_campaign import touched
from wil_campaign.orchestrator.report.reading.cause import verdict_cause_of
from wil_campaign.orchestrator.report.reading.event_log import MOST_EVENTS, read_event_log
from wil_campaign.orchestrator.state.run_log import RunLog
from wil_campaign.safety.model.oracle_results import OracleResult

LINK_LOST = replace(
    touched(), verdict="ERROR", reason="the link was lost", note="", decided_by="", oracles=()
)


def test_a_vehicle_that_says_much_hides_no_event_that_decided(tmp_path: Path) -> None:
    path = tmp_path / "log.jsonl"
    with RunLog(path=path) as log:
        for k in range(MOST_EVENTS + 50):
            log.write(k / 10, "vehicle", vehicle="real", kind="text", text="GPS glitch")
        log.write(50.0, "flag", oracle="altitude", vehicle="real", text="real is 3 m high")
        log.write(51.0, "decisive", kind="ERROR", reason="the link was lost", source="")
        log.write(52.0, "vehicle", vehicle="real", kind="text", text="GPS glitch")
        log.write(53.0, "stage", stage="end")
    found = read_event_log(path)
    assert [event.kind for event in found.events[MOST_EVENTS:]] == ["flag", "decisive", "stage"]
    assert found.left_out == 51
    cause = verdict_cause_of(LINK_LOST, found.events, goal_s=50.0, passed=None)
    assert cause is not None
    assert cause.at_s == 51.0
    assert dict(cause.facts)["when"] == "1.00 s after the goal was given"


def test_flags_without_end_are_limited_and_hide_no_decisive_event(tmp_path: Path) -> None:
    path = tmp_path / "log.jsonl"
    with RunLog(path=path) as log:
        for k in range(2 * MOST_EVENTS):
            log.write(k / 10, "flag", oracle="altitude", vehicle="real", text="real is 3 m high")
        log.write(100.0, "decisive", kind="ERROR", reason="the link was lost", source="")
    found = read_event_log(path)
    assert [event.kind for event in found.events[-2:]] == ["flag", "decisive"]
    assert (len(found.events), found.left_out) == (MOST_EVENTS + 1, MOST_EVENTS)


def test_the_time_of_an_event_that_is_not_in_the_log_is_not_known() -> None:
    cause = verdict_cause_of(LINK_LOST, (), goal_s=2.0, passed=None)
    assert cause is not None
    assert dict(cause.facts)["when"] == "not known"


def test_a_limit_is_crossed_at_the_flag_of_its_own_oracle(tmp_path: Path) -> None:
    path = tmp_path / "log.jsonl"
    with RunLog(path=path) as log:
        log.write(3.0, "flag", oracle="ground_speed", vehicle="real", text="real: 2 m/s")
        log.write(5.0, "flag", oracle="other", vehicle="real", text="as its speed is 3 m/s")
        log.write(6.0, "flag", oracle="speed", vehicle="twin", text="twin: 4 m/s")
        log.write(8.0, "flag", oracle="speed", vehicle="real", text="real: 4 m/s")
    speed = OracleResult("speed", "real", True, "FAIL", 5.0, (None, 3.5), "m/s", -1.5, 9.0, "")
    result = replace(touched(), oracles=(speed,), decided_by="speed/real")
    cause = verdict_cause_of(result, read_event_log(path).events, goal_s=2.0, passed=None)
    assert cause is not None
    facts = dict(cause.facts)
    assert facts["crossed"] == "6.00 s after the goal was given"
    assert facts["worst"] == "7.00 s after the goal was given"
