"""Whether the goal was reached: gates in order and direction, a position, in time."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

from safety.oracles.base import (
    NO_FLAGS,
    Flags,
    Gate,
    Oracle,
    OracleContext,
    OracleError,
    Terms,
    Window,
    Windowed,
    oracle,
)
from safety.oracles.terms import ON_GOAL, FirstStage, LastStage
from safety.results import OracleResult
from safety.samples import PoseSample, StageSample
from worlds.frames import Vec3, norm, subtract

Direction = Literal["away", "along", "against", "either"]
"""away: from the side on which the vehicle was before; along: the x axis of the gate's object."""


class ReachedParameters(Windowed):
    """gates: names in their order (None: the goal's); direction: which way counts."""

    gates: Annotated[
        tuple[str, ...] | None, Field(description="their names in order; by default the goal's")
    ] = None
    direction: Annotated[
        Direction,
        Field(description="away from where it came, along or against the gate's x axis, or either"),
    ] = "away"


class ReachedPositionParameters(Windowed):
    """tolerance_m: how near to the goal's position counts as reached, in metres."""

    tolerance_m: float = Field(gt=0, description="how near counts as reached")


class TimeLimitParameters(Windowed):
    """limit_s: the most time from the goal (t0) to done, in seconds."""

    limit_s: float = Field(gt=0, description="the most time from stage `from` to stage `to`")


_AFTER: dict[FirstStage, str] = {
    "takeoff": "the takeoff command",
    "at_height": "being at height",
    "goal": "its goal",
    "done": "being done",
    "land": "the landing command",
}
_AT: dict[LastStage, str] = {
    "at_height": "at height",
    "goal": "given its goal",
    "done": "done",
    "land": "told to land",
    "landed": "landed",
    "end": "at the end",
}


@dataclass(frozen=True, slots=True)
class _Passage:
    gate: str
    offset_m: float
    limit_m: float
    at_s: float


class Reached(Oracle):
    """Flies truly through the opening of each gate, in order.

    Judged by the vehicle's centre. actual: the offset with the smallest margin; limit: half of
    that gate's inner size. Passing beside a gate, from the wrong side or out of order is none.
    """

    def __init__(
        self,
        terms: Terms,
        *,
        route: Sequence[tuple[str, Gate]],
        events: Mapping[str, float],
        direction: Direction = "away",
    ) -> None:
        super().__init__(terms)
        if not route:
            raise OracleError(f"oracle {self.name!r}: the goal names no gate")
        self._route = tuple(route)
        self._events = events
        self._direction = direction
        self._last: PoseSample | None = None
        self._depth_m: float | None = None
        self._from_behind = False
        self._through: list[_Passage] = []
        self._beside: _Passage | None = None

    def on_pose(self, sample: PoseSample) -> Flags:
        """Look whether the way since the last pose leads through the next gate."""
        last, self._last = self._last or sample, sample
        if self._done or not self.stages.open:
            return NO_FLAGS
        name, gate = self._route[len(self._through)]
        here_m = sample.pose.position_ned_m
        if self._depth_m is None:
            self._depth_m = gate.depth_m(last.pose.position_ned_m, last.t_s, self._events)
            self._from_behind = self._depth_m > 0.0
        before_m, self._depth_m = self._depth_m, gate.depth_m(here_m, sample.t_s, self._events)
        if (before_m > 0.0) == (self._depth_m > 0.0):
            return NO_FLAGS
        passed = gate.crossing(last.pose.position_ned_m, last.t_s, here_m, sample.t_s, self._events)
        if passed is None or not self._right_way(passed.direction):
            return NO_FLAGS
        at_s = last.t_s + (sample.t_s - last.t_s) * passed.fraction
        return self._pass(_Passage(name, passed.offset_m, gate.limit_m, at_s))

    def result(self, t_s: float) -> OracleResult:
        """Return the largest offset, or which gate was not flown through."""
        del t_s
        if not self._done:
            limit_m = self._route[len(self._through)][1].limit_m
            return self.verdict(passed=False, limit=limit_m, unit="m", detail=self._missing())
        worst = min(self._through, key=lambda passage: passage.limit_m - passage.offset_m)
        return self.verdict(
            passed=True,
            actual=worst.offset_m,
            limit=worst.limit_m,
            unit="m",
            margin=worst.limit_m - worst.offset_m,
            at_s=worst.at_s,
            detail=f"through {worst.gate}",
        )

    @property
    def _done(self) -> bool:
        return len(self._through) == len(self._route)

    def _right_way(self, direction: int) -> bool:
        match self._direction:
            case "either":
                return True
            case "along":
                return direction == 1
            case "against":
                return direction == -1
            case "away":
                return direction == (-1 if self._from_behind else 1)

    def _pass(self, passage: _Passage) -> Flags:
        if passage.offset_m >= passage.limit_m:
            if self._beside is None or passage.offset_m < self._beside.offset_m:
                self._beside = passage
            text = f"{self.vehicle} passed beside {passage.gate}"
            return self.flag(passage.at_s, text, decisive=False)
        self._through.append(passage)
        self._depth_m = self._beside = None
        text = f"{self.vehicle} flew through {passage.gate}"
        return self.flag(passage.at_s, text, decisive=False)

    def _missing(self) -> str:
        if self._last is None:
            return "no pose seen"
        done, total = len(self._through), len(self._route)
        text = f"never flew through {self._route[done][0]} ({done} of {total} gates)"
        if self._beside is not None:
            text += f"; passed {self._beside.offset_m:.2f} m beside its centre"
        return text


