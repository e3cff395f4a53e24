"""Control runs against their expectation: one that passes shows that its campaign cannot fail."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol

from wil_campaign.campaigns.values.expectation import Expectation
from wil_campaign.safety.model.oracle_results import Verdict
from wil_campaign.safety.model.verdict import source_of


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
    """A finished control run (protocol of `wil_campaign.orchestrator.model.results.RunResult`)."""

    @property
    def case(self) -> str:
        """Return the control's name."""

    @property
    def mode(self) -> str:
        """Return the mode in which the control was flown."""

    @property
    def verdict(self) -> Verdict:
        """Return the control run's verdict."""

    @property
    def reason(self) -> str:
        """Return the reason of the control run's verdict."""

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
    wanted = None if expected.oracle is None else source_of(expected.oracle, subject)
    met = (
        verdict == expected.verdict
        and wanted in {None, decided_by}
        and (expected.cause or "") in reason
    )
    return ControlResult(expected.case, expected.verdict, expected.oracle, expected.cause, met)


def control_faults(runs: Iterable[ControlRun]) -> list[str]:
    """Return in words each control that did not end as expected."""
    return [_fault(run) for run in runs if run.control is not None and not run.control.met]


def expected_text(control: ControlResult) -> str:
    """Return in words how a control is expected to end."""
    by = "" if control.oracle is None else f" by {control.oracle}"
    because = "" if control.cause is None else f", because of '{control.cause}'"
    return f"{control.verdict}{by}{because}"


def _fault(run: ControlRun) -> str:
    """Return in words how a control ended against its expectation."""
    name = f"control {run.case} in mode {run.mode}"
    if run.verdict == "PASS":
        return f"this campaign cannot fail: {name} passed"
    wanted = "" if run.control is None else expected_text(run.control)
    return f"{name} must end as {wanted}, but ended as {run.verdict}: {run.reason}"
