"""The distance to one object, moving or not, between limits."""

from collections.abc import Mapping
from typing import Annotated

from pydantic import Field

from wil_campaign.foundation.files.documents import closest_word
from wil_campaign.safety.model.samples import PoseSample
from wil_campaign.safety.oracles.late_tracks import LateTracks
from wil_campaign.safety.oracles.limit_oracle import (
    BandParameters,
    LimitOracle,
    band_limits,
    shown_limit,
    value_beside_limit,
)
from wil_campaign.safety.oracles.oracle import (
    NO_FLAGS,
    Flags,
    Oracle,
    OracleContext,
    OracleError,
    OracleTerms,
    WorldProbe,
    oracle,
)
from wil_campaign.safety.oracles.oracle_terms import IN_THE_AIR


class DistanceParameters(BandParameters):
    """object: its name; min_m, max_m: limits of the distance from the body to its nearest point."""

    object: Annotated[str, Field(description="the name of the object in the world")]
    min_m: Annotated[float | None, Field(ge=0, description="never nearer than this")] = None
    max_m: Annotated[float | None, Field(gt=0, description="never farther than this")] = None


class DistanceOracle(LimitOracle):
    """The oracle of the distance to an object; between two poses the nearest point counts."""

    def __init__(
        self,
        terms: OracleTerms,
        *,
        thing: str,
        probe: WorldProbe,
        events: Mapping[str, float],
        min_m: float | None,
        max_m: float | None,
    ) -> None:
        super().__init__(terms, unit="m", limit=shown_limit(min_m, max_m))
        self._thing = thing
        self._probe = probe
        self._events = events
        self._min_m = min_m
        self._max_m = max_m
        self._last: PoseSample | None = None
        self._late = LateTracks(events)

    def on_pose(self, sample: PoseSample) -> Flags:
        """Judge a pose; each time the distance leaves its limits is a flag."""
        last, self._last = self._last or sample, sample
        flags = NO_FLAGS
        for name, first, then in self._late.due():
            if name == self._thing:
                flags += self._judge(first, then)
        if not self.stages.covers(sample.t_s):
            return flags
        if self._thing in self._late.add(last, sample):
            return flags
        return flags + self._judge(last, sample)

    def _judge(self, last: PoseSample, sample: PoseSample) -> Flags:
        judged: list[tuple[float, float, float]] = []
        if self._min_m is not None:
            at_s, near_m = self._nearest(last, sample)
            judged.append((near_m - self._min_m, near_m, at_s))
        if self._max_m is not None:
            at_s, far_m = self._nearest(sample, sample)
            judged.append((self._max_m - far_m, far_m, at_s))
        margin_m, distance_m, at_s = min(judged)
        return self.judge_margin(
            at_s,
            distance_m,
            margin_m,
            lambda: f"{self.vehicle} was {self._text(distance_m)}",
        )

    def _text(self, distance_m: float) -> str:
        figure, _, limit = value_beside_limit(distance_m, self._min_m, self._max_m, "m").partition(
            "; "
        )
        return f"{figure} from {self._thing}; {limit}"

    def _nearest(self, first: PoseSample, last: PoseSample) -> tuple[float, float]:
        """Return time and value of the least distance between two poses."""
        swept = self._probe.sweep(first.pose, first.t_s, last.pose, last.t_s, self._events)
        nearest = min(swept, key=lambda each: each.clearance_m)
        return nearest.at_s, max(0.0, nearest.clearance_m)


@oracle(
    "distance",
    "keeps its distance to an object between min_m and max_m",
    DistanceParameters,
    window=IN_THE_AIR,
    objects=lambda given, _: (given.object,),
    limits=lambda part: band_limits(part, f"distance to {part.get('object')}", in_the_air=False),
)
def distance(terms: OracleTerms, parameters: DistanceParameters, context: OracleContext) -> Oracle:
    """Return the oracle of a distance. Raises OracleError when the object is not there."""
    return DistanceOracle(
        terms,
        thing=parameters.object,
        probe=probe_of_object(terms, parameters.object, context),
        events=context.events,
        min_m=parameters.min_m,
        max_m=parameters.max_m,
    )


def probe_of_object(terms: OracleTerms, thing: str, context: OracleContext) -> WorldProbe:
    """Return a probe of one object for an oracle. Raises OracleError when it is not there."""
    if thing not in context.things or context.probe_of is None:
        known = ", ".join(context.things) or "none"
        raise OracleError(
            f"oracle {terms.name!r}: the judged world has no object {thing!r} in mode "
            f"{context.mode} (there are: {known})",
            key="object",
            suggestion=closest_word(thing, context.things),
        )
    return context.probe_of(thing)
