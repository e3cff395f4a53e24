"""What a run and a campaign came to: fields exactly as result.json and summary.json carry them.

Beside `wall_s` nothing here depends on the machine: repeats of a seed are equal byte for byte.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Literal

from campaigns.values.acceptance import Requirement, Share, Standing, standings
from orchestrator.model.control_results import ControlResult, control_faults
from orchestrator.model.external_results import ExternalResult
from orchestrator.model.twin_results import TwinResult
from safety.model.oracle_results import EvidenceResult, Flag, OracleResult, Verdict
from safety.preflight import Item

Clock = Literal["virtual", "wall", "scaled"]
VehicleKind = Literal["embedded", "sitl", "hardware", "unknown"]
SensorKind = Literal["live", "rendered", "file", "synthesised"]
"""Where readings come from; synthesised: computed from the pose of a vehicle and its world, for one
that is not our simulation and may have such a sensor itself."""
Stop = Literal["signal", "command"]
"""What ended a campaign early: Ctrl-C or SIGTERM, or an operator's command."""

_NOTED = "; the autonomy's last note was '{}'"
_PROVEN = frozenset({"PASS", "FAIL"})
VERDICTS: tuple[Verdict, ...] = ("PASS", "FAIL", "INVALID", "ERROR", "ABORTED")


NOT_ARMED = "not armed, as --no-arm asks; everything up to that works"
"""The reason of a run that ended there as it should."""


@dataclass(frozen=True, slots=True)
class Percentiles:
    """A result's median and 99th percentile; None when nothing was measured."""

    p50: float | None
    p99: float | None


@dataclass(frozen=True, slots=True)
class SyncResult:
    """The result of synchronisation: skews in seconds, None when unknown or for one vehicle.

    command: between the takeoff commands on the wire. takeoff: between the times off the ground,
    by mapped clocks. t0: between the times at which each was given its goal. liftoff_delays_s: of
    each vehicle, from its takeoff command on the wire to its liftoff.
    """

    command_skew_s: float | None = None
    takeoff_skew_s: float | None = None
    t0_skew_s: float | None = None
    liftoff_delays_s: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class ShownResult:
    """The result of how well mixtures showed an object of the virtual world.

    Of the mixtures that were measured while the goal was flown. frames_in_view: geometry says that
    it was in view. frames_shown: of these, the mixture showed it. offset_px: how far from its
    place in pictures; offset_m: by how much ranges were off; None for the other kind.
    """

    frames_in_view: int
    frames_shown: int
    offset_px: Percentiles | None = None
    offset_m: Percentiles | None = None


@dataclass(frozen=True, slots=True)
class CombinationResult:
    """The result of one combination of the recipe.

    frames_measured: mixtures in which the virtual objects were sought while the goal was flown;
    shown: what came of it, by object. not_mixed: objects that the recipe leaves out by name, and in
    how many of these they were in view. not_measured: why some or all mixtures could not be.
    not_bounded: why the registration error of some or all has no bound, so that no limit applies.

    name: of its sensor; with its receivers where a sensor is mixed several times. sensor: its type.
    publish: who perceives it. frames: mixtures delivered. dropped: why something of the twin, or
    all, is missing, and how often; "replaced" made way for newer readings, "missed" got no image of
    the twin's source in time. faults: readings that were refused, as "twin not_finite".
    """

    name: str
    sensor: str
    publish: tuple[str, ...]
    frames: int
    dropped: dict[str, int]
    faults: dict[str, int]
    rate_hz: float
    skew_ms: Percentiles
    latency_ms: Percentiles
    registration_error_px: Percentiles | None = None
    registration_bound_px: Percentiles | None = None
    frames_measured: int = 0
    shown: dict[str, ShownResult] = field(default_factory=dict)
    not_mixed: dict[str, int] = field(default_factory=dict)
    not_measured: str = ""
    not_bounded: str = ""


@dataclass(frozen=True, slots=True)
class MixingResult:
    """The result of one run's mixing.

    The figures are those of the recipe's first combination; `combinations` has all of them.
    registration_error_px: None without an independent reference; registration_bound_px then says
    what it is within. unseen: virtual objects that the goal or a required oracle names and that no
    measured mixture had in view.
    """

    frames: int
    dropped: int
    rate_hz: float
    skew_ms: Percentiles
    latency_ms: Percentiles
    registration_error_px: Percentiles | None = None
    registration_bound_px: Percentiles | None = None
    combinations: tuple[CombinationResult, ...] = ()
    frames_measured: int = 0
    shown: dict[str, ShownResult] = field(default_factory=dict)
    not_measured: str = ""
    unseen: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Also:
    """A later decisive event in a run's result, after the one of the verdict.

    Equal ones stand once, with their count in the reason, and the time of the first.
    """

    verdict: Verdict
    reason: str
    at_s: float


