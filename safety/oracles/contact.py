"""Contact with, and clearance to, the objects of the judged world."""

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Annotated

from pydantic import Field

from wil_campaign.safety.model.oracle_results import OracleResult
from wil_campaign.safety.model.samples import PoseSample, StateSample
from wil_campaign.safety.oracles.late_tracks import LateTracks
from wil_campaign.safety.oracles.limit_oracle import band_limits
from wil_campaign.safety.oracles.oracle import (
    NO_FLAGS,
    Flags,
    ObjectSeparation,
    Oracle,
    OracleContext,
    OracleError,
    OracleTerms,
    Windowed,
    WorldProbe,
    oracle,
)
from wil_campaign.worlds.figures import distinct_value_text

CLEAR_AGAIN_M = 0.02
"""A contact is over when the clearance exceeds this, so that noise does not count it twice."""
REACH_M = 2.0
"""How far the oracles look at least; nothing beyond it is near."""


class ContactParameters(Windowed):
    """exclude: objects whose contact is not judged. ground: objects of takeoff or landing."""

    exclude: Annotated[
        tuple[str, ...],
        Field(description="objects that may be touched; contact with them is not judged"),
    ] = ()
    ground: Annotated[
        tuple[str, ...], Field(description="objects that the vehicle takes off from or lands on")
    ] = ()


class ClearanceParameters(ContactParameters):
    """min_m: the least clearance to objects, metres; contact is 0."""

    min_m: float = Field(gt=0, description="the clearance to be kept")


def touched_part_name(separation: ObjectSeparation) -> str:
    """Return the touched part's name: "gate.left", or the object where it has no parts."""
    return f"{separation.object_name}.{separation.part_name}".rstrip(".")


class ContactLimits(Mapping[tuple[str, bool], float]):
    """The clearance or contact limit of each object, by name and whether it is a floor.

    only: the one object that is judged; None: all that are not ignored.
    """

    def __init__(self) -> None:
        self.below_m = math.inf
        self.ignored: frozenset[str] = frozenset()
        self.only: str | None = None
        self.floors_ignored = True

    def __getitem__(self, key: tuple[str, bool]) -> float:
        name, is_floor = key
        ignored = name in self.ignored or (is_floor and self.floors_ignored)
        ignored = ignored or self.only not in {None, name}
        return 0.0 if ignored else self.below_m

    def __iter__(self) -> Iterator[tuple[str, bool]]:
        return iter(())

    def __len__(self) -> int:
        return 0


class ClearanceOracle(Oracle):
    """The oracle of contact or clearance, from takeoff command to landing by default.

    While the vehicle takes off (until at_height) and lands (from land on), the ground does not
    count: floors of rooms, and the objects that `ground` names. In between the ground is an
    obstacle like any other. Clearance is clamped at 0, and 0 is contact. over_ground: whether the
    ground outside of rooms counts as well.
    """

    def __init__(
        self,
        terms: OracleTerms,
        *,
        context: OracleContext,
        min_m: float = 0.0,
        exclude: Iterable[str] = (),
        ground: Iterable[str] = (),
        over_ground: bool = False,
    ) -> None:
        super().__init__(terms)
        if context.probe is None:
            raise OracleError(f"oracle {self.name!r} needs the world of {self.vehicle!r}")
        self._probe: WorldProbe = context.probe.reaching(_reach_m(min_m))
        if over_ground and context.ground_down_m is not None:
            self._probe = self._probe.above(context.ground_down_m)
        self._events = context.events
        self._min_m = min_m
        self._exclude = frozenset(exclude)
        self._ground = frozenset(ground) | self._exclude
        self._last: PoseSample | None = None
        self._seen = False
        self._worst: ObjectSeparation | None = None
        self._below_s: float | None = None
        self._near: set[tuple[str, bool]] = set()
        self._limits = ContactLimits()
        self._late = LateTracks(context.events)

    def on_pose(self, sample: PoseSample) -> Flags:
        """Sweep from the last pose to this one for contact."""
        last, self._last = self._last or sample, sample
        flags = NO_FLAGS
        for name, first, then in self._late.due():
            flags += self._sweep(first, then, only=name)
        if not self.stages.covers(sample.t_s):
            return flags
        self._seen = True
        return flags + self._sweep(last, sample, later=self._late.add(last, sample))

    def _sweep(
        self,
        last: PoseSample,
        sample: PoseSample,
        *,
        only: str | None = None,
        later: frozenset[str] = frozenset(),
    ) -> Flags:
        """Judge the stretch between two poses.

        only: against one object alone. later: not against these, which are judged later.
        """
        near_ground = self.stages.near_ground_at(sample.t_s)
        self._limits.only = only
        self._limits.floors_ignored = near_ground
        self._limits.ignored = later | (self._ground if near_ground else self._exclude)
        # Only objects nearer than ever, or near the limit, are of interest.
        known_m = math.inf if self._worst is None else self._worst.clearance_m
        self._limits.below_m = max(known_m, self._min_m + CLEAR_AGAIN_M)
        swept = self._probe.sweep(
            last.pose, last.t_s, sample.pose, sample.t_s, self._events, below_m=self._limits
        )
        kept = {key for key in self._near if key[0] in later or only not in {None, key[0]}}
        return self._judge(swept, kept)

    def result(self, t_s: float) -> OracleResult:
        """Return the least clearance as the actual value; 0 is contact."""
        del t_s
        if not self._seen:
            return self.invalid("no pose seen")
        worst = self._worst
        if worst is None:
            return self.verdict(passed=True, limit=self._min_m, unit="m", detail="nothing near")
        actual_m = max(0.0, worst.clearance_m)
        word = "touched" if actual_m == 0.0 else "closest to"
        return self.verdict(
            passed=self._limits_kept(worst),
            actual=actual_m,
            limit=self._min_m,
            unit="m",
            margin=actual_m - self._min_m,
            at_s=worst.at_s,
            detail=f"{word} {touched_part_name(worst)}",
        )

    @property
    def worst_text(self) -> str:
        """Return the least clearance where one below a limit was followed by less."""
        worst = self._worst
        is_later = worst is not None and self._below_s is not None and worst.at_s > self._below_s
        if worst is None or not is_later or self._min_m == 0.0:
            return ""
        return f"at worst {distinct_value_text(worst.clearance_m, self._min_m, digits=3)} m"

    def _limits_kept(self, separation: ObjectSeparation) -> bool:
        return separation.clearance_m > 0.0 and separation.clearance_m >= self._min_m

    def _judge(
        self, swept: tuple[ObjectSeparation, ...], still_near: set[tuple[str, bool]]
    ) -> Flags:
        """Return flags of new contacts and clearances below the limit.

        still_near: the objects that are near and were not judged now.
        """
        flags: Flags = NO_FLAGS
        for separation in swept:
            key = (separation.object_name, separation.is_floor)
            if self._limits[key] == 0.0:
                continue
            if self._worst is None or separation.clearance_m < self._worst.clearance_m:
                self._worst = separation
            if not self._limits_kept(separation):
                if key not in self._near:
                    self._below_s = self._below_s or separation.at_s
                    flags += self.flag(separation.at_s, self._text(separation))
                still_near.add(key)
            elif key in self._near and separation.clearance_m <= self._min_m + CLEAR_AGAIN_M:
                still_near.add(key)
        self._near = still_near
        return flags

    def _text(self, separation: ObjectSeparation) -> str:
        part = touched_part_name(separation)
        if separation.clearance_m <= 0.0:
            return f"{self.vehicle} touched {part}"
        near_m = distinct_value_text(separation.clearance_m, self._min_m, digits=3)
        limit = f"the limit is {self._min_m:g} m"
        return f"{self.vehicle} came within {near_m} m of {part}; {limit}"


