"""The result of a run: the fields of result.json.

Except `wall_s`, and `slow` of an autonomy that is slower than real time, nothing here depends on
the machine: repeats of a seed are equal byte for byte.
"""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from wil_campaign.orchestrator.run_results.control_results import ControlResult, control_result
from wil_campaign.orchestrator.run_results.result_parts import (
    ArmingStep,
    ExternalResult,
    FlownFirmware,
    TwinResult,
)
from wil_campaign.safety.model.oracle_results import EvidenceResult, Flag, OracleResult, Verdict
from wil_campaign.safety.model.verdict import RunDecision
from wil_campaign.safety.preflight import PreflightItem

if TYPE_CHECKING:
    from wil_campaign.campaigns.expansion.expansion import RunPlan

Stop = Literal["signal", "command"]
"""What ended a campaign early: Ctrl-C or SIGTERM, or an operator's command."""

_NOTED = "; the autonomy's last note was '{}'"
_NOT_BEGUN = "; the autonomy had not begun to fly"


NOT_ARMED = "not armed, as --no-arm asks; everything up to that works"
"""The reason of a run that stopped before arming, as requested."""


_MOST_ALSO = 50
"""How many events a result lists beside the one that made the verdict."""
_OF_CLEARANCE = frozenset({"collision", "collision_always", "clearance"})
_GRAVEST = ("ERROR", "ABORTED")
"""The verdicts of which none is lost among the events that are not listed."""


@dataclass(frozen=True, slots=True)
class Percentiles:
    """A result's median and 99th percentile; None when nothing was measured."""

    p50: float | None
    p99: float | None


@dataclass(frozen=True, slots=True)
class SyncResult:
    """The result of synchronisation: skews in seconds, None when unknown or for one vehicle.

    command: between the takeoff commands as sent. takeoff: between the liftoffs, by mapped clocks.
    t0: between the first setpoints towards the goal. liftoff_delays_s: of each vehicle, from its
    takeoff command as sent to its liftoff.
    """

    command_skew_s: float | None = None
    takeoff_skew_s: float | None = None
    t0_skew_s: float | None = None
    liftoff_delays_s: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class ShownResult:
    """The visibility of an object of the virtual world in a combination's mixtures.

    Of the mixtures that were measured while the goal was flown. frames_in_view: geometry has the
    object in view. frames_shown: of these, the mixture showed it. offset_px: distance from its
    place in images; offset_m: error of ranges; None for the other kind.
    """

    frames_in_view: int
    frames_shown: int
    offset_px: Percentiles | None = None
    offset_m: Percentiles | None = None


