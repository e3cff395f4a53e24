"""Controls in what a campaign came to: a control that passes is never exit 0."""

import json
import xml.etree.ElementTree as ET
from dataclasses import replace
from typing import Any

import pytest

from tests.orchestrator.run_results.test_results import result
from wil_campaign.campaigns.values.acceptance import PassRequirement, PassShare
from wil_campaign.campaigns.values.expectation import Expectation
from wil_campaign.foundation.files.document_writer import to_json
from wil_campaign.orchestrator.cli.verdict_table import conclusion_lines, verdict_table
from wil_campaign.orchestrator.run_results.attempts import retry_due
from wil_campaign.orchestrator.run_results.campaign_results import Summary, summarize
from wil_campaign.orchestrator.run_results.control_results import control_result
from wil_campaign.orchestrator.run_results.exit_codes import exit_code, is_campaign_accepted
from wil_campaign.orchestrator.run_results.junit import junit_xml
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.safety.model.oracle_results import OracleResult, Verdict

ONE = (PassRequirement("large", "sim", PassShare(1, 1)),)
BY_REACHED = Expectation("large", "FAIL", "reached", None)


def control(
    verdict: Verdict = "FAIL",
    *,
    decided_by: str = "reached/twin",
    reason: str = "reached of twin failed: never flew through gate",
    expected: Expectation = BY_REACHED,
) -> RunResult:
    given = control_result(
        expected, verdict=verdict, reason=reason, decided_by=decided_by, subject="twin"
    )
    return result(
        verdict,
        case="blind",
        required=False,
        control=given,
        decided_by=decided_by,
        reason="" if verdict == "PASS" else reason,
    )


def summary(*runs: RunResult, due: int = 1) -> Summary:
    return summarize(
        runs,
        ONE,
        campaign="gate",
        clock="virtual",
        surrogate=True,
        real_kind="embedded",
        sensors={},
        controls_due=due,
    )


@pytest.mark.parametrize(
    ("given", "code", "is_accepted"),
    [
        (control(), 0, True),
        (control("PASS", decided_by=""), 1, False),
        (control(decided_by="autonomy/twin", reason="the autonomy crashed"), 1, False),
        (control(decided_by="reached/real"), 1, False),
        (control("INVALID", decided_by="mixing"), 3, False),
        (control("ERROR", decided_by=""), 3, False),
        (control("ABORTED", decided_by=""), 4, False),
    ],
)
def test_a_campaign_is_accepted_only_when_its_controls_end_as_expected(
    given: RunResult, code: int, is_accepted: bool
) -> None:
    runs = [result(), given]
    assert exit_code(runs, ONE, controls_due=1) == code
    assert is_campaign_accepted(runs, ONE, controls_due=1) is is_accepted


def test_a_control_that_was_not_flown_proves_nothing() -> None:
    assert exit_code([result()], ONE, controls_due=1) == 3
    assert is_campaign_accepted([result()], ONE, controls_due=1) is False
    assert exit_code([result()], ONE, controls_due=1, stopped="signal") == 130


def test_controls_alone_accept_nothing_and_refuse_all() -> None:
    assert exit_code([control()], (), controls_due=1) == 5
    assert is_campaign_accepted([control()], (), controls_due=1) is None
    assert exit_code([control("PASS", decided_by="")], (), controls_due=1) == 1
    assert is_campaign_accepted([control("PASS", decided_by="")], (), controls_due=1) is False


def test_a_failed_required_run_and_a_lost_one_keep_their_codes() -> None:
    passing = control("PASS", decided_by="")
    assert exit_code([result("FAIL"), passing], ONE, controls_due=1) == 1
    assert exit_code([result("ERROR"), passing], ONE, controls_due=1) == 3


@pytest.mark.parametrize(
    ("reason", "met"), [("the position froze at 3 s", True), ("a link gap", False)]
)
def test_a_control_may_be_expected_to_end_by_a_cause(reason: str, met: bool) -> None:
    expected = Expectation("large", "INVALID", None, "froze")
    found = control("INVALID", reason=reason, decided_by="", expected=expected).control
    assert found is not None
    assert found.met == met


def test_a_control_that_ended_as_expected_is_not_flown_again() -> None:
    expected = Expectation("large", "INVALID", None, "froze")
    good = control("INVALID", reason="it froze", decided_by="", expected=expected)
    assert not retry_due(good, retries=3)
    assert retry_due(control("INVALID", decided_by=""), retries=3)


