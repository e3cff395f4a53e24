"""What a campaign came to: totals, acceptance, exit codes, JSON."""

import dataclasses
import json
from dataclasses import replace
from itertools import product
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wil_campaign.campaigns.values.acceptance import PassRequirement, PassShare
from wil_campaign.foundation.files.document_writer import to_json
from wil_campaign.orchestrator.cli.verdict_table import conclusion_lines
from wil_campaign.orchestrator.run_results.campaign_results import VERDICTS, Summary, summarize
from wil_campaign.orchestrator.run_results.exit_codes import (
    exit_code,
    is_campaign_accepted,
    rehearsal_code,
)
from wil_campaign.orchestrator.run_results.run_result import (
    NOT_ARMED,
    LaterEvent,
    MixingResult,
    Percentiles,
    RunResult,
    SyncResult,
    percentiles,
)
from wil_campaign.safety.model.oracle_results import OracleResult

ALL_OF_THREE = (PassRequirement("large", "sim", PassShare(3, 3)),)
TWO_OF_THREE = (PassRequirement("large", "sim", PassShare(2, 3)),)


def result(verdict: str = "PASS", rep: int = 1, **changes: Any) -> RunResult:
    values: dict[str, Any] = {
        "case": "large",
        "mode": "sim",
        "rep": rep,
        "seed": 5,
        "verdict": verdict,
        "reason": "" if verdict == "PASS" else "because",
        "also": (),
        "required": True,
        "duration_s": 12.5,
        "wall_s": 1.25,
        "oracles": (),
        "sync": SyncResult(),
        "mixing": None,
    }
    return RunResult(**{**values, **changes})


def three(*verdicts: str) -> list[RunResult]:
    return [result(verdict, rep) for rep, verdict in enumerate(verdicts, 1)]


@pytest.mark.parametrize(
    ("verdicts", "requirements", "code", "is_accepted"),
    [
        (("PASS", "PASS", "PASS"), ALL_OF_THREE, 0, True),
        (("PASS", "FAIL", "PASS"), ALL_OF_THREE, 1, False),
        (("PASS", "FAIL", "PASS"), TWO_OF_THREE, 0, True),
        (("FAIL", "FAIL", "PASS"), TWO_OF_THREE, 1, False),
        (("PASS", "ERROR", "PASS"), ALL_OF_THREE, 3, False),
        (("PASS", "ERROR", "PASS"), TWO_OF_THREE, 3, False),
        (("PASS", "INVALID", "PASS"), TWO_OF_THREE, 3, False),
        (("FAIL", "ERROR", "FAIL"), ALL_OF_THREE, 3, False),
        (("PASS", "ABORTED"), ALL_OF_THREE, 4, False),
        (("ERROR", "ABORTED"), ALL_OF_THREE, 4, False),
        (("PASS", "PASS"), ALL_OF_THREE, 3, False),
        (("FAIL",), ALL_OF_THREE, 3, False),
    ],
)
def test_verdicts_and_requirements_decide_the_exit_code(
    verdicts: tuple[str, ...],
    requirements: tuple[PassRequirement, ...],
    code: int,
    is_accepted: bool,
) -> None:
    runs = three(*verdicts)
    assert exit_code(runs, requirements) == code
    assert is_campaign_accepted(runs, requirements) is is_accepted


def test_nothing_is_accepted_without_required_runs() -> None:
    runs = [result("FAIL", required=False), result("ERROR", 2, required=False)]
    assert exit_code(runs, ()) == 5
    assert is_campaign_accepted(runs, ()) is None
    assert exit_code([], ALL_OF_THREE) == 5


def test_a_run_that_is_only_reported_does_not_count() -> None:
    runs = [*three("PASS", "PASS", "PASS"), result("FAIL", case="small", required=False)]
    assert exit_code(runs, ALL_OF_THREE) == 0


