"""junit.xml: what counts is red, what is only reported is visible, and nothing breaks the XML."""

import itertools
import xml.etree.ElementTree as ET
from dataclasses import replace
from typing import Any

import pytest

from wil_campaign.campaigns.values.acceptance import PassRequirement, PassShare
from wil_campaign.orchestrator.run_results.campaign_results import summarize
from wil_campaign.orchestrator.run_results.control_results import ControlResult
from wil_campaign.orchestrator.run_results.exit_codes import (
    exit_code,
    is_campaign_accepted,
    rehearsal_code,
)
from wil_campaign.orchestrator.run_results.junit import junit_xml
from wil_campaign.orchestrator.run_results.run_result import (
    NOT_ARMED,
    LaterEvent,
    RunResult,
    SyncResult,
)
from wil_campaign.safety.model.oracle_results import OracleResult, Verdict

REQUIRED = (PassRequirement("large", "sim", PassShare(2, 2)),)


def run(verdict: Verdict, rep: int, *, required: bool = True, reason: str = "why") -> RunResult:
    return RunResult(
        case="large" if required else "small",
        mode="sim",
        rep=rep,
        seed=77,
        verdict=verdict,
        reason="" if verdict == "PASS" else reason,
        also=(LaterEvent("FAIL", "late", 9.0),) if verdict == "ERROR" else (),
        required=required,
        duration_s=12.3456,
        wall_s=1.0,
        oracles=(
            OracleResult("collision", "real", True, "FAIL", 0.0, 0.0, "m", 0.0, 3.0, "touched"),
        ),
        sync=SyncResult(),
        mixing=None,
    )


def suite(
    *runs: RunResult,
    requirements: tuple[PassRequirement, ...] = REQUIRED,
    left_out: tuple[str, ...] = (),
    arm: bool = True,
    **ended: Any,
) -> ET.Element:
    summary = summarize(
        runs,
        requirements,
        campaign="gate",
        clock="virtual",
        surrogate=True,
        real_kind="embedded",
        sensors={},
        left_out=left_out,
        **ended,
    )
    root = ET.fromstring(junit_xml(summary, requirements, arm=arm))  # noqa: S314 - our own document
    found = root.find("testsuite")
    assert found is not None
    return found


def test_omitted_runs_are_a_property() -> None:
    (one,) = suite(left_out=("large/wil", "4 of 5 repetitions")).iter("property")
    assert dict(one.attrib) == {"name": "left_out", "value": "large/wil, 4 of 5 repetitions"}
    assert not list(suite().iter("property"))


def test_the_time_of_the_suite_is_that_of_its_test_cases() -> None:
    found = suite(*BOTH, replace(run("FAIL", 1), control=CONTROL))
    times_s = [float(case.attrib["time"]) for case in found.iter("testcase")]
    assert len(times_s) == 3
    assert sum(times_s) == pytest.approx(float(found.attrib["time"]), abs=0.01)


def outcome(case: ET.Element) -> str:
    tags = [child.tag for child in case if child.tag != "system-out"]
    return tags[0] if tags else "passed"


def test_each_run_is_a_test_case_with_the_outcome_that_counts() -> None:
    found = suite(
        run("PASS", 1),
        run("FAIL", 2),
        run("ERROR", 3),
        run("INVALID", 4),
        run("ABORTED", 5),
        run("FAIL", 1, required=False),
        run("PASS", 2, required=False),
    )
    assert [outcome(case) for case in found] == [
        "passed",
        "failure",
        "error",
        "error",
        "error",
        "skipped",
        "passed",
    ]
    counts = {key: found.get(key) for key in ("tests", "failures", "errors", "skipped")}
    assert counts == {"tests": "7", "failures": "1", "errors": "3", "skipped": "1"}
    assert found[1].get("classname") == "gate.large.sim"
    assert found[1].get("name") == "2"
    assert found[1].get("time") == "12.346"


def test_a_run_that_is_only_reported_is_skipped_with_its_verdict() -> None:
    (case,) = suite(run("FAIL", 1, required=False), requirements=())
    skipped = case.find("skipped")
    assert skipped is not None
    assert skipped.get("message") == "reported only: FAIL: why"


def test_a_failure_that_the_share_forgives_does_not_fail_the_suite() -> None:
    one_of_two = (PassRequirement("large", "sim", PassShare(1, 2)),)
    found = suite(run("PASS", 1), run("FAIL", 2), requirements=one_of_two)
    assert [outcome(case) for case in found] == ["passed", "skipped"]
    error = suite(run("PASS", 1), run("ERROR", 2), requirements=one_of_two)
    assert [outcome(case) for case in error] == ["passed", "error"]


def test_required_runs_that_were_not_flown_are_an_error() -> None:
    found = suite(run("PASS", 1))
    assert [outcome(case) for case in found] == ["passed", "error"]
    assert found[1].get("name") == "not flown"
    assert [outcome(case) for case in suite()] == ["error"]


def test_numbers_and_later_events_stand_in_the_output() -> None:
    (case, _) = suite(run("ERROR", 1))
    text = case.findtext("system-out") or ""
    assert "seed 77" in text
    assert "FAIL collision (real), actual 0 m, margin 0 m, touched" in text
    assert "also FAIL at 9.000 s: late" in text


