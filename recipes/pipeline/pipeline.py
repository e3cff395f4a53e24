"""The mixing pipeline: mixes the readings of both worlds by a recipe.

Pure except for its buffers and the memory of its steps: the result of `mix` depends on the readings
alone, unless a clock is given to measure the steps.
"""

from collections import Counter
from collections.abc import Mapping
from typing import TypeVar, cast

from wil_campaign.recipes.model.recipe import Combination, Recipe
from wil_campaign.recipes.model.registry import StepContext
from wil_campaign.recipes.pipeline.autonomy_readings import autonomy_reading
from wil_campaign.recipes.pipeline.intake import ReadingIntake
from wil_campaign.recipes.pipeline.mixture import MixCounts, MixedReading, Provenance, StageTime
from wil_campaign.recipes.pipeline.stages import (
    MergeStage,
    Observer,
    Stage,
    StageView,
    Stopwatch,
    compile_stages,
)
from wil_campaign.recipes.working import (
    SIDES,
    AnyMasked,
    CannotMixError,
    DropReason,
    Masked,
    Need,
    PoseRequest,
    ReadingTimeline,
    Side,
)
from wil_campaign.vehicles.readings import Reading
from wil_campaign.vehicles.readings.kinds import traits_named
from wil_campaign.worlds.figures import distinct_value_text

__all__ = ["Mixer", "Stopwatch", "compile_recipe"]

R = TypeVar("R", bound=Reading)

_STAMP_S = 1e-6
"""Resolution of MAVLink's time stamps; a skew at its limit is within it."""


def compile_recipe(
    recipe: Recipe,
    *,
    object_ids: Mapping[str, int],
    stopwatch: Stopwatch | None = None,
    observer: Observer | None = None,
) -> tuple["Mixer", ...]:
    """Return the mixing pipelines of a recipe: one Mixer per combination, in order.

    object_ids: ids of the objects in the twin's readings. stopwatch: seconds, to measure the
    steps; None leaves the provenance without durations. observer: receives the two sides before
    the first step, and the result of each step. Raises ValueError for an object that the world
    lacks (`Recipe.unknown_objects` reports it with its place).
    """
    context = StepContext(object_ids, recipe.document.path.parent)
    return tuple(
        _compile(combination, context, recipe, stopwatch, observer)
        for combination in recipe.combinations
    )


def _compile(
    combination: Combination,
    context: StepContext,
    recipe: Recipe,
    stopwatch: Stopwatch | None,
    observer: Observer | None,
) -> "Mixer":
    compiled = compile_stages(combination, context, recipe.document)
    return Mixer(
        combination=combination,
        stages=compiled.stages,
        merging=compiled.merging,
        pose_request=compiled.pose_request,
        needs=compiled.needs,
        stopwatch=stopwatch,
        observer=observer,
    )