def test_the_summary_keeps_controls_apart_from_runs() -> None:
    document: dict[str, Any] = json.loads(to_json(summary(result(), control())))
    assert [run["case"] for run in document["runs"]] == ["large"]
    assert [run["case"] for run in document["controls"]] == ["blind"]
    assert document["controls"][0]["control"]["met"] is True
    assert document["totals"]["failed"] == 0
    assert document["totals"]["controls"] == document["totals"]["controls_met"] == 1
    assert document["unmet"] == []


def test_the_last_line_says_that_a_campaign_cannot_fail() -> None:
    lines = [
        line.plain for line in conclusion_lines(summary(result(), control("PASS", decided_by="")))
    ]
    assert lines[-1].startswith("not accepted; this campaign cannot fail")
    assert sum("control blind in mode sim passed" in line for line in lines) == 1
    good = [line.plain for line in conclusion_lines(summary(result(), control()))]
    assert good[-1].startswith("accepted")
    assert good[0].startswith("control blind sim FAIL, as required: reached of twin failed")


def test_a_control_that_fails_by_another_oracle_says_once_by_which_and_what_to_write() -> None:
    wanted = Expectation("large", "FAIL", "collision", None)
    judged = OracleResult("clearance", "twin", True, "FAIL", 0.14, 0.35, "m", -0.21, 3.0)
    near = control(decided_by="clearance/twin", reason="0.140 m of gate", expected=wanted)
    lines = [
        line.plain for line in conclusion_lines(summary(result(), replace(near, oracles=(judged,))))
    ]
    told = (
        "control blind sim must FAIL by collision, but FAILED by clearance (0.140 m of gate); "
        "expect oracle: clearance, or leave clearance out"
    )
    assert lines[-2:] == [told, lines[-1]]
    assert lines[-1].startswith("not accepted; control blind sim must FAIL by collision (the")
    assert sum("0.140 m of gate" in line for line in lines) == 1


def test_a_control_has_a_row_of_its_own() -> None:
    passed, other = control("PASS", decided_by=""), control(decided_by="collision/twin")
    table = verdict_table(summary(result(), control(), passed, other), ONE)
    cells = {column.header: [str(cell) for cell in column.cells] for column in table.columns}
    assert cells["case"] == ["large", "blind", "blind", "blind"]
    ends = ["FAIL (control)", "PASS (must not)", "FAIL (not as required)"]
    assert cells["verdict"] == ["PASS", *ends]
    assert str(table.title) == "gate: 1 run, 3 controls"


@pytest.mark.parametrize(
    ("given", "tag"),
    [
        (control(), None),
        (control("PASS", decided_by=""), "failure"),
        (control("ERROR", decided_by=""), "error"),
    ],
)
def test_a_control_is_a_test_case_that_succeeds_when_it_fails(
    given: RunResult, tag: str | None
) -> None:
    root = ET.fromstring(junit_xml(summary(result(), given), ONE))  # noqa: S314 - our own document
    (case,) = [one for one in root.iter("testcase") if ".controls." in one.attrib["classname"]]
    assert [child.tag for child in case if child.tag != "system-out"] == ([tag] if tag else [])
    names = [one.attrib["name"] for one in root.iter("property")]
    assert names == ([] if tag is None else ["controls_unmet"])


def test_an_oracle_that_was_not_judged_is_reported_in_table_and_junit() -> None:
    run = replace(result(), not_judged=("collision_always",))
    found = summary(run, control())
    assert conclusion_lines(found)[-1].plain.startswith("accepted; not judged: collision_always")
    assert b'name="not_judged" value="collision_always (large sim, 1 run)"' in junit_xml(found, ONE)


@pytest.mark.parametrize(
    ("unchanged", "is_needless"),
    [
        ({"verdict": "FAIL", "decided_by": "reached/twin"}, True),
        ({"verdict": "FAIL", "decided_by": "collision/twin"}, False),
        ({"verdict": "FAIL", "decided_by": "reached/twin", "seed": 9}, False),
        ({"verdict": "FAIL", "decided_by": "reached/twin", "mode": "wil"}, False),
        ({"verdict": "PASS"}, False),
    ],
)
def test_a_control_whose_case_fails_so_without_it_has_a_caveat(
    unchanged: dict[str, Any], *, is_needless: bool
) -> None:
    failed = replace(result(), **unchanged)
    found = summary(failed, replace(result(), rep=2, seed=failed.seed + 1), control())
    text = (
        "control blind sim shows nothing: large FAILED with the same seed, without what the "
        "control changes"
    )
    assert (text in found.caveats) is is_needless
