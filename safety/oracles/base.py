"""The oracle interface, what an oracle is told of its run, and the registry.

Oracles are pure and online: samples in the order of their times in, flags out, and at the end one
result. They read no clock, so that judging a recording gives what judging the flight gave.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol

from pydantic import BaseModel, ConfigDict

from safety.geofence import Fence
from safety.results import Flag, Limit, OracleResult
from safety.samples import HeardSample, PoseSample, Stage, StageSample, StateSample
from worlds.frames import Pose, Vec3
from worlds.parts import Crossing

RunMode = Literal["sim", "wil", "real"]
Flags = tuple[Flag, ...]
NO_FLAGS: Flags = ()


class OracleError(Exception):
    """An oracle that cannot be built for this run; says which and why."""


class Parameters(BaseModel):
    """What a campaign may say of every oracle.

    vehicle: whom it judges; None means the subject of the run (real in wil and real, twin in sim).
    required: whether its FAIL fails the run, or is only reported.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    vehicle: Literal["real", "twin"] | None = None
    required: bool = True


class Separation(Protocol):
    """The least clearance to one object on a stretch; `worlds.clearance.Clearance`.

    The floor of a room is told apart from the rest of it.
    """

    @property
    def object_name(self) -> str:
        """Return the object's name in the world file."""

    @property
    def part_name(self) -> str:
        """Return which part of it was the nearest ("left"); empty when it has but one."""

    @property
    def clearance_m(self) -> float:
        """Return the smallest distance between the vehicle's body and it; <= 0 is contact."""

    @property
    def at_s(self) -> float:
        """Return when it was that small, on the run clock."""

    @property
    def is_floor(self) -> bool:
        """Return whether it is a floor that vehicles stand on."""


class Probe(Protocol):
    """Measures a body's clearance to the judged world; `worlds.clearance.ClearanceProbe`."""

    def sweep(
        self,
        pose_0: Pose,
        t_0_s: float,
        pose_1: Pose,
        t_1_s: float,
        events: Mapping[str, float],
        /,
        *,
        below_m: Mapping[tuple[str, bool], float] | None = None,
    ) -> tuple[Separation, ...]:
        """Return the least clearance to each near object on the way between two poses.

        below_m: by name and whether it is a floor; only what is less is reported.
        """


