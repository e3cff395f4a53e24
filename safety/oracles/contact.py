"""Contact with, and clearance to, what stands in the judged world."""

from collections.abc import Iterable

from pydantic import Field

from safety.oracles.base import (
    NO_FLAGS,
    Flags,
    Oracle,
    OracleContext,
    OracleError,
    Parameters,
    Probe,
    Separation,
    Stages,
    oracle,
)
from safety.results import OracleResult
from safety.samples import PoseSample, StageSample

_CLEAR_AGAIN_M = 0.02
"""A contact is over when the clearance exceeds this: noise of a pose must not count twice."""


class ContactParameters(Parameters):
    """exclude: objects not judged. ground: objects or "object.part" one takes off from."""

    exclude: tuple[str, ...] = ()
    ground: tuple[str, ...] = ()


class ClearanceParameters(ContactParameters):
    """min_m: the clearance to be kept, in metres."""

    min_m: float = Field(gt=0)


def part_name(separation: Separation) -> str:
    """Return what people call the part: "gate.left", or the object where it has no parts."""
    if not separation.part:
        return separation.object
    return f"{separation.object}.{separation.part}"


class Clearance(Oracle):
    """The smallest clearance from the takeoff command to the end of the landing.

    While the vehicle takes off (until at_height) and lands (from land on), the ground does not
    count: every part named "floor", and what `ground` names. In between the ground is an obstacle
    like any other. Clearance is clamped at 0, and 0 is contact.
    """

    def __init__(
        self,
        *,
        name: str,
        vehicle: str,
        required: bool,
        context: OracleContext,
        min_m: float = 0.0,
        exclude: Iterable[str] = (),
        ground: Iterable[str] = (),
    ) -> None:
        super().__init__(name=name, vehicle=vehicle, required=required)
        if context.probe is None:
            raise OracleError(f"oracle {name!r} needs the world of {vehicle!r}")
        self._probe: Probe = context.probe
        self._events = context.events
        self._min_m = min_m
        self._exclude = frozenset(exclude)
        self._ground = frozenset(ground)
        self._stages = Stages()
        self._last: PoseSample | None = None
        self._seen = False
        self._worst: Separation | None = None
        self._near: set[str] = set()

    def on_stage(self, sample: StageSample) -> Flags:
        """Take a stage: opens, narrows and closes the window."""
        self._stages.reach(sample)
        return NO_FLAGS

    def on_pose(self, sample: PoseSample) -> Flags:
        """Sweep from the last pose to this one."""
        last, self._last = self._last or sample, sample
        if not self._stages.flying:
            return NO_FLAGS
        self._seen = True
        swept = self._probe.sweep(last.pose, last.t_s, sample.pose, sample.t_s, self._events)
        return self._judge([s for s in swept if not self._ignored(s)])

    def result(self, t_s: float) -> OracleResult:
        """Return the smallest clearance as the actual value."""
        del t_s
        if not self._seen:
            return self.verdict(passed=False, limit=self._min_m, unit="m", detail="no pose seen")
        worst = self._worst
        if worst is None:
            return self.verdict(passed=True, limit=self._min_m, unit="m", detail="nothing near")
        actual_m = max(0.0, worst.clearance_m)
        word = "touched" if actual_m == 0.0 else "closest to"
        return self.verdict(
            passed=self._kept(worst),
            actual=actual_m,
            limit=self._min_m,
            unit="m",
            margin=actual_m - self._min_m,
            at_s=worst.at_s,
            detail=f"{word} {part_name(worst)}",
        )

    def _kept(self, separation: Separation) -> bool:
        return separation.clearance_m > 0.0 and separation.clearance_m >= self._min_m

    def _ignored(self, separation: Separation) -> bool:
        if separation.object in self._exclude or part_name(separation) in self._exclude:
            return True
        return self._stages.near_ground and self._is_ground(separation)

    def _is_ground(self, separation: Separation) -> bool:
        names = (separation.object, part_name(separation))
        return separation.part == "floor" or not self._ground.isdisjoint(names)

    def _judge(self, separations: list[Separation]) -> Flags:
        nearest: dict[str, Separation] = {}
        for separation in separations:
            if self._worst is None or separation.clearance_m < self._worst.clearance_m:
                self._worst = separation
            best = nearest.get(separation.object)
            if best is None or separation.clearance_m < best.clearance_m:
                nearest[separation.object] = separation
        flags: list[Flags] = [self._episode(s) for s in nearest.values()]
        self._near &= nearest.keys()
        return tuple(flag for group in flags for flag in group)

    def _episode(self, separation: Separation) -> Flags:
        if self._kept(separation):
            if separation.clearance_m > self._min_m + _CLEAR_AGAIN_M:
                self._near.discard(separation.object)
            return NO_FLAGS
        if separation.object in self._near:
            return NO_FLAGS
        self._near.add(separation.object)
        return self.flag(separation.at_s, self._text(separation))

    def _text(self, separation: Separation) -> str:
        part = part_name(separation)
        if separation.clearance_m <= 0.0:
            return f"{self.vehicle} touched {part}"
        return f"{self.vehicle} came within {separation.clearance_m:.3f} m of {part}"


@oracle("collision", "touches nothing of the judged world", ContactParameters)
def collision(
    name: str, required: bool, parameters: ContactParameters, context: OracleContext
) -> Oracle:
    """Return the oracle that fails on any contact."""
    return Clearance(
        name=name,
        vehicle=context.vehicle,
        required=required,
        context=context,
        exclude=parameters.exclude,
        ground=parameters.ground,
    )


@oracle("clearance", "keeps at least min_m from everything", ClearanceParameters)
def clearance(
    name: str, required: bool, parameters: ClearanceParameters, context: OracleContext
) -> Oracle:
    """Return the oracle that fails when a clearance is not kept."""
    return Clearance(
        name=name,
        vehicle=context.vehicle,
        required=required,
        context=context,
        min_m=parameters.min_m,
        exclude=parameters.exclude,
        ground=parameters.ground,
    )
