"""Repeated attempts at a run: when it is retried, and how its result lists them; pure."""

from collections.abc import Iterable, Sequence
from dataclasses import replace

from wil_campaign.orchestrator.run_results.run_result import EarlierAttempt, RunResult
from wil_campaign.safety.model.oracle_results import Verdict

_RETRIED: frozenset[Verdict] = frozenset({"ERROR", "INVALID"})
"""Verdicts that prove nothing. A FAIL is not retried: flying until it passes proves less still."""


def retry_due(result: RunResult, *, retries: int) -> bool:
    """Return whether a run gets another attempt by the campaign's `retries`.

    Not after an internal exception, which is no temporary fault of the environment, nor where the
    subject failed anything beside what made the verdict (`no_retry`), nor where its autonomy made
    it an ERROR, as by its end before the goal: it may do so now and then, which a second attempt
    would hide. Nor is a control retried that ended as expected, be that INVALID or ERROR.
    """
    if no_retry_text(result):
        return False
    if result.control is not None and result.control.met:
        return False
    spent = sum(attempt.verdict in _RETRIED for attempt in result.attempts)
    return result.verdict in _RETRIED and spent < retries


def no_retry_text(result: RunResult) -> str:
    """Return why a run without PASS or FAIL is not flown again; "" where it may be."""
    if result.exceptions:
        return f"an exception of this program: {result.exceptions[0]}"
    is_autonomy = result.decided_by.partition("/")[0] == "autonomy"
    return result.no_retry or (f"by its autonomy: {result.reason}" if is_autonomy else "")


def failed_too_text(text: str) -> str:
    """Return why a run is not flown again: beside what made its verdict, the subject failed."""
    return f"the subject failed, too: {text}"


def is_cut_off(result: RunResult) -> bool:
    """Return whether a flight was cut off: its process died, or its operator ended it.

    The verdict may be another than ABORTED, where something else decided the run before.
    """
    return result.verdict == "ABORTED" or any(also.verdict == "ABORTED" for also in result.also)


def attempt_of(result: RunResult, folder: str) -> EarlierAttempt:
    """Return a result as an earlier attempt, which does not count. folder: of its files."""
    return EarlierAttempt(result.verdict, result.reason, folder)


def after_attempts(result: RunResult, attempts: Iterable[EarlierAttempt]) -> RunResult:
    """Return a result with its earlier attempts, which a PASS states as its reason."""
    earlier = tuple(attempts)
    if not earlier:
        return result
    reason = passed_text(earlier) if result.verdict == "PASS" else result.reason
    return replace(result, attempts=earlier, reason=reason)


def passed_text(attempts: Sequence[EarlierAttempt]) -> str:
    """Return the reason of a PASS after earlier attempts; "" without any."""
    if not attempts:
        return ""
    before = "; ".join(map(attempt_text, attempts))
    return f"passed at attempt {len(attempts) + 1}; before: {before}"


def ended_attempts(attempts: Iterable[EarlierAttempt]) -> tuple[EarlierAttempt, ...]:
    """Return the attempts that were completed, without those that were cut off."""
    return tuple(attempt for attempt in attempts if attempt.verdict not in {None, "ABORTED"})


def attempt_text(attempt: EarlierAttempt) -> str:
    """Return an attempt in words."""
    return f"{attempt.verdict or 'cut off'} ({attempt.reason})"
