"""Whether the goal's position was reached, and whether it was done in time."""

from pydantic import Field

from wil_campaign.safety.model.oracle_results import OracleResult
from wil_campaign.safety.model.samples import PoseSample, StageSample
from wil_campaign.safety.oracles.oracle import (
    NO_FLAGS,
    Flags,
    Oracle,
    OracleContext,
    OracleError,
    OracleTerms,
    StageWindow,
    Windowed,
    oracle,
)
from wil_campaign.safety.oracles.oracle_terms import ON_GOAL, FirstStage, LastStage
from wil_campaign.worlds.frames import Vec3, norm, subtract


class ReachedPositionParameters(Windowed):
    """tolerance_m: the distance from the goal's position that counts as reached, in metres."""

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
    "land": "commanded to land",
    "landed": "landed",
    "end": "at the end",
}


class ReachedPositionOracle(Oracle):
    """The oracle of the goal's position: within a tolerance between goal and landing.

    actual: the smallest distance; limit: the tolerance.
    """

    def __init__(self, terms: OracleTerms, *, target_ned_m: Vec3, tolerance_m: float) -> None:
        super().__init__(terms)
        self._target_ned_m = target_ned_m
        self._tolerance_m = tolerance_m
        self._best: tuple[float, float] | None = None

    def on_pose(self, sample: PoseSample) -> Flags:
        """Take a pose: the distance to the goal's position."""
        if not self.stages.covers(sample.t_s):
            return NO_FLAGS
        distance_m = norm(subtract(sample.pose.position_ned_m, self._target_ned_m))
        before_m = self._best[0] if self._best else float("inf")
        if distance_m < before_m:
            self._best = (distance_m, sample.t_s)
        if distance_m <= self._tolerance_m < before_m:
            return self.flag(sample.t_s, f"{self.vehicle} reached its goal", decisive=False)
        return NO_FLAGS

    def result(self, t_s: float) -> OracleResult:
        """Return the least distance to the goal's position."""
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
            # A failure is known at the end only, not when the vehicle was nearest: an event that
            # ended the flight came before it.
            at_s=at_s if passed else None,
        )


class TimeLimitOracle(Oracle):
    """The oracle of the time between two stages: by default from the goal to done."""

    def __init__(self, terms: OracleTerms, *, limit_s: float) -> None:
        super().__init__(terms)
        self._limit_s = limit_s
        self._flagged = False

    def on_stage(self, sample: StageSample) -> Flags:
        """Take a stage: the goal's time starts or ends."""
        self.stages.reach(sample)
        return self.on_tick(sample.t_s)

    def on_tick(self, t_s: float) -> Flags:
        """Flag the moment at which the goal's time limit is exceeded."""
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
            # Where the stage was never reached, remaining time is no positive margin.
            margin=margin_s if end_s is not None or margin_s < 0.0 else None,
            at_s=start_s + took_s,
            detail="" if end_s is not None else f"never {_AT[window.last]}",
        )

    @property
    def _reached_s(self) -> float | None:
        """Return when the awaited stage (by default the goal's done) was reached; None before."""
        # A later stage closes the window as well, but does not count as reaching this one.
        return self.stages.at(self.terms.window.last)


@oracle(
    "reached_position",
    "comes within tolerance_m of its goal's position",
    ReachedPositionParameters,
    window=ON_GOAL,
    at_the_end=True,
)
def reached_position(
    terms: OracleTerms, parameters: ReachedPositionParameters, context: OracleContext
) -> Oracle:
    """Return the oracle of a position goal. Raises OracleError when the goal has no position."""
    if context.target_ned_m is None:
        raise OracleError(f"oracle {terms.name!r}: the goal names no position")
    return ReachedPositionOracle(
        terms, target_ned_m=context.target_ned_m, tolerance_m=parameters.tolerance_m
    )


@oracle(
    "time_limit",
    "gets from one stage to another within limit_s",
    TimeLimitParameters,
    window=StageWindow("goal", "done"),
    fail_fast=True,
)
def time_limit(
    terms: OracleTerms, parameters: TimeLimitParameters, context: OracleContext
) -> Oracle:
    """Return the oracle of the time from the goal to done, or between two stages."""
    del context
    return TimeLimitOracle(terms, limit_s=parameters.limit_s)
