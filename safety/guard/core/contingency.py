"""The state machine that brings one vehicle down: a table of phases, each one verified.

Pure: facts and a time in, actions out. It knows neither MAVLink nor the other vehicles.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

from wil_campaign.vehicles.autopilots.autopilot import FlightMode


class ContingencyPhase(Enum):
    """The phase of a contingency; the value is what people read."""

    IDLE = "not needed"
    PAUSE = "holding for the operator"
    HOLD = "holding"
    LAND = "commanded to land"
    DESCEND = "descending"
    SUPERVISE = "in the autopilot's own failsafe"
    DISARM = "on the ground"
    TERMINATE = "motors cut"
    PILOT = "under the pilot's control"
    DOWN = "down"


class ContingencyAction(Enum):
    """What a contingency has the guard send to the vehicle."""

    ZERO = "zero velocity"
    HOLD = "hold"
    LAND = "land"
    RTL = "return to launch"
    DISARM = "disarm"
    TERMINATE = "terminate"


@dataclass(frozen=True, slots=True)
class ContingencyFacts:
    """The known facts of a vehicle for its contingency; None is unknown.

    armed, mode, landed: as last reported (armed also after a command to arm was just forwarded).
    failsafe: its autopilot changed the mode by itself. pilot: a pilot flies it. up_m: height from
    one source (any zero). speed_m_s: along all axes. seen_s: when that position was measured.
    """

    armed: bool | None
    mode: FlightMode | None
    landed: bool | None
    failsafe: bool = False
    pilot: bool = False
    up_m: float | None = None
    speed_m_s: float | None = None
    seen_s: float | None = None


def require_landing(mode: FlightMode) -> None:
    """Raise ValueError if a contingency's landing mode is neither LAND nor RTL."""
    if mode not in {FlightMode.LAND, FlightMode.RTL}:
        raise ValueError(f"{mode.value!r} is not a landing mode")


@dataclass(frozen=True, slots=True, kw_only=True)
class ContingencyPlan:
    """The plan of a contingency: how to bring a vehicle down; times in seconds.

    landing: LAND or RTL. terminate: motors may be cut after `stalls_to_terminate` stalls, each
    a time `stall_s` over which fresh positions show that it came down less than `descent_m`.
    hold_timeout_s: more than the second between two heartbeats. settle_s, still_m_s: for how long,
    or down to which speed, a vehicle in hold brakes before it lands. supervise_s: how long its own
    failsafe may fly it without coming `lower_m` lower, more than it sways where it circles, before
    it is commanded to land; a return to launch across any usual fence takes less.
    """

    landing: FlightMode = FlightMode.LAND
    terminate: bool = False
    hold_timeout_s: float = 2.0
    settle_s: float = 1.0
    still_m_s: float = 0.3
    retry_s: float = 0.5
    stall_s: float = 5.0
    descent_m: float = 0.1
    stalls_to_terminate: int = 3
    fresh_s: float = 1.0
    supervise_s: float = 60.0
    lower_m: float = 1.0

    def __post_init__(self) -> None:
        require_landing(self.landing)


@dataclass(frozen=True, slots=True)
class _View:
    """The facts and the memory of a contingency, for the conditions of its table."""

    facts: ContingencyFacts
    plan: ContingencyPlan
    elapsed_s: float
    stalls: int
    """Stalls since the vehicle was first commanded to land."""
    stalled: bool
    """Whether a stall was detected in this step."""
    progresses: bool
    """Whether this step shows progress: the vehicle sinks, or is on its way home."""
    landing: FlightMode
    level_s: float
    """How long the vehicle has not descended in this phase."""
    overruled: bool
    """Whether the vehicle's own failsafe is overruled because it did not land it."""


Condition = Callable[[_View], bool]


@dataclass(frozen=True, slots=True)
class _Step:
    """A row of the contingency's table: condition, next phase, and why."""

    condition: Condition
    to: ContingencyPhase
    why: str


def _holds(v: _View) -> bool:
    slow = v.facts.speed_m_s is not None and v.facts.speed_m_s < v.plan.still_m_s
    return v.facts.mode is FlightMode.HOLD and (slow or v.elapsed_s >= v.plan.settle_s)