class Mixer:
    """The mixing pipeline of one sensor.

    Not reentrant: its steps keep buffers. The result shares no buffer with it, but may be the real
    reading itself, unchanged, where nothing is laid over it. observer: as in `compile_recipe`.
    """

    def __init__(
        self,
        *,
        combination: Combination,
        stages: tuple[Stage, ...],
        merging: MergeStage,
        pose_request: PoseRequest | None,
        needs: Mapping[Side, frozenset[Need]],
        stopwatch: Stopwatch | None,
        observer: Observer | None = None,
    ) -> None:
        self.combination = combination
        self.pose_request = pose_request
        self.needs = needs["twin"]
        self.real_needs = needs["real"]
        self._stages = stages
        self._merging = merging
        self._stopwatch = stopwatch
        self.observer = observer
        sensor = combination.sensor
        self._real, self._twin = (
            ReadingIntake(side, sensor.kind_of(side), combination.tolerated(side)) for side in SIDES
        )
        real, twin = (traits_named(sensor.kind_of(side)) for side in SIDES)
        make = twin.line if real is twin else None
        self._twin_line: ReadingTimeline | None = None if make is None else make()
        self._frames = 0
        self._mixed = 0
        self._dropped: Counter[DropReason] = Counter()

    @property
    def sensor(self) -> str:
        """Return the name of the sensor that the pipeline mixes."""
        return self.combination.sensor.name

    @property
    def publish(self) -> tuple[Side, ...]:
        """Return the vehicles whose autonomy receives the pipeline's mixture."""
        return self.combination.publish

    def counts(self) -> MixCounts:
        """Return the counts of the pipeline's frames so far."""
        faults = sorted((self._real.faults + self._twin.faults).items())
        dropped = tuple(sorted(self._dropped.items()))
        return MixCounts(self._frames, self._mixed, dropped, tuple(faults))

    def offer(self, side: Side, reading: Reading) -> str | None:
        """Offer an arriving reading to the pipeline; a step or the pairing may select it later.

        Readings that are passed to `mix` need not be offered, except those of the twin that last,
        as sound: `mix` uses the part of the real one's time. Returns the fault of a bad one in
        words; it is counted, and must not be mixed.
        """
        intake = self._real if side == "real" else self._twin
        fault = intake.fault_of(reading)
        if fault is None and side == "twin" and self._twin_line is not None:
            self._twin_line.add(reading)
        elif fault is None:
            passed: Reading | None = reading
            for stage in self._stages:
                # Steps that select by time come before all others, so none is left out here.
                passed = stage.offer(side, passed) if passed is not None else None
        return fault

    def mix(
        self,
        real: R | None,
        twin: Reading | None,
        *,
        now_s: float,
        alignment: str = "",
    ) -> MixedReading[R]:
        """Return the mixture of two readings, delivered at `now_s` on the run clock.

        The real reading sets the time. Without one there is no mixture, as a vehicle whose sensor
        is silent must not receive readings. Without a usable one of the twin (none, too far in
        time, too late, wrong size) the real one passes through. Both are counted, with the reason
        in the provenance. alignment: how the pose of the twin's reading was determined, or what is
        missing ("no pose for the exposure"). Raises StepError when a step itself fails.
        """
        run = _Frame(self._stages, self._merging, self._stopwatch, self._frames, self.observer)
        self._frames += 1
        reading, fault = self._run(run, real, twin, now_s, alignment)
        if fault is None:
            self._mixed += 1
        else:
            self._dropped[fault.reason] += 1
        used = run.sides.get("real")
        mixed = (
            None
            if reading is None or used is None
            else autonomy_reading(reading, used.reading, now_s, self.sensor)
        )
        provenance = _provenance(
            real=run.used("real", real),
            twin=run.used("twin", twin),
            now_s=now_s,
            fault=fault,
            alignment=alignment,
            times=run.times,
            given=(_seq(real), _seq(twin)),
        )
        return MixedReading(cast("R | None", mixed), provenance)

    def _run(
        self,
        run: "_Frame",
        real: Reading | None,
        twin: Reading | None,
        now_s: float,
        alignment: str,
    ) -> tuple[Reading | None, CannotMixError | None]:
        """Run the pipeline on a frame; return the merged reading, and the fault if partial."""
        if real is None:
            return None, CannotMixError("no_real", f"no {self._real.kind} reading of real")
        if (bad := self._real.fault_of(real)) is not None:
            return None, CannotMixError("bad_real", bad)
        run.sides["real"] = Masked(real)
        fault: CannotMixError | None = None
        if twin is None:
            why = f": {alignment}" if alignment.startswith("no ") else ""
            fault = CannotMixError("no_twin", f"no {self._twin.kind} reading of the twin{why}")
        elif (bad := self._twin.fault_of(twin)) is not None:
            fault = CannotMixError("bad_twin", bad)
        else:
            try:
                run.sides["twin"] = Masked(self._of_real_time(twin, real))
            except CannotMixError as hole:
                fault = hole
        try:
            fault = run.apply() or fault
            fault = self._overdue(run.sides, now_s) or fault
            return run.merged(fault)
        except CannotMixError as error:
            return None, error

    def _of_real_time(self, twin: Reading, real: Reading) -> Reading:
        """Return the twin's reading to mix: of sound the part that sounded during the real block.

        Raises CannotMixError where that is not known.
        """
        if self._twin_line is None:
            return twin
        self._twin_line.add(twin)
        during: Reading = self._twin_line.during(real, twin)
        return during

    def _overdue(self, sides: dict[Side, AnyMasked], now_s: float) -> CannotMixError | None:
        """Remove the twin's reading from the frame when its skew or age exceeds the limit."""
        if "twin" not in sides:
            return None
        real_s, twin_s = sides["real"].reading.t_s, sides["twin"].reading.t_s
        budget = self.combination.budget
        skew_s, age_s = abs(real_s - twin_s), now_s - min(real_s, twin_s)
        if skew_s > budget.max_skew_s + _STAMP_S:
            reason: DropReason = "stale"
            apart, limit = _ms(skew_s, budget.max_skew_s)
            message = f"exposures {apart} apart, more than {limit}"
        elif budget.max_latency_s is not None and age_s > budget.max_latency_s + _STAMP_S:
            reason = "late"
            age, limit = _ms(age_s, budget.max_latency_s)
            message = f"{age} old at delivery, more than {limit}"
        else:
            return None
        del sides["twin"]
        return CannotMixError(reason, message)


