"""How fast a vehicle comes down on the ground when it lands."""

from typing import Annotated

from pydantic import Field

from wil_campaign.safety.model.oracle_results import OracleResult
from wil_campaign.safety.model.samples import PoseSample, StateSample
from wil_campaign.safety.oracles.oracle import (
    NO_FLAGS,
    Flags,
    Oracle,
    OracleContext,
    OracleParameters,
    OracleTerms,
    StageWindow,
    oracle,
)

LANDING = StageWindow("land", "landed")
_NEAR_M = 0.15
"""How far above its place of rest a vehicle counts as touching down: what an estimate may sink
while the vehicle stands, and less than autopilots brake on."""
_OVER_S = 0.1 - 1e-6
"""A sink rate is a mean over this time at least: 1 mm of noise is 1.4 cm/s then. The difference of
two times is rounded: 11.36 - 11.26 is less than 0.1."""
_SPARSE_S = 0.15
"""The mean over a longer step to the ground says little: it stood there for a part of it."""


class TouchdownParameters(OracleParameters):
    """max_m_s: the fastest that a vehicle may sink as it meets the ground."""

    max_m_s: Annotated[
        float | None,
        Field(gt=0, description="the fastest; by default of its profile, else it is only measured"),
    ] = None


_REPORTED_S = 2.0
"""An older report that a vehicle stands does not say that it stood as its landing began."""


class TouchdownOracle(Oracle):
    """The oracle of the sink rate as the vehicle meets the ground, wherever that is.

    The ground is where the vehicle stands at the end: a table and an estimate that has drifted
    since the takeoff change nothing. The sink rate is measured by positions alone. One that came
    down before it was to land, as of its own autonomy, has no landing: `collision` judges that.
    """

    def __init__(self, terms: OracleTerms, *, max_m_s: float | None) -> None:
        super().__init__(terms)
        self._max_m_s = max_m_s
        self._has_seen = False
        self._has_flown = False
        self._stood_s: float | None = None
        self._downs: list[tuple[float, float]] = []

    def on_pose(self, sample: PoseSample) -> Flags:
        """Take a pose: those of the landing count."""
        self._has_seen = True
        if self.stages.covers(sample.t_s):
            self._downs.append((sample.t_s, sample.pose.position_ned_m[2]))
        return NO_FLAGS

    def on_state(self, sample: StateSample) -> Flags:
        """Take the vehicle's own report of whether it stands as its landing begins."""
        if self.stages.begin_s is None and sample.landed is not None:
            self._has_flown = self._has_flown or not sample.landed
            self._stood_s = sample.t_s if sample.landed and self._has_flown else None
        return NO_FLAGS

    def result(self, t_s: float) -> OracleResult:
        """Return the fastest sink rate near the ground as the actual value."""
        del t_s
        has_landed = self.stages.at("landed") is not None
        if self._has_seen and not has_landed:
            return self.verdict(passed=True, limit=self._max_m_s, unit="m/s", detail="not landed")
        fastest = max(self._sink_rates(), default=None)
        begin_s, stood_s = self.stages.begin_s, self._stood_s
        stood = begin_s is not None and stood_s is not None and begin_s - stood_s < _REPORTED_S
        if fastest is None and stood and self._has_seen:
            detail = "it stood on the ground before it was to land"
            return self.verdict(passed=True, limit=self._max_m_s, unit="m/s", detail=detail)
        if fastest is None:
            return self.invalid("no pose seen while it landed" if has_landed else "no pose seen")
        sink_m_s, at_s = fastest
        margin_m_s = None if self._max_m_s is None else self._max_m_s - sink_m_s
        return self.verdict(
            passed=margin_m_s is None or margin_m_s >= 0.0,
            actual=sink_m_s,
            limit=self._max_m_s,
            unit="m/s",
            margin=margin_m_s,
            at_s=at_s,
        )

    def _sink_rates(self) -> list[tuple[float, float]]:
        """Return the mean sink rates near the ground, each with its time.

        Where poses are sparse, the last one above counts: it is taken to sink on as it did.
        """
        near_m = self._downs[-1][1] - _NEAR_M if self._downs else 0.0
        rates: list[tuple[float, float]] = []
        first = 0
        for index, (t_s, down_m) in enumerate(self._downs):
            while first + 1 < index and t_s - self._downs[first + 1][0] >= _OVER_S:
                first += 1
            from_s, from_m = self._downs[first]
            next_s, next_m = self._downs[min(index + 1, len(self._downs) - 1)]
            is_near = down_m >= near_m or (next_m >= near_m and next_s - t_s > _SPARSE_S)
            if is_near and t_s - from_s >= _OVER_S:
                rates.append(((down_m - from_m) / (t_s - from_s), t_s))
        return rates


@oracle(
    "touchdown",
    "sinks no faster than max_m_s as it lands",
    TouchdownParameters,
    window=LANDING,
    at_the_end=True,
)
def touchdown(
    terms: OracleTerms, parameters: TouchdownParameters, context: OracleContext
) -> Oracle:
    """Return the oracle of the sink rate at touchdown."""
    limit_m_s = parameters.max_m_s
    return TouchdownOracle(terms, max_m_s=context.touchdown_m_s if limit_m_s is None else limit_m_s)
