"""The oracle of the distance between real and twin."""

from typing import Annotated

from pydantic import Field

from wil_campaign.safety.model.oracle_results import OracleResult
from wil_campaign.safety.model.samples import PoseSample
from wil_campaign.safety.model.signals import extrapolated_ned_m
from wil_campaign.safety.oracles.oracle import (
    NO_FLAGS,
    Flags,
    Oracle,
    OracleContext,
    OracleTerms,
    StageWindow,
    Windowed,
    oracle,
)
from wil_campaign.worlds.figures import distinct_value_text
from wil_campaign.worlds.frames import norm, subtract


class TwinDivergenceParameters(Windowed):
    """max_m: the largest allowed distance, metres; None only measures it."""

    required: Annotated[
        bool, Field(description="whether its FAIL fails the run; by default it is reported")
    ] = False
    max_m: Annotated[
        float | None, Field(gt=0, description="largest distance; without it, it is only measured")
    ] = None


class TwinDivergenceOracle(Oracle):
    """The oracle of the pair's distance, from takeoff to landing command by default.

    The two are sampled at different times: the older pose is extrapolated by its velocity.
    """

    def __init__(self, terms: OracleTerms, *, max_m: float | None = None) -> None:
        super().__init__(terms)
        self._max_m = max_m
        self._last: dict[str, PoseSample] = {}
        self._worst: tuple[float, float] | None = None
        self._flagged = False

    @property
    def watches(self) -> tuple[str, ...]:
        """Return both vehicles of the pair."""
        return ("real", "twin")

    def on_pose(self, sample: PoseSample) -> Flags:
        """Judge a pose of either vehicle of the pair."""
        self._last[sample.vehicle] = sample
        other = self._last.get("twin" if sample.vehicle == "real" else "real")
        if other is None or not self.stages.covers(sample.t_s):
            return NO_FLAGS
        distance_m = norm(
            subtract(sample.pose.position_ned_m, extrapolated_ned_m(other, sample.t_s))
        )
        if self._worst is None or distance_m > self._worst[0]:
            self._worst = (distance_m, sample.t_s)
        if self._flagged or self._max_m is None or distance_m <= self._max_m:
            return NO_FLAGS
        self._flagged = True
        apart = distinct_value_text(distance_m, self._max_m)
        text = f"real and twin are {apart} m apart; the limit is {self._max_m:g} m"
        return self.flag(sample.t_s, text)

    def result(self, t_s: float) -> OracleResult:
        """Return the largest distance of the pair."""
        del t_s
        if self._worst is None:
            return self.invalid("there are no poses of both vehicles at one time")
        distance_m, at_s = self._worst
        margin_m = None if self._max_m is None else self._max_m - distance_m
        return self.verdict(
            passed=margin_m is None or margin_m >= 0.0,
            actual=distance_m,
            limit=self._max_m,
            unit="m",
            margin=margin_m,
            at_s=at_s,
        )


@oracle(
    "twin_divergence",
    "real and twin stay within max_m of each other",
    TwinDivergenceParameters,
    pair_only=True,
    window=StageWindow("takeoff", "land"),
)
def twin_divergence(
    terms: OracleTerms, parameters: TwinDivergenceParameters, context: OracleContext
) -> Oracle:
    """Return the oracle of the distance between the pair's vehicles."""
    del context
    return TwinDivergenceOracle(terms, max_m=parameters.max_m)