def exceeded_margin_m(result: OracleResult) -> float | None:
    """Return what a margin exceeds, in metres, where nothing came near; None for other results.

    Such a PASS has a limit, but neither a worst value nor a margin.
    """
    is_unknown = result.actual is None and result.margin is None and result.unit == "m"
    if result.verdict != "PASS" or not is_unknown or not isinstance(result.limit, int | float):
        return None
    return _reach_m(result.limit) - result.limit


def _reach_m(min_m: float) -> float:
    """Return how far an oracle looks that demands a clearance of min_m."""
    return max(REACH_M, min_m + CLEAR_AGAIN_M)


class CollisionOracle(ClearanceOracle):
    """The oracle of contact with things, and with the ground between at_height and land.

    The ground is touched by the judged poses, or by the vehicle's own report: an estimate may drift
    while the vehicle stands.
    """

    def __init__(
        self,
        terms: OracleTerms,
        *,
        context: OracleContext,
        exclude: Iterable[str],
        ground: Iterable[str],
    ) -> None:
        super().__init__(terms, context=context, exclude=exclude, ground=ground, over_ground=True)
        self._is_airborne = False
        self._reported_s: float | None = None

    def on_state(self, sample: StateSample) -> Flags:
        """Flag a vehicle that reports between at_height and land that it has come down."""
        if self.stages.near_ground or not self.stages.open:
            self._is_airborne = False
        elif sample.landed is False:
            self._is_airborne = True
        elif sample.landed and self._is_airborne:
            self._is_airborne = False
            self._reported_s = self._reported_s or sample.t_s
            return self.flag(sample.t_s, f"{self.vehicle} {_REPORTED}")
        return NO_FLAGS

    def result(self, t_s: float) -> OracleResult:
        """Return the least clearance as the actual value; 0 is contact."""
        swept = super().result(t_s)
        if self._reported_s is None or swept.verdict != "PASS":
            return swept
        return replace(
            swept, verdict="FAIL", actual=0.0, margin=0.0, at_s=self._reported_s, detail=_REPORTED
        )


_REPORTED = "reported that it is on the ground before it was to land"


@oracle("collision", "touches nothing of the judged world", ContactParameters)
def collision(terms: OracleTerms, parameters: ContactParameters, context: OracleContext) -> Oracle:
    """Return the oracle that fails on any contact."""
    return CollisionOracle(
        terms, context=context, exclude=parameters.exclude, ground=parameters.ground
    )


@oracle(
    "clearance",
    "keeps at least min_m from everything",
    ClearanceParameters,
    limits=lambda part: band_limits(part, "clearance_m", high=""),
)
def clearance(
    terms: OracleTerms, parameters: ClearanceParameters, context: OracleContext
) -> Oracle:
    """Return the oracle that fails when the clearance (0 is contact) falls below a limit."""
    return ClearanceOracle(
        terms,
        context=context,
        min_m=parameters.min_m,
        exclude=parameters.exclude,
        ground=parameters.ground,
    )
