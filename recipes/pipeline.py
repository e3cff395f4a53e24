"""The mixing pipeline: a recipe and the readings of both worlds in, the mixed reading out.

Pure but for its buffers: what `mix` returns depends on the readings that it is given and on
nothing else, unless a clock is handed in to measure the steps.
"""

import math
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from recipes.mixed import MixCounts, Mixed, Provenance, StageTime
from recipes.recipe import Combination, Recipe
from recipes.registry import Context
from recipes.working import (
    SIDES,
    CannotMixError,
    DropReason,
    Masked,
    Merge,
    Need,
    Operator,
    PoseRequest,
    Side,
)
from vehicles.readings import CameraReading

Stopwatch = Callable[[], float]

_STAMP_S = 1e-6
"""MAVLink stamps count microseconds: a skew at its limit is within it."""


def compile_recipe(
    recipe: Recipe,
    *,
    object_ids: Mapping[str, int],
    stopwatch: Stopwatch | None = None,
) -> tuple["Mixer", ...]:
    """Return a mixer for each combination of a recipe, in their order.

    object_ids: what `object_ids` of the twin's pictures mean. stopwatch: seconds, to measure the
    steps; None leaves the provenance without durations. Raises ValueError for an object that
    the world has not (`Recipe.unknown_objects` says it with its place).
    """
    context = Context(object_ids)
    return tuple(_compile(one, context, stopwatch) for one in recipe.combinations)


@dataclass(frozen=True, slots=True)
class _Stage:
    name: str
    sides: tuple[Side, ...]
    operators: Mapping[Side, Operator]
    """One operator for each side: each has buffers, and perhaps a memory, of its own."""


def _compile(combination: Combination, context: Context, stopwatch: Stopwatch | None) -> "Mixer":
    stages: list[_Stage] = []
    request: PoseRequest | None = None
    needs: frozenset[Need] = frozenset()
    for step in combination.steps:
        sides = step.parameters.sides()
        needs |= step.parameters.needs
        built = {side: step.kind.build(step.parameters, context) for side in sides or SIDES[1:]}
        first = next(iter(built.values()))
        if isinstance(first, PoseRequest):
            request = first
        else:
            stages.append(_Stage(step.kind.name, sides, cast("Mapping[Side, Operator]", built)))
    merge = combination.merge
    return Mixer(
        combination=combination,
        stages=tuple(stages),
        merge=cast("Merge", merge.kind.build(merge.parameters, context)),
        pose_request=request,
        needs=needs | merge.parameters.needs,
        stopwatch=stopwatch,
    )


