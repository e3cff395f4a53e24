"""Whether controls ended as they must: one that passes shows that its campaign cannot fail."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol

from campaigns.expansion.controls import Expectation
from safety.model.oracle_results import Verdict
from safety.model.verdict import source_of


@dataclass(frozen=True, slots=True)
class ControlResult:
    """How a control ended against how it must. case: the one that it changes.

    verdict, oracle, cause: what is expected. met: whether it ended so.
    """

    case: str
    verdict: Verdict
    oracle: str | None
    cause: str | None
    met: bool


class ControlRun(Protocol):
    """A finished control; `orchestrator.model.results.RunResult`."""

    @property
    def case(self) -> str:
        """Return the control's name."""

    @property
    def mode(self) -> str:
        """Return the mode in which it was flown."""

    @property
    def verdict(self) -> Verdict:
        """Return the verdict."""

    @property
    def reason(self) -> str:
        """Return the reason."""

    @property
    def control(self) -> ControlResult | None:
        """Return how it ended against how it must; None for a run that is no control."""


def control_result(
    expected: Expectation | None, *, verdict: Verdict, reason: str, decided_by: str, subject: str
) -> ControlResult | None:
    """Return how a run that came to a verdict did as a control; None where it is none.

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
    """Return in words each control that did not end as it must."""
    return [_fault(run) for run in runs if run.control is not None and not run.control.met]


def expected_text(control: ControlResult) -> str:
    """Return in words how a control must end."""
    by = "" if control.oracle is None else f" by {control.oracle}"
    because = "" if control.cause is None else f", because of '{control.cause}'"
    return f"{control.verdict}{by}{because}"


def _fault(run: ControlRun) -> str:
    name = f"control {run.case} in mode {run.mode}"
    if run.verdict == "PASS":
        return f"this campaign cannot fail: {name} passed"
    wanted = "" if run.control is None else expected_text(run.control)
    return f"{name} must end as {wanted}, and came to {run.verdict}: {run.reason}"