def test_any_reason_is_good_xml() -> None:
    reason = "<b>&\"'\x00\x1b\ud800\ufffe \u00e9\U0001f600 ]]>"
    case = suite(run("FAIL", 1, reason=reason))[0]
    failure = case.find("failure")
    assert failure is not None
    assert failure.get("message") == "<b>&\"'???? \u00e9\U0001f600 ]]>"


HALF = (PassRequirement("large", "sim", PassShare(1, 2)),)
BOOM = ("RuntimeError: boom, in the guard",)
CONTROL = ControlResult("large", "FAIL", "collision", None, met=True)
BOTH = (run("PASS", 1), run("PASS", 2))


@pytest.mark.parametrize(
    ("runs", "ended", "code"),
    [
        ((run("PASS", 1), replace(run("FAIL", 2), exceptions=BOOM)), {}, 3),
        ((*BOTH, replace(run("ERROR", 1, required=False), exceptions=BOOM)), {}, 3),
        ((*BOTH, replace(run("FAIL", 1), control=CONTROL, exceptions=BOOM)), {}, 3),
        ((*BOTH, run("ABORTED", 1, required=False)), {}, 4),
        (BOTH, {"broken": True}, 3),
        (BOTH, {"controls_due": 1}, 3),
        (BOTH, {"controls_due": 1, "stopped": "signal"}, 130),
        (BOTH, {"missing": 1}, 3),
    ],
)
def test_a_campaign_that_is_not_accepted_is_never_green(
    runs: tuple[RunResult, ...], ended: dict[str, Any], code: int
) -> None:
    assert exit_code(runs, HALF, **ended) == code
    found = suite(*runs, requirements=HALF, **ended)
    assert int(found.get("errors", "0")) == 1, [outcome(case) for case in found]
    assert found.get("failures") == "0"


def test_a_suite_is_red_exactly_where_the_campaign_is_not_accepted() -> None:
    verdicts: tuple[Verdict, ...] = ("PASS", "FAIL", "ERROR")
    of_runs = [
        replace(run(verdict, rep), exceptions=exceptions)
        for rep, verdict, exceptions in itertools.product((1, 2), verdicts, ((), BOOM))
    ]
    ends: tuple[dict[str, Any], ...] = ({}, {"broken": True}, {"controls_due": 1}, {"missing": 1})
    pairs = itertools.product(of_runs[:6], of_runs[6:])
    for pair, requirements, ended in itertools.product(pairs, (REQUIRED, HALF), ends):
        found = suite(*pair, requirements=requirements, **ended)
        red = any(outcome(case) in {"failure", "error"} for case in found)
        assert red is not is_campaign_accepted(pair, requirements, **ended), (
            pair,
            requirements,
            ended,
        )


def test_a_campaign_that_is_not_accepted_says_what_was_never_flown() -> None:
    found = suite(*BOTH, controls_due=1, not_flown=("bare/sim/1",))
    error = found[-1].find("error")
    assert error is not None
    assert error.get("message") == "the campaign is not accepted; never flown: bare/sim/1"


@pytest.mark.parametrize(
    ("ended", "code", "message"),
    [
        ({"broken": True}, 3, "an internal exception occurred outside of its runs"),
        ({"stopped": "signal"}, 130, "stopped by Ctrl-C or SIGTERM"),
        ({"stopped": "command"}, 4, "stopped by an operator's command"),
        ({"controls_due": 1, "not_flown": ("bare/sim/1",)}, 3, "never flown: bare/sim/1"),
        (
            {"stopped": "signal", "not_flown": ("small/sim/2",)},
            130,
            "never flown: small/sim/2; stopped by Ctrl-C or SIGTERM",
        ),
        ({}, 5, ""),
    ],
)
def test_a_suite_without_required_runs_is_green_by_exit_code_5_alone(
    ended: dict[str, Any], code: int, message: str
) -> None:
    runs = [run("PASS", 1, required=False), run("FAIL", 2, required=False)]
    how = {key: each for key, each in ended.items() if key != "not_flown"}
    assert exit_code(runs, (), **how) == code
    found = suite(*runs, requirements=(), **ended)
    errors = [error.get("message") for error in found.iter("error")]
    assert errors == ([f"the campaign is not accepted; {message}"] if message else [])
    assert found.get("errors") == str(len(errors))


def test_a_run_that_did_not_come_to_arming_as_asked_is_an_error() -> None:
    good = run("ABORTED", 1, required=False, reason=NOT_ARMED)
    bad = run("ERROR", 2, required=False, reason="no link to real")
    assert rehearsal_code([good, bad]) == 3
    found = suite(good, bad, requirements=(), arm=False)
    assert [outcome(case) for case in found] == ["skipped", "error"]
    assert [outcome(case) for case in suite(good, bad, requirements=())] == ["skipped"] * 2


def test_an_unarmed_run_is_an_error_only_when_it_left_something_on_a_vehicle() -> None:
    good = run("ABORTED", 1, required=False, reason=NOT_ARMED)
    (case,) = suite(good, requirements=())
    assert outcome(case) == "skipped"
    left = replace(good, also=(LaterEvent("ERROR", "real keeps its fence", 9.0),))
    error = suite(left, requirements=())[0].find("error")
    assert error is not None
    assert error.get("message") == f"{NOT_ARMED}; real keeps its fence"
