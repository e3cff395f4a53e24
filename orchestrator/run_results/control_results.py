"""Control runs against their expectation: one that passes shows that its campaign cannot fail."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

from wil_campaign.campaigns.values.expectation import Expectation
from wil_campaign.safety.model.oracle_results import OracleResult, Verdict
from wil_campaign.safety.model.verdict import event_source_of


@dataclass(frozen=True, slots=True)
class ControlResult:
    """A control's result against its expectation. case: the one that it changes.

    verdict, oracle, cause: what is expected. met: whether the run ended so.
    """

    case: str
    verdict: Verdict
    oracle: str | None
    cause: str | None
    met: bool


class ControlRun(Protocol):
    """A finished run (protocol of `RunResult`), a control or one that a control may change."""

    @property
    def case(self) -> str:
        """Return the control's name."""

    @property
    def mode(self) -> str:
        """Return the mode in which the control was flown."""

    @property
    def seed(self) -> int:
        """Return the seed of the control run: that of the run that it changes."""

    @property
    def subject(self) -> str:
        """Return the vehicle that is judged."""

    @property
    def verdict(self) -> Verdict:
        """Return the control run's verdict."""

    @property
    def bare_reason(self) -> str:
        """Return the reason of the control run's verdict, without the autonomy's note."""

    @property
    def decided_by(self) -> str:
        """Return the source of the control run's verdict, as "reached/real"."""

    @property
    def oracles(self) -> Sequence[OracleResult]:
        """Return the results of the oracles that judged the control run."""

    @property
    def control(self) -> ControlResult | None:
        """Return the control's result; None for a run that is no control."""


def control_result(
    expected: Expectation | None, *, verdict: Verdict, reason: str, decided_by: str, subject: str
) -> ControlResult | None:
    """Return the control result of a run with a verdict; None where it is no control.

    decided_by: the source of the event that made the verdict; subject: the vehicle judged.
    """
    if expected is None:
        return None
    met = _is_met(expected, verdict=verdict, reason=reason, decided_by=decided_by, subject=subject)
    return ControlResult(expected.case, expected.verdict, expected.oracle, expected.cause, met)


def _is_met(
    expected: Expectation | ControlResult,
    *,
    verdict: Verdict,
    reason: str,
    decided_by: str,
    subject: str,
) -> bool:
    """Return whether a run ended as a control must; the arguments are those of `control_result`."""
    wanted = None if expected.oracle is None else event_source_of(expected.oracle, subject)
    return (
        verdict == expected.verdict
        and wanted in {None, decided_by}
        and (expected.cause or "") in reason
    )


def control_faults(runs: Iterable[ControlRun]) -> list[str]:
    """Return in words each control that did not end as expected."""
    return [_fault(run) for run in runs if run.control is not None and not run.control.met]


def needless_control_texts(
    runs: Iterable[ControlRun], controls: Iterable[ControlRun]
) -> Iterator[str]:
    """Yield a caveat for each control that ended as expected, as its case does without it.

    runs: without the controls. Of them the one with the control's case, mode and seed differs from
    it in nothing but what the control changes.
    """
    flown = {(run.case, run.mode, run.seed): run for run in runs}
    for control_run in controls:
        wanted = control_run.control
        if wanted is None or not wanted.met:
            continue
        unchanged = flown.get((wanted.case, control_run.mode, control_run.seed))
        if unchanged is None or not _is_met(
            wanted,
            verdict=unchanged.verdict,
            reason=unchanged.bare_reason,
            decided_by=unchanged.decided_by,
            subject=unchanged.subject,
        ):
            continue
        yield (
            f"control {control_run.case} {control_run.mode} shows nothing: {wanted.case} "
            f"{ended_text(unchanged)} with the same seed, without what the control changes"
        )


def expected_text(control: ControlResult) -> str:
    """Return in words how a control must end, after "must"."""
    by = "" if control.oracle is None else f" by {control.oracle}"
    because = "" if control.cause is None else f", because of '{control.cause}'"
    verb = "" if control.verdict == "FAIL" else "be "
    return f"{verb}{control.verdict}{by}{because}"


def ended_text(run: ControlRun) -> str:
    """Return in words how a control ended, and by which oracle."""
    by = f" by {name}" if (name := _oracle_of(run)) else ""
    return f"FAILED{by}" if run.verdict == "FAIL" else f"was {run.verdict}{by}"


def _oracle_of(run: ControlRun) -> str:
    """Return the name of the oracle that decided a control; empty where none did."""
    sources = {event_source_of(oracle.name, oracle.vehicle): oracle.name for oracle in run.oracles}
    return sources.get(run.decided_by, "")


def _fault(run: ControlRun) -> str:
    """Return in words how a control ended against its expectation, and what to write instead."""
    if run.verdict == "PASS" or run.control is None:
        return f"this campaign cannot fail: control {run.case} in mode {run.mode} passed"
    wanted, by = run.control, _oracle_of(run)
    fault = f"control {run.case} {run.mode} must {expected_text(wanted)}, but {ended_text(run)}"
    fault += f" ({run.bare_reason})"
    if by and wanted.verdict == run.verdict and wanted.oracle not in {None, by}:
        fault += f"; expect oracle: {by}, or leave {by} out"
    return fault
