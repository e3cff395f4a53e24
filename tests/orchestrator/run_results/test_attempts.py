"""Attempts of a run: which results get another one, and what the last one says of those before."""

import pytest

from tests.orchestrator.run_results.test_results import TWO_OF_THREE, result, three
from wil_campaign.orchestrator.run_results.attempts import after_attempts, attempt_of, retry_due
from wil_campaign.orchestrator.run_results.exit_codes import requirement_shortfalls


@pytest.mark.parametrize(
    ("decided_by", "is_due"),
    [("", True), ("evidence/real", True), ("autonomy/real", False), ("autonomy", False)],
)
def test_what_its_autonomy_made_an_error_is_not_flown_again(decided_by: str, is_due: bool) -> None:
    assert retry_due(result("ERROR", decided_by=decided_by), retries=1) is is_due
    assert not retry_due(result("ERROR", decided_by=decided_by), retries=0)


def test_a_result_has_its_earlier_attempts() -> None:
    before = (attempt_of(result("INVALID"), "gate/large/sim/1/attempt-1"),)
    passed = after_attempts(result("PASS"), before)
    assert passed.attempts == before
    assert passed.reason == "passed at attempt 2; before: INVALID (because)"
    assert after_attempts(result("FAIL"), before).reason == "because"
    assert after_attempts(result("PASS"), ()) == result("PASS")


def test_a_requirement_falls_short_by_its_passes_or_by_a_run_that_proves_nothing() -> None:
    assert requirement_shortfalls(three("PASS", "PASS", "FAIL"), TWO_OF_THREE) == ()
    for verdicts in (("PASS", "PASS", "INVALID"), ("PASS", "FAIL", "FAIL")):
        (standing,) = requirement_shortfalls(three(*verdicts), TWO_OF_THREE)
        assert standing.requirement == TWO_OF_THREE[0]