class Gate(Protocol):
    """An opening that the vehicle may have to fly through; `safety.oracles.gates.SceneGate`."""

    @property
    def limit_m(self) -> float:
        """Return half of the inner size: the offset at which the centre meets the frame."""

    def depth_m(self, point_ned_m: Vec3, t_s: float, events: Mapping[str, float]) -> float:
        """Return how far behind the opening's plane a point is, along its forward axis."""

    def crossing(
        self, p_0: Vec3, t_0: float, p_1: Vec3, t_1: float, events: Mapping[str, float]
    ) -> Crossing | None:
        """Return where the way from one point to the next meets the opening's plane."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OracleContext:
    """What an oracle is told of the run and of the one vehicle it judges.

    vehicle: whom this oracle judges. probe: clearance to the world in which that vehicle is
    judged (Wv in sim and wil, W in real). gates: all openings of that world by name; route: those
    of the goal, in order. target_ned_m: a position goal. fence: that vehicle's own. events: times
    of the world's events, a mapping that the run fills in as they happen.
    """

    mode: RunMode
    subject: str
    vehicle: str
    start: Pose = field(default_factory=lambda: Pose((0.0, 0.0, 0.0)))
    probe: Probe | None = None
    gates: Mapping[str, Gate] = field(default_factory=dict)
    route: tuple[str, ...] = ()
    target_ned_m: Vec3 | None = None
    fence: Fence | None = None
    events: Mapping[str, float] = field(default_factory=dict)


class Oracle(ABC):
    """One judge of one vehicle (`watches`: whose samples it wants; most watch that one alone)."""

    def __init__(self, *, name: str, vehicle: str, required: bool) -> None:
        self.name = name
        self.vehicle = vehicle
        self.required = required

    @property
    def watches(self) -> tuple[str, ...]:
        """Return the vehicles whose samples are to be fed."""
        return (self.vehicle,)

    def on_pose(self, sample: PoseSample) -> Flags:
        """Take a pose."""
        del sample
        return NO_FLAGS

    def on_state(self, sample: StateSample) -> Flags:
        """Take a vehicle's state."""
        del sample
        return NO_FLAGS

    def on_heard(self, sample: HeardSample) -> Flags:
        """Take that a vehicle was heard."""
        del sample
        return NO_FLAGS

    def on_stage(self, sample: StageSample) -> Flags:
        """Take that the run reached a stage."""
        del sample
        return NO_FLAGS

    def on_tick(self, t_s: float) -> Flags:
        """Take that time has passed, for oracles that judge silence."""
        del t_s
        return NO_FLAGS

    @abstractmethod
    def result(self, t_s: float) -> OracleResult:
        """Return the judgement as it stands at run time `t_s`."""

    def flag(self, t_s: float, text: str, *, decisive: bool = True) -> Flags:
        """Return one flag of this oracle."""
        return (Flag(t_s, self.name, self.vehicle, text, decisive),)

    def verdict(
        self,
        *,
        passed: bool,
        actual: float | None = None,
        limit: Limit = None,
        unit: str = "",
        margin: float | None = None,
        at_s: float | None = None,
        detail: str = "",
    ) -> OracleResult:
        """Return this oracle's result; a number that is not finite turns it into a FAIL."""
        numbers = [x for x in (actual, margin, at_s) if x is not None]
        if not all(map(math.isfinite, numbers)):
            bad = f"saw a value that is not finite ({actual})"
            return self.verdict(passed=False, limit=limit, unit=unit, detail=bad)
        return OracleResult(
            name=self.name,
            vehicle=self.vehicle,
            required=self.required,
            verdict="PASS" if passed else "FAIL",
            actual=actual,
            limit=limit,
            unit=unit,
            margin=margin,
            at_s=at_s,
            detail=detail,
        )


class Stages:
    """When each stage was reached, and the windows that oracles speak of."""

    def __init__(self) -> None:
        self._at_s: dict[Stage, float] = {}

    def reach(self, sample: StageSample) -> None:
        """Note a stage; only its first time counts."""
        self._at_s.setdefault(sample.stage, sample.t_s)

    def at(self, stage: Stage) -> float | None:
        """Return when a stage was reached, or None."""
        return self._at_s.get(stage)

    def within(self, first: Stage, *last: Stage) -> bool:
        """Return whether `first` has been reached and none of `last`."""
        return first in self._at_s and not any(stage in self._at_s for stage in last)

    @property
    def flying(self) -> bool:
        """Return whether now is between the takeoff command and the end of the landing."""
        return self.within("takeoff", "landed", "end")

    @property
    def near_ground(self) -> bool:
        """Return whether the vehicle is meant to be on or near the ground now."""
        return "at_height" not in self._at_s or "land" in self._at_s


Factory = Callable[[str, bool, Any, OracleContext], Oracle]
"""Builds an oracle from the name for results, whether required, its parameters, and the context."""


@dataclass(frozen=True, slots=True)
class OracleSpec:
    """A kind of oracle that campaigns may name.

    pair_only: it compares two vehicles and is left out where only one flies.
    """

    name: str
    summary: str
    parameters: type[Parameters]
    factory: Factory
    pair_only: bool = False


registry: dict[str, OracleSpec] = {}


def oracle(
    name: str, summary: str, parameters: type[Parameters], *, pair_only: bool = False
) -> Callable[[Factory], Factory]:
    """Register a factory under a name. Raises ValueError when the name is taken."""

    def register(factory: Factory) -> Factory:
        if name in registry:
            raise ValueError(f"oracle {name!r} is registered twice")
        registry[name] = OracleSpec(name, summary, parameters, factory, pair_only)
        return factory

    return register