@dataclass(frozen=True, slots=True)
class Loss:
    """What run.mcap lacks of a topic: so many messages of those that were to be recorded."""

    topic: str
    offered: int
    lost: int


@dataclass(frozen=True, slots=True)
class Attempt:
    """An earlier attempt in a run's result, which does not count.

    verdict: None where it was cut off and has none. folder: where it is kept, from the campaign's.
    """

    verdict: Verdict | None
    reason: str
    folder: str


@dataclass(frozen=True, slots=True)
class FenceChange:
    """A fence change by an operator in a run's result: these vehicles were judged by it since.

    at_s: run clock.
    """

    at_s: float
    by: str
    vehicles: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class RunResult:
    """The result of one run. rep from 1. duration_s: takeoff command to disarm, None without.

    wall_s: how long it took on this machine. mixing: None where nothing is mixed. collisions: the
    flags of contacts as they happened. outside: what came in and went out; None for a run that
    has nothing outside of its own processes. artifacts: files, relative to the campaign's folder.
    attempts: those before this one, oldest first; a PASS after any is no clean one. preflight: what
    was checked before arming, and who overrode what. fence_changes: in flight, oldest first.
    evidence: what the judged signals showed; on this the verdict rests.
    decided_by: what made the verdict, as "reached/real"; empty for PASS. control: how a control
    ended against how it must; None for a run of the campaign itself. not_judged: what is judged
    always, and was left out by the campaign. note: what the judged vehicle's autonomy noted
    last before that. trace: the traceback of an autonomy that crashed.
    exceptions: of ours, each in a line: then it is no PASS, and the program's exit code never 0.
    twin: what the twin did beside the real vehicle; None but in mode wil.
    losses: what run.mcap lacks, by topic.
    """

    case: str
    mode: str
    rep: int
    seed: int
    verdict: Verdict
    reason: str
    also: tuple[Also, ...]
    required: bool
    duration_s: float | None
    wall_s: float
    oracles: tuple[OracleResult, ...]
    sync: SyncResult
    mixing: MixingResult | None
    collisions: tuple[Flag, ...] = ()
    outside: ExternalResult | None = None
    artifacts: tuple[str, ...] = ()
    attempts: tuple[Attempt, ...] = ()
    preflight: tuple[Item, ...] = ()
    fence_changes: tuple[FenceChange, ...] = ()
    evidence: tuple[EvidenceResult, ...] = ()
    decided_by: str = ""
    control: ControlResult | None = None
    not_judged: tuple[str, ...] = ()
    note: str = ""
    trace: str = ""
    exceptions: tuple[str, ...] = ()
    twin: TwinResult | None = None
    losses: tuple[Loss, ...] = ()

    @property
    def subject(self) -> str:
        """Return the vehicle that the result's required oracles judge."""
        return "twin" if self.mode == "sim" else "real"

    @property
    def bare_reason(self) -> str:
        """Return the result's reason as the decisive event has it, without the last note."""
        return self.reason.removesuffix(_NOTED.format(self.note))


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


def with_note(reason: str, note: str) -> str:
    """Return a result's reason with the last note of the autonomy, where there is one."""
    return reason + _NOTED.format(note) if note else reason