def _own_failsafe(v: _View) -> bool:
    """Return whether the autopilot flies its own failsafe, so the contingency waits."""
    flies_it = v.facts.mode not in {FlightMode.HOLD, FlightMode.GUIDED, FlightMode.LAND}
    return v.facts.failsafe and flies_it and not v.overruled


def _lands_already(v: _View) -> bool:
    return v.facts.mode is FlightMode.LAND


def _has_landed(v: _View) -> bool:
    return v.facts.landed is True


def _has_left_landing(v: _View) -> bool:
    return v.facts.mode not in {v.landing, FlightMode.LAND}


def _has_not_helped(v: _View) -> bool:
    """Return whether landing shows no progress, so the contingency continues."""
    return v.stalled or v.level_s >= v.plan.supervise_s


def _hopeless(v: _View) -> bool:
    """Return whether the contingency may terminate: repeated stalls, and the plan allows it."""
    return v.plan.terminate and v.stalled and v.stalls >= v.plan.stalls_to_terminate


_LAND_SEEN = _Step(
    lambda v: v.facts.mode is v.landing, ContingencyPhase.DESCEND, "its landing mode is confirmed"
)
_ON_GROUND = _Step(_has_landed, ContingencyPhase.DISARM, "it is on the ground")
_FAILSAFE = _Step(_own_failsafe, ContingencyPhase.SUPERVISE, "its own failsafe is active")
_HOPELESS = _Step(_hopeless, ContingencyPhase.TERMINATE, "it does not descend")

_ALWAYS: tuple[_Step, ...] = (
    _Step(lambda v: v.facts.armed is False, ContingencyPhase.DOWN, "it is disarmed"),
    _Step(lambda v: v.facts.pilot, ContingencyPhase.PILOT, "the pilot has control"),
)
"""Checked first in every phase."""

_TABLE: dict[ContingencyPhase, tuple[_Step, ...]] = {
    ContingencyPhase.HOLD: (
        _ON_GROUND,
        _Step(_lands_already, ContingencyPhase.DESCEND, "it is landing already"),
        _FAILSAFE,
        _Step(_holds, ContingencyPhase.LAND, "it holds"),
        _Step(
            lambda v: v.facts.mode is not FlightMode.HOLD and v.elapsed_s >= v.plan.hold_timeout_s,
            ContingencyPhase.LAND,
            "its hold mode was not confirmed",
        ),
    ),
    ContingencyPhase.LAND: (
        _ON_GROUND,
        _LAND_SEEN,
        _Step(_lands_already, ContingencyPhase.DESCEND, "it is landing already"),
        _FAILSAFE,
        _HOPELESS,
    ),
    ContingencyPhase.DESCEND: (
        _ON_GROUND,
        _FAILSAFE,
        _Step(_has_left_landing, ContingencyPhase.LAND, "it left its landing mode"),
        _HOPELESS,
        _Step(lambda v: v.stalled, ContingencyPhase.LAND, "it does not descend"),
    ),
    ContingencyPhase.SUPERVISE: (
        _ON_GROUND,
        _Step(_lands_already, ContingencyPhase.DESCEND, "its failsafe lands it"),
        _Step(_has_not_helped, ContingencyPhase.LAND, "its own failsafe does not land it"),
        _Step(
            lambda v: not _own_failsafe(v) and v.facts.mode is not FlightMode.RTL,
            ContingencyPhase.HOLD,
            "its own failsafe ended",
        ),
    ),
    ContingencyPhase.DISARM: (
        _Step(lambda v: v.facts.landed is False, ContingencyPhase.HOLD, "it is in the air again"),
    ),
    # What cuts motors arrives late where a link was open in one direction only.
    ContingencyPhase.TERMINATE: (
        _Step(lambda v: v.progresses, ContingencyPhase.DESCEND, "it comes down after all"),
    ),
    ContingencyPhase.DOWN: (
        _Step(lambda v: v.facts.armed is True, ContingencyPhase.HOLD, "it is armed again"),
    ),
    ContingencyPhase.PILOT: (),
}

