"""Runs that are flown again: when, and how a result tells of it; pure."""

from collections.abc import Iterable, Sequence
from dataclasses import replace

from orchestrator.model.results import Attempt, RunResult
from safety.model.oracle_results import Verdict

_RETRIED: frozenset[Verdict] = frozenset({"ERROR", "INVALID"})
"""What proves nothing about what is tested. A FAIL stays: flying it until it passes proves less."""


def retry_due(result: RunResult, *, retries: int) -> bool:
    """Return whether a run gets another attempt by the campaign's `retries`.

    Not after an exception of ours: that is no trouble of the surroundings which may pass. Nor is
    a control that ended as it must, also where that is INVALID or ERROR.
    """
    if result.exceptions or (result.control is not None and result.control.met):
        return False
    spent = sum(one.verdict in _RETRIED for one in result.attempts)
    return result.verdict in _RETRIED and spent < retries


def is_cut_off(result: RunResult) -> bool:
    """Return whether a flight ended early, for its program died or its operator ended it.

    Its verdict may be another than ABORTED, where something else decided it before.
    """
    return result.verdict == "ABORTED" or any(one.verdict == "ABORTED" for one in result.also)


def attempt_of(result: RunResult, folder: str) -> Attempt:
    """Return a result as an earlier attempt, which does not count. folder: where it is kept."""
    return Attempt(result.verdict, result.reason, folder)


def after_attempts(result: RunResult, attempts: Iterable[Attempt]) -> RunResult:
    """Return a result with its earlier attempts, so that no PASS looks like a clean one."""
    told = tuple(attempts)
    if not told:
        return result
    reason = passed_text(told) if result.verdict == "PASS" else result.reason
    return replace(result, attempts=told, reason=reason)


def passed_text(attempts: Sequence[Attempt]) -> str:
    """Return the reason of a PASS after earlier attempts; "" without any."""
    if not attempts:
        return ""
    before = "; ".join(map(attempt_text, attempts))
    return f"passed at attempt {len(attempts) + 1}; before: {before}"


def ended_attempts(attempts: Iterable[Attempt]) -> tuple[Attempt, ...]:
    """Return the attempts that came to their end, without those that were cut off."""
    return tuple(one for one in attempts if one.verdict not in {None, "ABORTED"})


def attempt_text(attempt: Attempt) -> str:
    """Return an attempt in words."""
    return f"{attempt.verdict or 'cut off'} ({attempt.reason})"