@dataclass(frozen=True, slots=True)
class CombinationResult:
    """The result of one combination of the recipe.

    frames_measured: mixtures that were measured for virtual objects while the goal was flown;
    shown: the visibility, by object. not_mixed: objects that the recipe leaves out by name, and in
    how many of these mixtures they were in view. not_measured: why some or all mixtures were not
    measured. not_bounded: why the registration error of some or all has no bound.

    name: of its sensor; with its receivers where a sensor is mixed several times. sensor: its type.
    publish: vehicles whose autonomy perceives it. frames: mixtures delivered. dropped: reasons and
    counts of mixtures without the twin, or of none; "replaced": by newer readings, "missed": no
    image of the twin's source in time. faults: refused readings by reason, as "twin not_finite".
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
    registration_error_px: None without an independent reference; registration_bound_px is its bound
    then. unseen: virtual objects that the goal or a required oracle names and that no measured
    mixture had in view; all that mixtures had to show, where none was in view.
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
class LaterEvent:
    """A later decisive event in a run's result, after the one of the verdict.

    Equal events are listed once, with their count in the reason and the time of the first.
    """

    verdict: Verdict
    reason: str
    at_s: float


@dataclass(frozen=True, slots=True)
class TopicMessageLoss:
    """Messages of a topic missing in run.mcap: how many of those to be recorded."""

    topic: str
    offered: int
    lost: int


@dataclass(frozen=True, slots=True)
class ActorResult:
    """How a vehicle flew as an object of the world.

    delay_s: behind its motion; None where it did not reach its first waypoint. offset_m: largest
    distance from its path from there to the landing. flown_by: the kind of vehicle. pose_source:
    what moves the object in the world: simulator (ground truth) or mavlink (its own estimate).
    """

    name: str
    autopilot: str
    delay_s: float | None
    offset_m: float | None
    flown_by: Literal["embedded", "launched", "attached"] = "embedded"
    pose_source: str = "simulator"


@dataclass(frozen=True, slots=True)
class SlowAutonomy:
    """An autonomy slower than real time, flown on a clock that waits for it.

    needed_s: what its calls took while the goal was flown, wall time of this machine; had_s: what
    they would have had.
    """

    vehicle: str
    needed_s: float
    had_s: float


@dataclass(frozen=True, slots=True)
class EarlierAttempt:
    """An earlier attempt in a run's result, which does not count.

    verdict: None where it was cut off before one. folder: relative to the campaign's.
    """

    verdict: Verdict | None
    reason: str
    folder: str


@dataclass(frozen=True, slots=True)
class FenceChange:
    """An operator's fence change in a run's result: these vehicles were judged by it from then on.

    at_s: run clock.
    """

    at_s: float
    by: str
    vehicles: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class RunResult:
    """The result of one run. rep from 1. duration_s: takeoff command to disarm, None without.

    wall_s: how long it took on this machine. mixing: None where nothing is mixed. collisions: flags
    of contacts in their order. outside: results of the external I/O; None for a run without any.
    artifacts: files, relative to the campaign's folder. attempts: those before this one, oldest
    first. preflight: the checks before arming, and who overrode them. fence_changes: in flight,
    oldest first. evidence: the quality of the judged signals, on which the verdict rests.
    decided_by: the source of the verdict, as "reached/real"; empty for PASS. control: a control
    against its expectation; None for other runs. not_judged: default oracles that the campaign
    switched off. note: the last note of the judged vehicle's autonomy at the time of the event that
    decided, or else at the end. trace: the traceback of an autonomy that crashed. exceptions:
    internal ones, each in a line: the run is no PASS then, and the exit code never 0. twin: of the
    twin beside the real vehicle; None outside of mode wil. actors: the vehicles that flew as
    objects of the world. losses: messages missing in run.mcap, by topic. before_arming: the steps
    before arming, in order. unmoved: objects of the judged world with a motion that stood still
    until the autonomy was done. no_retry: why the run is not flown again although it is ERROR,
    INVALID or ABORTED; empty where it may be. slow: autonomies slower than real time. views_ended:
    live views that ended early, and why; the verdict does not depend on them. code: the
    user's own Python files that the run imported, relative to the campaign file, with SHA-256.
    firmware: of the vehicles that identified themselves; empty in results of earlier versions.
    evidence_files: those on which the verdict rests, as the flight wrote them, with SHA-256; empty
    in results of earlier versions.
    """

    case: str
    mode: str
    rep: int
    seed: int
    verdict: Verdict
    reason: str
    also: tuple[LaterEvent, ...]
    required: bool
    duration_s: float | None
    wall_s: float
    oracles: tuple[OracleResult, ...]
    sync: SyncResult
    mixing: MixingResult | None
    collisions: tuple[Flag, ...] = ()
    outside: ExternalResult | None = None
    artifacts: tuple[str, ...] = ()
    attempts: tuple[EarlierAttempt, ...] = ()
    preflight: tuple[PreflightItem, ...] = ()
    fence_changes: tuple[FenceChange, ...] = ()
    evidence: tuple[EvidenceResult, ...] = ()
    decided_by: str = ""
    control: ControlResult | None = None
    not_judged: tuple[str, ...] = ()
    note: str = ""
    trace: str = ""
    exceptions: tuple[str, ...] = ()
    twin: TwinResult | None = None
    losses: tuple[TopicMessageLoss, ...] = ()
    before_arming: tuple[ArmingStep, ...] = ()
    actors: tuple[ActorResult, ...] = ()
    unmoved: tuple[str, ...] = ()
    no_retry: str = ""
    slow: tuple[SlowAutonomy, ...] = ()
    views_ended: tuple[str, ...] = ()
    code: Mapping[str, str] = field(default_factory=dict)
    firmware: tuple[FlownFirmware, ...] = ()
    evidence_files: Mapping[str, str] = field(default_factory=dict)

    @property
    def subject(self) -> str:
        """Return the vehicle that the result's required oracles judge."""
        return "twin" if self.mode == "sim" else "real"

    @property
    def clearance_m(self) -> float | None:
        """Return the judged vehicle's least clearance to objects; None where none was near."""
        known = (
            oracle.actual
            for oracle in self.oracles
            if oracle.name in _OF_CLEARANCE and oracle.vehicle == self.subject
        )
        return min((actual for actual in known if actual is not None), default=None)

    @property
    def went_wrong(self) -> bool:
        """Return whether the run did not pass; a control: whether it did not end as expected."""
        return self.verdict != "PASS" if self.control is None else not self.control.met

    @property
    def bare_reason(self) -> str:
        """Return the reason of the decisive event, without what is added of the autonomy."""
        return self.reason.removesuffix(_NOTED.format(self.note)).removesuffix(_NOT_BEGUN)

    @property
    def before_autonomy(self) -> bool:
        """Return whether the run was a FAIL before its autonomy had begun to fly."""
        return self.reason.endswith(_NOT_BEGUN)

    @property
    def doubt(self) -> str:
        """Return why a FAIL may not be the autonomy's: it is INVALID too; empty for others."""
        unsound = [also.reason for also in self.also if also.verdict == "INVALID"]
        if self.verdict != "FAIL" or not unsound:
            return ""
        return f"the fault may not be the autonomy's: INVALID too, for {'; '.join(unsound)}"