@pytest.mark.parametrize(
    ("ended", "code"),
    [({"stopped": "signal"}, 130), ({"stopped": "command"}, 4), ({"broken": True}, 3)],
)
def test_a_campaign_with_another_exit_code_than_0_is_not_accepted(
    ended: dict[str, Any], code: int
) -> None:
    """All that is required passed, and then the campaign was stopped, or an exception came."""
    runs = three("PASS", "PASS", "PASS")
    assert exit_code(runs, ALL_OF_THREE, **ended) == code
    assert is_campaign_accepted(runs, ALL_OF_THREE, **ended) is False
    raised = [*runs, replace(result("FAIL", required=False), exceptions=("KeyError",))]
    aborted = [*runs, result("ABORTED", case="small", required=False)]
    assert [is_campaign_accepted(one, ALL_OF_THREE) for one in (runs, raised, aborted)] == [
        True,
        False,
        False,
    ]


def test_the_end_of_a_campaign_comes_before_its_verdicts_in_the_exit_code() -> None:
    runs = three("FAIL", "ERROR", "ABORTED")
    assert exit_code(runs, ALL_OF_THREE, stopped="signal", broken=True) == 130
    assert exit_code(runs, ALL_OF_THREE, stopped="command", broken=True) == 4
    assert exit_code(three("FAIL", "FAIL", "FAIL"), ALL_OF_THREE, broken=True) == 3
    assert exit_code([], (), broken=True) == 3
    assert exit_code([], (), stopped="signal") == 130


def test_an_abort_of_a_reported_run_is_an_abort() -> None:
    runs = [*three("PASS", "PASS", "PASS"), result("ABORTED", case="small", required=False)]
    assert exit_code(runs, ALL_OF_THREE) == 4


@given(st.lists(st.tuples(st.sampled_from(VERDICTS), st.booleans()), max_size=6), st.booleans())
def test_zero_is_for_accepted_campaigns_alone(runs: list[tuple[str, bool]], broken: bool) -> None:
    flown = [result(v, rep, required=need) for rep, (v, need) in enumerate(runs, 1)]
    code = exit_code(flown, TWO_OF_THREE, broken=broken)
    if code == 0:
        assert not broken
        assert is_campaign_accepted(flown, TWO_OF_THREE) is True
    if broken:
        assert code in {3, 4}


def test_every_verdict_has_its_place_in_the_totals() -> None:
    runs = [result(v, rep, required=v != "FAIL") for rep, v in enumerate(VERDICTS, 1)]
    totals = summary(runs).totals
    assert dataclasses.asdict(totals) == {
        "runs": 5,
        "required": 4,
        "passed": 1,
        "failed": 1,
        "invalid": 1,
        "error": 1,
        "aborted": 1,
        "retried": 0,
        "controls": 0,
        "controls_met": 0,
    }


def summary(runs: list[RunResult]) -> Summary:
    return summarize(
        runs,
        ALL_OF_THREE,
        campaign="gate",
        clock="virtual",
        surrogate=True,
        real_kind="embedded",
        sensors={"rear": "file", "camera": "rendered"},
    )


@pytest.mark.parametrize(
    ("reasons", "code"),
    [
        ([NOT_ARMED, NOT_ARMED], 5),
        ([NOT_ARMED, "the pilot took real over"], 4),
        (["aborted by anna"], 4),
        ([NOT_ARMED, None], 3),
    ],
)
def test_a_rehearsal_is_good_only_when_all_came_to_arming(
    reasons: list[str | None], code: int
) -> None:
    runs = [
        result("ERROR") if reason is None else replace(result("ABORTED"), reason=reason)
        for reason in reasons
    ]
    assert rehearsal_code(runs) == code


def test_a_rehearsal_that_left_something_on_a_vehicle_is_not_good() -> None:
    good = replace(result("ABORTED"), reason=NOT_ARMED)
    unjudged = replace(
        good, also=(LaterEvent("INVALID", "collision cannot be judged: no pose seen", 9.0),)
    )
    kept = LaterEvent(
        "ERROR", "real still has the onboard configuration of this run: no answer", 9.0
    )
    assert rehearsal_code([good, unjudged]) == 5
    assert rehearsal_code([good, replace(unjudged, also=(*unjudged.also, kept))]) == 3
    assert rehearsal_code([replace(good, exceptions=("RuntimeError: boom",))]) == 3


