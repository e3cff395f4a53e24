"""The table of the overview: what was required of each case and mode, and the verdict on it."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tests.orchestrator.reading.flown_campaign import Flight, flights, write_flown
from wil_campaign.campaigns.statistics.sequential_test import SequentialTest
from wil_campaign.campaigns.values.acceptance import PassRequirement, PassShare
from wil_campaign.orchestrator.reading.results_folder import read_campaign_documents
from wil_campaign.orchestrator.report.rendering import overview
from wil_campaign.orchestrator.report.rendering.overview import (
    campaign_verdict_of,
    case_rows,
    margin_text,
    verdict_cautions,
)
from wil_campaign.orchestrator.report.words import NOTHING
from wil_campaign.orchestrator.run_results.run_result import EarlierAttempt, RunResult
from wil_campaign.safety.model.oracle_results import EvidenceResult, OracleResult

COMPOSED: dict[str, Any] = {"campaign": "both", "campaigns": {"one": "gate.yaml"}}
"""The document of a composition has neither `accept` nor the repetitions of its parts."""
TEST = SequentialTest(at_least=0.9, against=0.2, most=5)
PLAIN: dict[str, Any] = {
    "accept": {"one.a": {"wil": "4/5"}},
    "repetitions": 5,
}
DECIDED: dict[str, Any] = {
    "repetitions": {"until": "decided", "at_least": 0.9, "against": 0.2, "most": 5}
}


def row_of(folder: Path, given: list[Flight], **more: Any) -> tuple[str, str, str]:
    (row,) = case_rows(
        read_campaign_documents(write_flown(folder, given, with_motion=False, **more))
    )
    return row.passed, row.required, row.verdict


@pytest.mark.parametrize(
    ("verdicts", "share", "required", "verdict"),
    [
        ("PPPPF", PassShare(4, 5), "4/5", "PASS"),
        ("PPPFF", PassShare(4, 5), "4/5", "FAIL"),
        ("PPPPF", PassShare(5, 5), "5/5", "FAIL"),
        ("PPP", PassShare(5, 5), "5/5", "ERROR"),
        ("PPPPI", PassShare(4, 5), "4/5", "INVALID"),
        ("PPPP", PassShare(4, 5), "4/5", "ERROR"),
        ("PPPF", PassShare(4, 5), "4/5", "ERROR"),
        ("PFF", PassShare(4, 5), "4/5", "FAIL"),
    ],
)
def test_the_share_of_a_part_of_a_composition_is_that_of_its_flight(
    tmp_path: Path, verdicts: str, share: PassShare, required: str, verdict: str
) -> None:
    found = row_of(
        tmp_path / "both",
        flights("one.a", "wil", verdicts),
        document=COMPOSED,
        requirements=[PassRequirement("one.a", "wil", share)],
    )
    assert found == (f"{verdicts.count('P')}/{len(verdicts)}", required, verdict)


def test_the_reason_against_a_composition_names_the_share(tmp_path: Path) -> None:
    folder = write_flown(
        tmp_path / "both",
        flights("one.a", "wil", "PPPFF"),
        document=COMPOSED,
        requirements=[PassRequirement("one.a", "wil", PassShare(4, 5))],
        with_motion=False,
    )
    text = campaign_verdict_of(read_campaign_documents(folder)).sentence
    assert "Not accepted because one.a/wil is 3/5 (needs 4/5)." in text


def test_required_runs_that_were_never_flown_are_counted(tmp_path: Path) -> None:
    """A campaign that was killed after two of its five required runs is not "2 of the 2"."""
    asked = [
        PassRequirement("a", "wil", PassShare(3, 3)),
        PassRequirement("a", "sim", PassShare(2, 2)),
        PassRequirement("decided", "wil", PassShare(5, 5), TEST),
    ]
    missing = ("a/sim/1", "a/sim/2", "a/wil/3", "b/wil/1", "blind/wil/1", "decided/wil/5", "?")
    folder = write_flown(
        tmp_path / "cut", flights("a", "wil", "PP"), with_motion=False, requirements=asked
    )
    campaign = read_campaign_documents(folder)
    assert campaign.summary is not None
    cut = replace(campaign, summary=replace(campaign.summary, not_flown=missing))
    text = campaign_verdict_of(cut).sentence
    assert text.startswith("2 of the 5 required runs passed.")
    assert "a/sim is 0/0 (needs 2/2)" in text
    assert "Never flown: 7 runs." in text
    flies = replace(cut, summary=replace(campaign.summary, not_flown=missing, broken=None))
    text = campaign_verdict_of(flies).sentence
    assert "Without a result when summary.json was written: 7 runs. The file summary.json " in text
    assert "it still flies, was cut off, or was flown by an earlier version." in text
    assert "never flown" not in "".join(verdict_cautions(flies))
    none = replace(cut, summary=replace(campaign.summary, runs=()), requirements=tuple(asked[2:]))
    assert campaign_verdict_of(none).sentence.startswith("No required run was flown.")


def test_a_pass_at_a_second_attempt_is_named_beside_the_verdict(tmp_path: Path) -> None:
    folder = write_flown(tmp_path / "gate", flights("a", "wil", "PP"), with_motion=False)
    campaign = read_campaign_documents(folder)
    assert campaign.summary is not None
    first, second = campaign.summary.runs
    before = EarlierAttempt("INVALID", "no pose for 0.7 s", "earlier/a/wil/2-1")
    retried = replace(campaign.summary, runs=(first, replace(second, attempts=(before,))))
    assert verdict_cautions(campaign) == []
    assert verdict_cautions(replace(campaign, summary=retried)) == [
        "not at the first attempt: a wil #2: PASS at attempt 2, after INVALID (no pose for 0.7 s)"
    ]


def test_a_decided_part_of_a_composition_lacks_no_run(tmp_path: Path) -> None:
    given = flights("one.a", "wil", "PP")
    test = PassRequirement("one.a", "wil", PassShare(5, 5), TEST)
    folder = write_flown(
        tmp_path / "both",
        given,
        document=COMPOSED,
        requirements=[test],
        planned=5,
        with_motion=False,
    )
    campaign = read_campaign_documents(folder)
    assert (campaign.problems, campaign.run_problems) == ((), ())
    (row,) = case_rows(campaign)
    assert (row.passed, row.required, row.verdict) == (
        "2/2",
        "0.9 against 0.2: at least",
        "PASS",
    )


@pytest.mark.parametrize(
    ("document", "verdicts", "required", "verdict"),
    [
        (PLAIN, "PPPPF", "4/5", "PASS"),
        (DECIDED, "PP", "0.9 against 0.2: at least", "PASS"),
        (DECIDED, "FF", "0.9 against 0.2: below", "FAIL"),
        (DECIDED, "PPI", "0.9 against 0.2: at least", "INVALID"),
        (DECIDED, "PFPFP", "0.9 against 0.2: undecided", "undecided"),
        (DECIDED, "PF", "0.9 against 0.2: undecided", "ERROR"),
        ({}, "PPF", "3/3", "FAIL"),
        ({"accept": {"one.a": {"wil": "9/5"}}, "repetitions": 5}, "PPF", "3/3", "FAIL"),
        ({"accept": {"one.a": 7}, "repetitions": 5}, "PPF", "3/3", "FAIL"),
        ({"repetitions": {"until": "decided"}}, "PPF", "3/3", "FAIL"),
    ],
)
def test_a_folder_of_an_earlier_version_is_read_by_its_campaign_file(
    tmp_path: Path, document: dict[str, Any], verdicts: str, required: str, verdict: str
) -> None:
    found = row_of(tmp_path / "old", flights("one.a", "wil", verdicts), document=document)
    assert found[1:] == (required, verdict)


def test_a_run_without_a_result_is_missing_where_the_summary_names_none(tmp_path: Path) -> None:
    given = flights("a", "wil", "PP")
    folder = write_flown(tmp_path / "cut", given, planned=3, broken=None, with_motion=False)
    assert "1 of 3 runs have no readable result" in read_campaign_documents(folder).problems


def judged(*margins: tuple[str, str, float | None, bool]) -> RunResult:
    """Return a run with an oracle for each (name, unit, margin, required)."""
    (flight,) = flights("a", "wil", "F")
    oracles = tuple(
        OracleResult(name, "real", required, "PASS", 1.0, 1.0, unit, margin, 4.0)
        for name, unit, margin, required in margins
    )
    return replace(flight.result(), oracles=oracles)


CLEAR = ("clearance", "m", 0.4, True)
LATE = ("time_limit", "s", -3.0, True)
FAST = ("speed", "m/s", -0.25, True)


@pytest.mark.parametrize(
    ("margins", "text"),
    [
        ((CLEAR, ("time_limit", "s", 0.1, True)), "0.40 m (clearance)"),
        ((CLEAR, FAST), "-0.25 m/s (speed)"),
        ((CLEAR, FAST, LATE), "-3 s (time_limit)"),
        ((CLEAR, ("speed", "m/s", -0.25, False)), "0.40 m (clearance)"),
        ((("collision", "m", 0.0, True), ("time_limit", "s", 9.0, True)), "0.00 m (collision)"),
        ((("speed", "m/s", 0.2, True), ("landed", "", None, True)), "0.2 m/s (speed)"),
        ((("landed", "", None, True),), NOTHING),
    ],
)
def test_the_smallest_margin_is_of_a_limit_that_was_exceeded(
    margins: tuple[tuple[str, str, float | None, bool], ...], text: str
) -> None:
    assert margin_text(judged(*margins)) == text


@pytest.mark.parametrize(
    ("gaps", "text"),
    [
        (((0.4, 0.5, "PASS"), (0.2, 0.06, "INVALID")), "0.2 of 0.06 s, NOT SUFFICIENT in 1 run"),
        (((0.06004, 0.06, "INVALID"),), "0.06004 of 0.06 s, NOT SUFFICIENT in 1 run"),
        (((0.4, 0.5, "PASS"), (0.06, 0.06, "PASS")), "0.4 of 0.5 s"),
    ],
)
def test_the_gap_of_a_signal_is_the_one_that_was_too_long(gaps: Any, text: str) -> None:
    """It said 0.4 of 0.5 s, and 0.06 of 0.06 s, NOT SUFFICIENT."""
    (flight,) = flights("a", "wil", "P")
    runs = [
        replace(
            flight.result(),
            evidence=(
                EvidenceResult(
                    signal="pose",
                    vehicle="real",
                    source="mocap",
                    required=True,
                    first_s=1.0,
                    last_s=9.0,
                    count=100,
                    largest_gap_s=gap_s,
                    gap_at_s=3.0,
                    limit_s=limit_s,
                    verdict=verdict,
                ),
            ),
        )
        for gap_s, limit_s, verdict in gaps
    ]
    (said,) = overview._evidence_texts(runs)
    assert said.endswith(f"pose (mocap) {text}")


def test_a_registration_that_was_not_measured_is_reported() -> None:
    def run(error_px: float | None) -> Any:
        error = None if error_px is None else SimpleNamespace(p99=error_px)
        return SimpleNamespace(
            mixing=SimpleNamespace(frames=10, dropped=0, registration_error_px=error, shown={})
        )

    measured, half, none, tiny = (
        next(overview._mixture_texts(runs))
        for runs in ([run(0.7)], [run(0.7), run(None)], [run(None)], [run(9.93e-05)])
    )
    assert tiny.endswith("registration error below 0.1 px in 99 % of those measured")
    assert measured.endswith("registration error below 0.7 px in 99 % of those measured")
    assert half.endswith("of those measured; registration error not measured in 1 run")
    assert none.endswith("left out; registration error not measured in 1 run")


@pytest.mark.parametrize(("error_px", "text"), [(9.93e-05, "0.0"), (2.345, "2.3"), (None, "-")])
def test_a_registration_is_rounded_as_on_the_terminal(error_px: float | None, text: str) -> None:
    mixing: Any = SimpleNamespace(registration_error_px=SimpleNamespace(p50=error_px))
    run = replace(judged(CLEAR), required=False, mixing=mixing)
    documents: Any = None
    row = overview._case_row(documents, "a", "wil", False, [run])
    assert row.registration_px == text.replace("-", NOTHING)


def test_a_skew_below_a_millisecond_is_rounded_as_on_the_terminal() -> None:
    run = judged(CLEAR)
    run = replace(run, required=False, sync=replace(run.sync, takeoff_skew_s=-0.000213))
    documents: Any = None
    assert overview._case_row(documents, "a", "wil", False, [run]).skew_ms == "0"
