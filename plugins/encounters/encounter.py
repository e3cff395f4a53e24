"""Whether a vehicle and an object of the world met: that the two were near, and for how long."""

from collections.abc import Mapping
from typing import Annotated

from pydantic import Field

from wil_campaign.plugins.encounters.distance import probe_of_object
from wil_campaign.safety.model.oracle_results import OracleResult
from wil_campaign.safety.model.samples import PoseSample
from wil_campaign.safety.oracles.late_tracks import LateTracks
from wil_campaign.safety.oracles.oracle import (
    NO_FLAGS,
    Flags,
    Oracle,
    OracleContext,
    OracleTerms,
    Windowed,
    WorldProbe,
    oracle,
)
from wil_campaign.safety.oracles.oracle_terms import ON_GOAL
from wil_campaign.worlds.figures import distinct_value_text


class EncounterParameters(Windowed):
    """object: its name; within_m: distance from the body to its nearest point; for_s: in all."""

    object: Annotated[str, Field(description="the name of the object in the world")]
    within_m: Annotated[float, Field(gt=0, description="how near the two count as near")]
    for_s: Annotated[
        float, Field(ge=0, description="how long the two are near at least, altogether")
    ] = 0.0


class EncounterOracle(Oracle):
    """The oracle of an encounter: the time for which vehicle and object were near each other.

    actual: that time; limit: the least that is asked for. The time between two poses counts where
    the two were near at both.
    """

    def __init__(
        self,
        terms: OracleTerms,
        *,
        thing: str,
        probe: WorldProbe,
        events: Mapping[str, float],
        within_m: float,
        for_s: float,
    ) -> None:
        super().__init__(terms)
        self._thing = thing
        self._probe = probe
        self._events = events
        self._within_m = within_m
        self._for_s = for_s
        self._near_since_s: float | None = None
        self._near_now_s = self._near_before_s = 0.0
        self._nearest_m: float | None = None
        self._late = LateTracks(events)

    def on_pose(self, sample: PoseSample) -> Flags:
        """Take a pose: whether the object is near at it."""
        for name, _, then in self._late.due():
            if name == self._thing:
                self._take(then)
        if not self.stages.covers(sample.t_s):
            self._part()
        elif self._thing not in self._late.add(sample, sample):
            self._take(sample)
        return NO_FLAGS

    def _take(self, sample: PoseSample) -> None:
        """Take a pose at whose time it is known where the object is."""
        at = (sample.pose, sample.t_s)
        swept = self._probe.sweep(*at, *at, self._events)
        distance_m = max(0.0, min(separation.clearance_m for separation in swept))
        if self._nearest_m is None or distance_m < self._nearest_m:
            self._nearest_m = distance_m
        if distance_m > self._within_m:
            self._part()
        elif self._near_since_s is None:
            self._near_since_s = sample.t_s
        else:
            self._near_now_s = sample.t_s - self._near_since_s

    def _part(self) -> None:
        """End a time for which the two were near."""
        self._near_before_s += self._near_now_s
        self._near_since_s, self._near_now_s = None, 0.0

    def result(self, t_s: float) -> OracleResult:
        """Return for how long the two were near."""
        del t_s
        if self._nearest_m is None:
            return self.invalid("no pose seen")
        met_s = self._near_before_s + self._near_now_s
        margin_s = met_s - self._for_s
        is_met = self._nearest_m <= self._within_m
        near_s = distinct_value_text(met_s, self._for_s)
        nearest_m = distinct_value_text(self._nearest_m, self._within_m)
        asked = f"{self._for_s:g} s within {self._within_m:g} m are asked for"
        detail = f"{self._thing} was near for {near_s} s; {asked}"
        if not is_met:
            detail = f"{self._thing} was never nearer than {nearest_m} m; {asked}"
        return self.verdict(
            passed=is_met and margin_s >= 0.0,
            actual=met_s,
            limit=self._for_s,
            unit="s",
            # Where the two never met, no time is too little by nothing.
            margin=margin_s if is_met or margin_s < 0.0 else None,
            detail=detail,
        )


@oracle(
    "encounter",
    "is within within_m of an object for for_s at least",
    EncounterParameters,
    window=ON_GOAL,
    at_the_end=True,
    objects=lambda given, _: (given.object,),
)
def encounter(
    terms: OracleTerms, parameters: EncounterParameters, context: OracleContext
) -> Oracle:
    """Return the oracle of an encounter. Raises OracleError when the object is not there."""
    return EncounterOracle(
        terms,
        thing=parameters.object,
        probe=probe_of_object(terms, parameters.object, context),
        events=context.events,
        within_m=parameters.within_m,
        for_s=parameters.for_s,
    )