class Mixer:
    """Mixes the readings of one sensor.

    Hand it one pair at a time: its steps keep buffers. What it returns shares no buffer with it,
    but may share the real picture, unchanged, where nothing is laid over it.
    """

    def __init__(
        self,
        *,
        combination: Combination,
        stages: tuple[_Stage, ...],
        merge: Merge,
        pose_request: PoseRequest | None,
        needs: frozenset[Need],
        stopwatch: Stopwatch | None,
    ) -> None:
        self.combination = combination
        self.pose_request = pose_request
        self.needs = needs
        self._stages = stages
        self._merge = merge
        self._stopwatch = stopwatch
        self._frames = 0
        self._mixed = 0
        self._dropped: Counter[DropReason] = Counter()

    @property
    def sensor(self) -> str:
        """Return the name of the sensor that is mixed."""
        return self.combination.sensor.name

    @property
    def publish(self) -> tuple[Side, ...]:
        """Return the vehicles to whose autonomy the mixture goes."""
        return self.combination.publish

    def counts(self) -> MixCounts:
        """Return what became of the frames so far."""
        return MixCounts(self._frames, self._mixed, tuple(sorted(self._dropped.items())))

    def mix(
        self,
        real: CameraReading | None,
        twin: CameraReading | None,
        *,
        now_s: float,
        alignment: str = "",
    ) -> Mixed:
        """Return the mixture of two readings, delivered at `now_s` on the run clock.

        The real picture sets the time: without one there is no mixture, for a vehicle whose
        camera is silent must not be told that it sees. Without a usable twin's picture (none,
        too far in time, wrong size) the real one passes through; both are counted and said.
        alignment: how the pose of the twin's picture was found, for the record.
        """
        times: list[StageTime] = []
        reading, fault = self._run(real, twin, times)
        self._frames += 1
        if fault is None:
            self._mixed += 1
        else:
            self._dropped[fault.reason] += 1
        mixed = None if reading is None or real is None else perceived(reading, real, now_s)
        provenance = _provenance(real, twin, now_s, fault)
        return Mixed(mixed, replace(provenance, alignment=alignment, stages=tuple(times)))

    def _run(
        self, real: CameraReading | None, twin: CameraReading | None, times: list[StageTime]
    ) -> tuple[CameraReading | None, CannotMixError | None]:
        """Return what is to be seen, if anything, and what is missing of the mixture, if so."""
        if real is None:
            return None, CannotMixError("no_real", "no picture of the real camera")
        if (fault := _fault_of(real)) is not None:
            return None, CannotMixError("bad_real", fault)
        try:
            usable = self._usable(real, twin)
            return self._apply({"real": Masked(real), "twin": Masked(usable)}, times), None
        except CannotMixError as fault_of_twin:
            reason = fault_of_twin
        try:
            return self._apply({"real": Masked(real)}, times), reason
        except CannotMixError as second:
            return None, second

    def _usable(self, real: CameraReading, twin: CameraReading | None) -> CameraReading:
        if twin is None:
            raise CannotMixError("no_twin", "no picture of the twin's camera")
        if (fault := _fault_of(twin)) is not None:
            raise CannotMixError("bad_twin", fault)
        skew_s, limit_s = abs(real.t_s - twin.t_s), self.combination.max_skew_s
        if skew_s > limit_s + _STAMP_S:
            raise CannotMixError(
                "stale",
                f"exposures {skew_s * 1000:.0f} ms apart, more than {limit_s * 1000:.0f} ms",
            )
        return twin

    def _apply(self, sides: dict[Side, Masked], times: list[StageTime]) -> CameraReading:
        """Run the steps on the sides that are there, then the merge."""
        for stage in self._stages:
            started_s = self._now()
            for side in stage.sides:
                if side in sides:
                    other: Side = "twin" if side == "real" else "real"
                    sides[side] = stage.operators[side](sides[side], sides.get(other))
            self._note(times, stage.name, started_s)
        started_s = self._now()
        merged = self._merge(sides)
        self._note(times, self.combination.merge.kind.name, started_s)
        return merged

    def _now(self) -> float:
        return self._stopwatch() if self._stopwatch is not None else 0.0

    def _note(self, times: list[StageTime], name: str, started_s: float) -> None:
        if self._stopwatch is not None:
            times.append(StageTime(name, self._stopwatch() - started_s))


def perceived(reading: CameraReading, real: CameraReading, now_s: float) -> CameraReading:
    """Return the reading as the autonomy gets it: the real's time, and nothing but the picture.

    Depth, ids and the pose that was rendered from are the simulator's knowledge of the scene.
    """
    return replace(
        reading,
        t_s=real.t_s,
        arrived_s=now_s,
        seq=real.seq,
        source="mixed",
        depth_m=None,
        object_ids=None,
        camera_pose=None,
        rendered=real.rendered,
    )


def _fault_of(reading: CameraReading) -> str | None:
    """Return what is wrong with a picture in itself; None when nothing is."""
    image, intrinsics = reading.image_bgr, reading.intrinsics
    expected = (intrinsics.height_px, intrinsics.width_px, 3)
    if image.dtype != np.uint8 or image.shape != expected:
        return (
            f"picture of {reading.source} is {image.dtype} {image.shape},"
            f" its intrinsics say uint8 {expected}"
        )
    if not math.isfinite(reading.t_s):
        return f"picture of {reading.source} has no time ({reading.t_s})"
    return None


def _provenance(
    real: CameraReading | None,
    twin: CameraReading | None,
    now_s: float,
    fault: CannotMixError | None,
) -> Provenance:
    real_t_s = real.t_s if real is not None else None
    twin_t_s = twin.t_s if twin is not None else None
    both = real_t_s is not None and twin_t_s is not None
    return Provenance(
        real_seq=real.seq if real is not None else None,
        real_t_s=real_t_s,
        twin_seq=twin.seq if twin is not None else None,
        twin_t_s=twin_t_s,
        skew_ms=abs(cast("float", real_t_s) - cast("float", twin_t_s)) * 1000.0 if both else None,
        latency_ms=(now_s - real_t_s) * 1000.0 if real_t_s is not None else None,
        dropped=fault.reason if fault is not None else None,
        detail=str(fault) if fault is not None else "",
    )