def percentiles(values: Sequence[float]) -> Percentiles:
    """Return median and 99th percentile by nearest rank, which needs no interpolation."""
    if not values:
        return Percentiles(None, None)
    ordered = sorted(values)

    def rank(share: float) -> float:
        return ordered[max(0, math.ceil(share * len(ordered)) - 1)]

    return Percentiles(rank(0.50), rank(0.99))


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
    broken: bool = False,
    controls_due: int = 0,
    missing: int = 0,
    caveats: tuple[str, ...] = (),
    not_flown: tuple[str, ...] = (),
) -> Summary:
    """Return the summary of run results, in the order given.

    stopped, broken, controls_due, missing: as of `exit_code`; controls that were flown are among
    the runs.
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
            broken=broken,
            controls_due=controls_due,
            missing=missing,
        ),
        left_out=left_out,
        controls=controls,
        unmet=tuple(control_faults(controls)),
        caveats=caveats,
        not_flown=not_flown,
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


def standings_of(
    runs: Iterable[RunResult], requirements: Iterable[Requirement]
) -> tuple[Standing, ...]:
    """Return how far run results meet each requirement of the campaign."""
    return standings(
        requirements,
        (
            (run.case, run.mode, run.verdict == "PASS" if run.verdict in _PROVEN else None)
            for run in runs
            if run.control is None
        ),
    )


def accepted(
    runs: Sequence[RunResult],
    requirements: Sequence[Requirement],
    *,
    stopped: Stop | None = None,
    broken: bool = False,
    controls_due: int = 0,
    missing: int = 0,
) -> bool | None:
    """Return whether results make the campaign accepted; None without a required run.

    Accepted is what ends with exit code 0, and nothing else; the arguments are those of
    `exit_code`. A share such as 4/5 forgives a FAIL, never an ERROR, INVALID or ABORTED: those
    flights prove nothing, so they cannot be among the ones that a campaign may lose. Nor may it
    lose one that was never flown. Nor is a campaign accepted with a control that is not flown or
    did not end as it must: its green would mean nothing.
    """
    if any(run.control is not None and not run.control.met for run in runs):
        return False
    if not any(run.required for run in runs):
        return None
    code = exit_code(
        runs,
        requirements,
        stopped=stopped,
        broken=broken,
        controls_due=controls_due,
        missing=missing,
    )
    return code == 0


def _short(required: Sequence[RunResult], requirements: Iterable[Requirement]) -> list[Standing]:
    """Return the requirements that results do not meet; uncovered runs must pass by themselves."""
    wanted = list(requirements)
    covered = {(one.case, one.mode) for one in wanted}
    for run in required:
        if (run.case, run.mode) not in covered:
            covered.add((run.case, run.mode))
            count = sum((r.case, r.mode) == (run.case, run.mode) for r in required)
            wanted.append(Requirement(run.case, run.mode, Share(count, count)))
    return [standing for standing in standings_of(required, wanted) if not standing.met]


def is_rehearsed(run: RunResult) -> bool:
    """Return whether a run came to arming as --no-arm asks, and nothing went wrong after that.

    An ERROR of its end is one: a vehicle may have kept parameters and fence of the run.
    """
    came_there = run.verdict == "ABORTED" and run.reason == NOT_ARMED
    return came_there and not run.exceptions and all(one.verdict != "ERROR" for one in run.also)


def rehearsal_code(runs: Sequence[RunResult]) -> int:
    """Return the exit code of results without arming (--no-arm): 5 when all works.

    A run that was aborted for another reason than that has shown nothing.
    """
    if any(run.verdict == "ABORTED" and run.reason != NOT_ARMED for run in runs):
        return 4
    return 5 if all(map(is_rehearsed, runs)) else 3


def exit_code(
    runs: Sequence[RunResult],
    requirements: Sequence[Requirement],
    *,
    stopped: Stop | None = None,
    broken: bool = False,
    controls_due: int = 0,
    missing: int = 0,
) -> int:
    """Return the exit code of a campaign's results; the first of 130, 4, 3, 1, 5, 0.

    stopped: what ended the campaign early. broken: an exception reached the orchestrator, or a
    vehicle, port or broker could not be had; then it is never 0. An ABORTED run counts as an
    operator's command whether or not it was required. Required runs (missing: how many) and
    controls that were never flown though nobody stopped the campaign are 3, whatever share of the
    required runs may FAIL.

    A control that did not end as it must is 3 where it came to ERROR or INVALID, which prove
    nothing, and else 1, as a required run that FAILed: all was flown, and something is wrong.
    """
    if stopped == "signal":
        return 130
    if stopped == "command" or any(run.verdict == "ABORTED" for run in runs):
        return 4
    broken = broken or any(run.exceptions for run in runs)
    if broken or missing:
        return 3
    return _code_of(runs, requirements, controls_due)


def _code_of(
    runs: Sequence[RunResult], requirements: Sequence[Requirement], controls_due: int
) -> int:
    """Return the exit code of an uninterrupted campaign's results."""
    required = [run for run in runs if run.required]
    unmet = [run for run in runs if run.control is not None and not run.control.met]
    if any(run.verdict in {"ERROR", "INVALID"} for run in (*required, *unmet)):
        return 3
    if sum(run.control is not None for run in runs) < controls_due:
        return 3
    if not required:
        return 1 if unmet else 5
    short = _short(required, requirements)
    if not all(standing.is_complete for standing in short):
        return 3
    return 1 if short or unmet else 0