@pytest.mark.parametrize(
    ("verdict", "said"),
    [
        ("PASS", "accepted of what was flown; required but left out: large/wil"),
        ("FAIL", "not accepted; required but left out: large/wil"),
    ],
)
def test_the_last_line_says_what_was_left_out(verdict: str, said: str) -> None:
    flown = summary([result(verdict) for _ in range(3)])
    assert conclusion_lines(flown)[-1].plain.startswith("accepted" if verdict == "PASS" else "not ")
    assert "left out" not in conclusion_lines(flown)[-1].plain
    last = conclusion_lines(replace(flown, left_out=("large/wil",)))[-1].plain
    assert last.startswith(said)


def full_run() -> RunResult:
    oracle = OracleResult("collision", "real", True, "PASS", 0.1, 0.0, "m", 0.1, 3.3)
    mixing = MixingResult(150, 0, 15.0, Percentiles(1.0, 2.0), Percentiles(5.0, 9.0))
    return result(oracles=(oracle,), mixing=mixing, artifacts=("large/sim/1/real.tlog",))


def fields(mapping: dict[str, Any]) -> str:
    return " ".join(mapping)


def test_the_summary_has_the_fields_of_the_design() -> None:
    document = json.loads(to_json(summary([full_run()])))
    assert fields(document) == (
        "campaign clock surrogate real_kind sensors runs totals accepted left_out controls unmet "
        "caveats not_flown stopped broken"
    )
    (run,) = document["runs"]
    assert fields(run) == (
        "case mode rep seed verdict reason also required duration_s wall_s oracles sync mixing"
        " collisions outside artifacts attempts preflight fence_changes evidence decided_by control"
        " not_judged note trace exceptions twin losses before_arming actors unmoved no_retry slow"
        " views_ended code firmware evidence_files"
    )
    assert fields(run["oracles"][0]) == (
        "name vehicle required verdict actual limit unit margin at_s detail"
    )
    assert fields(run["sync"]) == "command_skew_s takeoff_skew_s t0_skew_s liftoff_delays_s"
    assert fields(run["mixing"]) == (
        "frames dropped rate_hz skew_ms latency_ms registration_error_px registration_bound_px"
        " combinations frames_measured shown not_measured unseen"
    )
    assert list(document["sensors"]) == ["camera", "rear"]


def test_the_same_results_are_the_same_bytes() -> None:
    assert to_json(summary([full_run()])) == to_json(summary([full_run()]))


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_floats_read_back_the_same(value: float) -> None:
    assert json.loads(to_json(result(duration_s=value)))["duration_s"] == value


@pytest.mark.parametrize("value", [float("nan"), float("inf"), float("-inf")])
def test_no_nan_is_ever_written(value: float) -> None:
    with pytest.raises(ValueError, match="not JSON compliant"):
        to_json(result(duration_s=value))


@pytest.mark.parametrize(
    ("values", "p50", "p99"),
    [
        ([], None, None),
        ([3.0], 3.0, 3.0),
        ([2.0, 1.0], 1.0, 2.0),
        ([float(n) for n in range(1, 101)], 50.0, 99.0),
        ([float(n) for n in range(1, 201)], 100.0, 198.0),
    ],
)
def test_percentiles_are_by_nearest_rank(
    values: list[float], p50: float | None, p99: float | None
) -> None:
    assert percentiles(values) == Percentiles(p50, p99)


def test_a_required_run_that_no_requirement_covers_must_pass() -> None:
    assert exit_code([result("FAIL", case="other")], ()) == 1
    assert is_campaign_accepted([result("FAIL", case="other")], ()) is False
    assert exit_code([result("PASS", case="other")], ()) == 0


def test_exit_codes_are_only_those_of_the_design() -> None:
    for verdicts in product(VERDICTS, repeat=3):
        for requirements in (ALL_OF_THREE, TWO_OF_THREE, ()):
            assert exit_code(three(*verdicts), requirements) in {0, 1, 3, 4, 5}


@pytest.mark.parametrize("missing", [0, 1])
def test_no_share_forgives_a_required_run_that_was_never_flown(missing: int) -> None:
    runs, some = three("PASS", "PASS"), (PassRequirement("large", "sim", PassShare(1, 2)),)
    assert exit_code(runs, some, missing=missing) == (3 if missing else 0)
    assert is_campaign_accepted(runs, some, missing=missing) is not bool(missing)
    assert exit_code(runs, some, missing=missing, stopped="signal") == 130
    assert exit_code(three("ABORTED"), some, missing=missing) == 4