class _Frame:
    """One frame in the pipeline: the two sides after each step, and the steps' durations."""

    __slots__ = ("_frame", "_merging", "_observer", "_stages", "_stopwatch", "sides", "times")

    def __init__(
        self,
        stages: tuple[Stage, ...],
        merging: MergeStage,
        stopwatch: Stopwatch | None,
        frame: int,
        observer: Observer | None,
    ) -> None:
        self._stages = stages
        self._merging = merging
        self._stopwatch = stopwatch
        self._frame = frame
        self._observer = observer
        self.sides: dict[Side, AnyMasked] = {}
        self.times: list[StageTime] = []

    def used(self, side: Side, given: Reading | None) -> Reading | None:
        """Return the reading of a side in this frame: the one a step selected, or the given one."""
        work = self.sides.get(side)
        return given if work is None else cast("Reading", work.reading)

    def apply(self) -> CannotMixError | None:
        """Run the pipeline's steps on the frame; return why the twin's reading was left out.

        Raises CannotMixError when a step cannot work on the real side.
        """
        left_out: CannotMixError | None = None
        for side in self.sides:
            self._show(side, side)
        for stage in self._stages:
            started_s = self._now()
            for side in stage.sides:
                if side not in self.sides:
                    continue
                try:
                    self.sides[side] = stage.apply(side, self.sides, self._frame)
                    self._show(stage.name, side)
                except CannotMixError as fault:
                    if side == "real":
                        raise
                    left_out = fault
                    del self.sides["twin"]
            self._note(stage.name, started_s)
        return left_out

    def merged(self, fault: CannotMixError | None) -> tuple[Reading, CannotMixError | None]:
        """Return the merged reading, and the fault; the real's alone when the two do not fit."""
        started_s = self._now()
        try:
            reading = self._merging.apply(self.sides, self._frame)
        except CannotMixError as mismatch:
            if "twin" not in self.sides:
                raise
            fault = mismatch
            reading = self._merging.apply({"real": self.sides["real"]}, self._frame)
        self._note(self._merging.name, started_s)
        if self._observer is not None:
            self._observer(StageView(self._merging.name, None, Masked(reading)))
        return reading, fault

    def _show(self, name: str, side: Side) -> None:
        """Pass the frame after a step to the pipeline's observer."""
        if self._observer is not None:
            self._observer(StageView(name, side, self.sides[side]))

    def _now(self) -> float:
        """Return the time of the pipeline's stopwatch; 0 without one."""
        return self._stopwatch() if self._stopwatch is not None else 0.0

    def _note(self, name: str, started_s: float) -> None:
        """Store the duration of a step of the pipeline on this frame."""
        if self._stopwatch is not None:
            self.times.append(StageTime(name, self._stopwatch() - started_s))


def _ms(time_s: float, limit_s: float) -> tuple[str, str]:
    """Return a time, as text that tells it from its limit, and the limit, in milliseconds."""
    limit_ms = limit_s * 1000
    return f"{distinct_value_text(time_s * 1000, limit_ms, digits=0)} ms", f"{limit_ms:g} ms"


def _provenance(
    *,
    real: Reading | None,
    twin: Reading | None,
    now_s: float,
    fault: CannotMixError | None,
    alignment: str,
    times: list[StageTime],
    given: tuple[int | None, int | None],
) -> Provenance:
    """Return the provenance of a frame that left the pipeline."""
    real_t_s = real.t_s if real is not None else None
    twin_t_s = twin.t_s if twin is not None else None
    skew_ms = (
        abs(real_t_s - twin_t_s) * 1000.0 if real_t_s is not None and twin_t_s is not None else None
    )
    return Provenance(
        real_seq=_seq(real),
        real_t_s=real_t_s,
        twin_seq=_seq(twin),
        twin_t_s=twin_t_s,
        skew_ms=skew_ms,
        latency_ms=(now_s - real_t_s) * 1000.0 if real_t_s is not None else None,
        alignment=alignment,
        dropped=fault.reason if fault is not None else None,
        detail=str(fault) if fault is not None else "",
        stages=tuple(times),
        mixed_s=now_s,
        given_real_seq=given[0],
        given_twin_seq=given[1],
    )


def _seq(reading: Reading | None) -> int | None:
    """Return a reading's sequence number for the provenance; None for None."""
    return None if reading is None else reading.seq