class ReachedPosition(Oracle):
    """Comes within a tolerance of the goal's position, between the goal and the landing.

    actual: the smallest distance there was; limit: the tolerance.
    """

    def __init__(self, terms: Terms, *, target_ned_m: Vec3, tolerance_m: float) -> None:
        super().__init__(terms)
        self._target_ned_m = target_ned_m
        self._tolerance_m = tolerance_m
        self._best: tuple[float, float] | None = None

    def on_pose(self, sample: PoseSample) -> Flags:
        """Take a pose."""
        if not self.stages.open:
            return NO_FLAGS
        distance_m = norm(subtract(sample.pose.position_ned_m, self._target_ned_m))
        before_m = self._best[0] if self._best else float("inf")
        if distance_m < before_m:
            self._best = (distance_m, sample.t_s)
        if distance_m <= self._tolerance_m < before_m:
            return self.flag(sample.t_s, f"{self.vehicle} reached its goal", decisive=False)
        return NO_FLAGS

    def result(self, t_s: float) -> OracleResult:
        """Return the smallest distance to the goal."""
        del t_s
        if self._best is None:
            detail = "no pose seen after the goal was given"
            return self.verdict(passed=False, limit=self._tolerance_m, unit="m", detail=detail)
        actual_m, at_s = self._best
        margin_m = self._tolerance_m - actual_m
        passed = margin_m >= 0.0
        return self.verdict(
            passed=passed,
            actual=actual_m,
            limit=self._tolerance_m,
            unit="m",
            margin=margin_m,
            # That it will not get there is known at the end, not when it was the nearest: what cut
            # the flight off came before.
            at_s=at_s if passed else None,
        )


class TimeLimit(Oracle):
    """Gets from one stage to another within a time: by default from the goal to done."""

    def __init__(self, terms: Terms, *, limit_s: float) -> None:
        super().__init__(terms)
        self._limit_s = limit_s
        self._flagged = False

    def on_stage(self, sample: StageSample) -> Flags:
        """Take a stage."""
        self.stages.reach(sample)
        return self.on_tick(sample.t_s)

    def on_tick(self, t_s: float) -> Flags:
        """Flag the moment at which the time is up."""
        start_s = self.stages.begin_s
        if start_s is None or self._flagged or t_s - start_s <= self._limit_s:
            return NO_FLAGS
        end_s = self._reached_s
        if end_s is not None and end_s - start_s <= self._limit_s:
            return NO_FLAGS
        self._flagged = True
        window = self.terms.window
        text = f"{self.vehicle} was not {_AT[window.last]} {self._limit_s:g} s after"
        return self.flag(start_s + self._limit_s, f"{text} {_AFTER[window.first]}")

    def result(self, t_s: float) -> OracleResult:
        """Return the time from the goal to done, or to now."""
        start_s, end_s, window = self.stages.begin_s, self._reached_s, self.terms.window
        if start_s is None:
            detail = f"the stage '{window.first}' was never reached"
            return self.verdict(passed=False, limit=self._limit_s, unit="s", detail=detail)
        took_s = (t_s if end_s is None else end_s) - start_s
        margin_s = self._limit_s - took_s
        return self.verdict(
            passed=end_s is not None and margin_s >= 0.0,
            actual=took_s,
            limit=self._limit_s,
            unit="s",
            # Time that was left does not excuse that it was never done.
            margin=margin_s if end_s is not None or margin_s < 0.0 else None,
            at_s=start_s + took_s,
            detail="" if end_s is not None else f"never {_AT[window.last]}",
        )

    @property
    def _reached_s(self) -> float | None:
        # A later stage closes the window, but only the stage itself is what was waited for.
        return self.stages.at(self.terms.window.last)


@oracle(
    "reached",
    "flies through the goal's gates, in order and direction",
    ReachedParameters,
    window=ON_GOAL,
    at_the_end=True,
)
def reached(terms: Terms, parameters: ReachedParameters, context: OracleContext) -> Oracle:
    """Return the oracle of gates. Raises OracleError when a gate is not in the world."""
    route = context.route if parameters.gates is None else parameters.gates
    for gate in route:
        if gate not in context.gates:
            known = ", ".join(context.gates) or "none"
            message = f"the judged world has no gate {gate!r} (it has {known})"
            raise OracleError(f"oracle {terms.name!r}: {message}")
    return Reached(
        terms,
        route=[(gate, context.gates[gate]) for gate in route],
        events=context.events,
        direction=parameters.direction,
    )


@oracle(
    "reached_position",
    "comes within tolerance_m of its goal's position",
    ReachedPositionParameters,
    window=ON_GOAL,
    at_the_end=True,
)
def reached_position(
    terms: Terms, parameters: ReachedPositionParameters, context: OracleContext
) -> Oracle:
    """Return the oracle of a position goal. Raises OracleError when the goal has no position."""
    if context.target_ned_m is None:
        raise OracleError(f"oracle {terms.name!r}: the goal names no position")
    return ReachedPosition(
        terms, target_ned_m=context.target_ned_m, tolerance_m=parameters.tolerance_m
    )


@oracle(
    "time_limit",
    "gets from one stage to another within limit_s",
    TimeLimitParameters,
    window=Window("goal", "done"),
    fail_fast=True,
)
def time_limit(terms: Terms, parameters: TimeLimitParameters, context: OracleContext) -> Oracle:
    """Return the oracle of the time from one stage to another."""
    del context
    return TimeLimit(terms, limit_s=parameters.limit_s)