_REPEATED: dict[ContingencyPhase, tuple[ContingencyAction, ...]] = {
    ContingencyPhase.PAUSE: (ContingencyAction.HOLD,),
    ContingencyPhase.HOLD: (ContingencyAction.HOLD,),
    ContingencyPhase.LAND: (ContingencyAction.LAND,),
    ContingencyPhase.DISARM: (ContingencyAction.LAND, ContingencyAction.DISARM),
    ContingencyPhase.TERMINATE: (ContingencyAction.TERMINATE,),
}
"""Sent on entering a phase, and again every `retry_s` while it lasts."""

_WATCHED = frozenset(
    {
        ContingencyPhase.LAND,
        ContingencyPhase.DESCEND,
        ContingencyPhase.SUPERVISE,
        ContingencyPhase.TERMINATE,
    }
)
"""In which progress is looked for."""
_STREAMING = frozenset({ContingencyPhase.PAUSE, ContingencyPhase.HOLD, ContingencyPhase.LAND})
_NO_STREAM_IN = frozenset({FlightMode.HOLD, FlightMode.LAND, FlightMode.RTL})


class Contingency:
    """The contingency state machine that brings one vehicle down; starting twice is harmless.

    `pause` and `resume` are the operator's hold, which a start overrides for good.
    """

    def __init__(self, plan: ContingencyPlan) -> None:
        self.plan = plan
        self.phase = ContingencyPhase.IDLE
        self.notes: list[str] = []
        """Phase changes since the notes were last read, as text."""
        self._entered_s = 0.0
        self._sent_s: float | None = None
        self._landing: FlightMode = plan.landing
        self._overruled = False
        self._stalls = 0
        self._lowest_m: float | None = None
        self._progress_s: float | None = None
        self._lower_s = 0.0
        self._highest_m: float | None = None
        """Since the vehicle last came lower."""

    @property
    def started(self) -> bool:
        """Return whether the contingency was started."""
        return self.phase is not ContingencyPhase.IDLE and self.phase is not ContingencyPhase.PAUSE

    @property
    def down(self) -> bool:
        """Return whether the contingency's vehicle is disarmed."""
        return self.phase is ContingencyPhase.DOWN

    def start(self, facts: ContingencyFacts, t_s: float) -> list[ContingencyAction]:
        """Start the contingency, if it has not begun; return what to send at once."""
        if self.started:
            return []
        self._enter(ContingencyPhase.HOLD, t_s, "it is being landed")
        return self.step(facts, t_s)

    def pause(self, facts: ContingencyFacts, t_s: float) -> list[ContingencyAction]:
        """Have the contingency hold the vehicle until `resume`; ignored once started."""
        if self.phase is not ContingencyPhase.IDLE:
            return []
        self._enter(ContingencyPhase.PAUSE, t_s, "the operator commanded hold")
        return self.step(facts, t_s)

    def resume(self, t_s: float) -> None:
        """End the contingency's pause; ignored once started."""
        if self.phase is ContingencyPhase.PAUSE:
            self._enter(ContingencyPhase.IDLE, t_s, "the operator commanded resume")

    def step(self, facts: ContingencyFacts, t_s: float) -> list[ContingencyAction]:
        """Step the contingency by the present facts; return what to send now."""
        if self.phase is ContingencyPhase.IDLE:
            return []
        if self.phase is not ContingencyPhase.PAUSE:
            self._advance(facts, t_s)
        return self._actions(facts, t_s)

    def _advance(self, facts: ContingencyFacts, t_s: float) -> None:
        # One phase a step: the actions of a phase are sent before it is left.
        progresses = self._progresses(facts, t_s)
        stalled = not progresses and self._find_stall(facts, t_s)
        view = _View(
            facts=facts,
            plan=self.plan,
            elapsed_s=t_s - self._entered_s,
            stalls=self._stalls,
            stalled=stalled,
            progresses=progresses,
            landing=self._landing,
            level_s=t_s - self._lower_s,
            overruled=self._overruled,
        )
        for step in (*_ALWAYS, *_TABLE[self.phase]):
            if step.to is not self.phase and step.condition(view):
                self._enter(step.to, t_s, step.why)
                return

    def _enter(self, phase: ContingencyPhase, t_s: float, why: str) -> None:
        if phase is ContingencyPhase.LAND and self.phase in {
            ContingencyPhase.DESCEND,
            ContingencyPhase.SUPERVISE,
        }:
            # The mode or failsafe that did not bring it down once is not waited for again.
            self._landing = FlightMode.LAND
            self._overruled = self._overruled or self.phase is ContingencyPhase.SUPERVISE
        self.notes.append(f"{phase.value}: {why}")
        self.phase, self._entered_s, self._sent_s = phase, t_s, None
        self._progress_s = None
        self._lower_s, self._highest_m = t_s, None

    def _progresses(self, facts: ContingencyFacts, t_s: float) -> bool:
        """Return whether fresh positions show progress, which forgives earlier stalls."""
        if self.phase not in _WATCHED or not self._fresh(facts, t_s):
            # Without fresh positions a stall cannot be shown: its time starts again.
            self._progress_s = None
        if self._progress_s is None:
            return False
        self._note_descent(facts, t_s)
        if not self._sinks(facts) and not self._is_on_its_way(facts):
            return False
        self._stalls = 0
        self._lowest_m, self._progress_s = facts.up_m, t_s
        return True

    def _find_stall(self, facts: ContingencyFacts, t_s: float) -> bool:
        """Return whether fresh positions show no progress for `stall_s`; count the stall."""
        if self.phase not in _WATCHED or not self._fresh(facts, t_s):
            return False
        since_s = self._progress_s
        if since_s is not None and t_s - since_s < self.plan.stall_s:
            return False
        self._lowest_m, self._progress_s = facts.up_m, t_s
        self._stalls += since_s is not None
        return since_s is not None

    def _fresh(self, facts: ContingencyFacts, t_s: float) -> bool:
        known = facts.up_m is not None and facts.seen_s is not None
        return known and t_s - (facts.seen_s or 0.0) <= self.plan.fresh_s

    def _sinks(self, facts: ContingencyFacts) -> bool:
        return (self._lowest_m or 0.0) - (facts.up_m or 0.0) >= self.plan.descent_m

    def _note_descent(self, facts: ContingencyFacts, t_s: float) -> None:
        up_m = facts.up_m or 0.0
        if self._highest_m is None or up_m > self._highest_m:
            self._highest_m = up_m
        elif self._highest_m - up_m >= self.plan.lower_m:
            self._lower_s, self._highest_m = t_s, up_m

    def _is_on_its_way(self, facts: ContingencyFacts) -> bool:
        # A return to launch climbs and flies level for long: any motion is progress there.
        returns = self.phase is ContingencyPhase.SUPERVISE or facts.mode is FlightMode.RTL
        return returns and (facts.speed_m_s or 0.0) > self.plan.still_m_s

    def _actions(self, facts: ContingencyFacts, t_s: float) -> list[ContingencyAction]:
        if self.phase is ContingencyPhase.PAUSE and facts.armed is False:
            return []
        streaming = self.phase in _STREAMING and facts.mode not in _NO_STREAM_IN
        actions = [ContingencyAction.ZERO] if streaming else []
        if self._sent_s is None or t_s - self._sent_s >= self.plan.retry_s - 1e-9:
            self._sent_s = t_s
            actions += self._repeat_message(facts, t_s - self._entered_s)
        return actions

    def _repeat_message(self, facts: ContingencyFacts, elapsed_s: float) -> list[ContingencyAction]:
        if (
            self.phase in {ContingencyPhase.PAUSE, ContingencyPhase.HOLD}
            and facts.mode is FlightMode.HOLD
        ):
            return []
        actions = list(_REPEATED.get(self.phase, ()))
        if self.phase is ContingencyPhase.LAND:
            patient = elapsed_s < 2.0 * self.plan.hold_timeout_s
            if self._landing is FlightMode.RTL and patient:
                actions = [ContingencyAction.RTL]
            if self._stalls:
                # In the air an autopilot refuses to disarm; one that missed its touchdown obeys.
                actions.append(ContingencyAction.DISARM)
        return actions