def later_events_of(decision: RunDecision) -> tuple[LaterEvent, ...]:
    """Return the decisive events after the one that made the verdict; equal ones are counted."""
    counts = Counter((event.kind, event.text) for event in decision.also)
    first = {(event.kind, event.text): event.t_s for event in reversed(decision.also)}
    listed = [
        LaterEvent(kind, text if count == 1 else f"{text} ({count} times)", first[kind, text])
        for (kind, text), count in counts.items()
    ]
    if len(listed) <= _MOST_ALSO:
        return tuple(listed)
    kept, more = listed[: _MOST_ALSO - 1], listed[_MOST_ALSO - 1 :]
    verdicts = {also.verdict for also in more}
    # Whoever asks whether a vehicle may fly again looks for these.
    gravest = next((one for one in _GRAVEST if one in verdicts), more[0].verdict)
    text = f"{len(more)} more events; log.jsonl has all of them"
    return (*kept, LaterEvent(gravest, text, more[0].at_s))


def tightest_oracle(run: RunResult) -> OracleResult | None:
    """Return the required oracle of the judged vehicle with the smallest margin; None without one.

    Of the exceeded limits (margin below 0) in whatever unit; where none is, of the margins in
    metres, or else of all.
    """
    known = [
        (oracle.margin, oracle)
        for oracle in run.oracles
        if oracle.required and oracle.vehicle == run.subject and oracle.margin is not None
    ]
    exceeded = [pair for pair in known if pair[0] < 0.0]
    in_metres = [pair for pair in known if pair[1].unit == "m"]
    chosen = exceeded or in_metres or known
    return min(chosen, key=lambda pair: pair[0])[1] if chosen else None


def with_note(reason: str, note: str, *, has_begun: bool) -> str:
    """Return a result's reason with the last note of the autonomy, where there is one.

    has_begun: whether the autonomy flew by then; else the reason says that it had not begun.
    """
    if not has_begun:
        return reason + _NOT_BEGUN
    return reason + _NOTED.format(note) if note else reason


def percentiles(values: Sequence[float]) -> Percentiles:
    """Return median and 99th percentile by nearest rank, without interpolation."""
    if not values:
        return Percentiles(None, None)
    ordered = sorted(values)

    def rank(share: float) -> float:
        return ordered[max(0, math.ceil(share * len(ordered)) - 1)]

    return Percentiles(rank(0.50), rank(0.99))


def result_without_parts(
    plan: "RunPlan",
    decision: RunDecision,
    *,
    wall_s: float,
    exceptions: tuple[str, ...],
    no_retry: str = "",
) -> RunResult:
    """Return the result of a run of which no more is known than how it was decided."""
    return RunResult(
        case=plan.case,
        mode=plan.mode,
        rep=plan.repetition,
        seed=plan.seed,
        verdict=decision.verdict,
        reason=decision.reason,
        also=later_events_of(decision),
        required=plan.required,
        duration_s=None,
        wall_s=wall_s,
        oracles=(),
        sync=SyncResult(),
        mixing=None,
        decided_by=decision.source,
        control=control_of(plan, decision),
        exceptions=exceptions,
        no_retry=no_retry,
    )


def control_of(plan: "RunPlan", decision: RunDecision) -> ControlResult | None:
    """Return the control result of a run by its verdict; None where the run is no control."""
    return control_result(
        plan.control,
        verdict=decision.verdict,
        reason=decision.reason,
        decided_by=decision.source,
        subject="twin" if plan.mode == "sim" else "real",
    )
