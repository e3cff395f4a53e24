"""What a campaign came to: fields exactly as summary.json carries them."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

from campaigns.values.acceptance import Requirement
from orchestrator.model.control_results import control_faults
from orchestrator.model.exit_codes import accepted
from orchestrator.model.results import RunResult, Stop
from safety.model.oracle_results import Verdict

Clock = Literal["virtual", "wall", "scaled"]
VehicleKind = Literal["embedded", "sitl", "hardware", "unknown"]
SensorKind = Literal["live", "rendered", "file", "synthesised"]
"""Where readings come from; synthesised: computed from the pose of a vehicle and its world, for one
that is not our simulation and may have such a sensor itself."""
VERDICTS: tuple[Verdict, ...] = ("PASS", "FAIL", "INVALID", "ERROR", "ABORTED")
UNKNOWN_ENDING = (
    "summary.json does not say that it came to its end: it was cut off, or flown by an earlier "
    "version"
)
_STOPS = {
    "signal": "stopped by Ctrl-C or SIGTERM",
    "command": "stopped by an operator's command",
}


@dataclass(frozen=True, slots=True)
class Totals:
    """The totals of results: runs flown, required, and by verdict.

    retried: how many of them were flown more than once, whatever they came to. Controls count in
    `controls` alone, and in `controls_met` those that ended as they must.
    """

    runs: int
    required: int
    passed: int
    failed: int
    invalid: int
    error: int
    aborted: int
    retried: int = 0
    controls: int = 0
    controls_met: int = 0


@dataclass(frozen=True, slots=True)
class Summary:
    """The summary of a campaign's results. surrogate: the embedded vehicle played `real`.

    sensors: for each sensor where its readings came from. accepted: None when no required run was
    flown and no control failed to do what it must. left_out: what the campaign requires and the
    command line left out, in words. controls: the runs that must not pass, which stand here alone.
    unmet: the controls that did not end as they must, in words. caveats: of the campaign itself.
    not_flown: runs and controls that were never flown to a result, by name.

    stopped, broken: how the campaign ended outside of its runs, as of `exit_code`. broken is None
    until the campaign has come to its end: it flies still, or was cut off; so it is in what
    earlier versions wrote.
    """

    campaign: str
    clock: Clock
    surrogate: bool
    real_kind: VehicleKind
    sensors: dict[str, SensorKind]
    runs: tuple[RunResult, ...]
    totals: Totals
    accepted: bool | None
    left_out: tuple[str, ...] = ()
    controls: tuple[RunResult, ...] = ()
    unmet: tuple[str, ...] = ()
    caveats: tuple[str, ...] = ()
    not_flown: tuple[str, ...] = ()
    stopped: Stop | None = None
    broken: bool | None = None

    @property
    def ending(self) -> str:
        """Return in words what ended the campaign outside of its runs; empty for its own end."""
        if self.stopped is not None:
            return _STOPS[self.stopped]
        if self.broken is None:
            return UNKNOWN_ENDING
        return "an exception of this program came up outside of its runs" if self.broken else ""


def summarize(
    runs: Iterable[RunResult],
    requirements: Sequence[Requirement],
    *,
    campaign: str,
    clock: Clock,
    surrogate: bool,
    real_kind: VehicleKind,
    sensors: dict[str, SensorKind],
    left_out: tuple[str, ...] = (),
    stopped: Stop | None = None,
    broken: bool | None = False,
    controls_due: int = 0,
    missing: int = 0,
    caveats: tuple[str, ...] = (),
    not_flown: tuple[str, ...] = (),
) -> Summary:
    """Return the summary of run results, in the order given.

    stopped, broken, controls_due, missing: as of `exit_code`; controls that were flown are among
    the runs. broken: None where the campaign has not come to its end, or nobody knows that it has:
    then nothing is accepted.
    """
    given = tuple(runs)
    flown = tuple(run for run in given if run.control is None)
    controls = tuple(run for run in given if run.control is not None)
    return Summary(
        campaign=campaign,
        clock=clock,
        surrogate=surrogate,
        real_kind=real_kind,
        sensors=dict(sorted(sensors.items())),
        runs=flown,
        totals=totals_of(given),
        accepted=accepted(
            given,
            requirements,
            stopped=stopped,
            broken=broken is not False,
            controls_due=controls_due,
            missing=missing,
        ),
        left_out=left_out,
        controls=controls,
        unmet=tuple(control_faults(controls)),
        caveats=caveats,
        not_flown=not_flown,
        stopped=stopped,
        broken=broken,
    )


def totals_of(runs: Sequence[RunResult]) -> Totals:
    """Return the totals of run results."""
    controls = [run.control for run in runs if run.control is not None]
    runs = [run for run in runs if run.control is None]
    count = {verdict: sum(run.verdict == verdict for run in runs) for verdict in VERDICTS}
    return Totals(
        runs=len(runs),
        required=sum(run.required for run in runs),
        passed=count["PASS"],
        failed=count["FAIL"],
        invalid=count["INVALID"],
        error=count["ERROR"],
        aborted=count["ABORTED"],
        retried=sum(bool(run.attempts) for run in runs),
        controls=len(controls),
        controls_met=sum(control.met for control in controls),
    )
