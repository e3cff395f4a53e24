"""Oracles of where the vehicle may be: geofence, an area of the campaign, altitude."""

from collections.abc import Iterator, Mapping
from typing import Annotated, Self

from pydantic import Field, model_validator

from wil_campaign.foundation.files.documents import Data, KeyFaultError
from wil_campaign.safety.fence.areas import FenceError
from wil_campaign.safety.fence.fence_schema import FencePart
from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.safety.model.samples import FenceSample, PoseSample
from wil_campaign.safety.oracles.limit_oracle import (
    BandParameters,
    LimitOracle,
    band_limits,
    shown_limit,
    signed_margin,
    value_beside_limit,
)
from wil_campaign.safety.oracles.oracle import (
    NO_FLAGS,
    Flags,
    Oracle,
    OracleContext,
    OracleError,
    OracleTerms,
    SignalLimit,
    Windowed,
    oracle,
)
from wil_campaign.worlds.frames import Vec3, lerp


class AltitudeParameters(BandParameters):
    """min_m, max_m: the area's heights over the world's origin, metres, positive up."""

    min_m: Annotated[
        float | None, Field(description="lowest height over the world's origin, in the air")
    ] = None
    max_m: Annotated[float | None, Field(description="greatest height over the origin")] = None


class AreaParameters(Windowed):
    """keep: the area to stay inside, written as `geofence` is."""

    keep: Annotated[FencePart, Field(description="where it has to stay; written as `geofence` is")]

    @model_validator(mode="after")
    def _without_file(self) -> Self:
        if self.keep.file is not None:
            raise KeyFaultError(("keep", "file"), "an area cannot refer to a file; write it here")
        return self


class GeofenceOracle(LimitOracle):
    """The oracle of the fence's area; its floor holds from at_height to the landing only.

    actual: the smallest signed distance to the boundary, positive inside; limit 0. The oracle
    judges where the vehicle was; whether it could still have stopped is judged by the guard.
    Between two poses inside it flew straight, and may have been outside: in a thin exclusion.
    """

    def __init__(
        self, terms: OracleTerms, *, fence: Fence, what: str = "the fence", changes: bool = True
    ) -> None:
        super().__init__(terms, unit="m", limit=0.0)
        self._fence = fence
        self._low_fence = fence.without_floor()
        self._what = what
        self._changes = changes
        self._last: tuple[Fence, PoseSample, float] | None = None

    def on_fence(self, sample: FenceSample) -> Flags:
        """Take the vehicle's changed fence as the area to keep."""
        if self._changes:
            self._fence = sample.fence
            self._low_fence = sample.fence.without_floor()
        return NO_FLAGS

    def on_pose(self, sample: PoseSample) -> Flags:
        """Judge a pose; each time the vehicle leaves the fence's area is a flag."""
        fence = self._low_fence if self.stages.near_ground_at(sample.t_s) else self._fence
        if not self.stages.covers(sample.t_s) or fence is None:
            self._last = None
            return NO_FLAGS
        position_ned_m = sample.pose.position_ned_m
        margin_m = fence.margin_m(position_ned_m)
        flags = self._judge_way(fence, sample, margin_m)
        self._last = (fence, sample, margin_m)
        return flags + self._judge_place(fence, sample.t_s, position_ned_m, margin_m)

    def _judge_way(self, fence: Fence, sample: PoseSample, margin_m: float) -> Flags:
        """Judge the way from the last pose, where the same fence applied."""
        if self._last is None or self._last[0] is not fence:
            return NO_FLAGS
        _, last, last_margin_m = self._last
        start, end = last.pose.position_ned_m, sample.pose.position_ned_m
        outside = fence.outside_between(start, end, (last_margin_m, margin_m))
        if outside is None:
            return NO_FLAGS
        share, worst_m = outside
        at_s = last.t_s + (sample.t_s - last.t_s) * share
        return self._judge_place(fence, at_s, lerp(start, end, share), worst_m)

    def _judge_place(
        self, fence: Fence, t_s: float, position_ned_m: Vec3, margin_m: float
    ) -> Flags:
        return self.judge_margin(
            t_s,
            margin_m,
            margin_m,
            lambda: f"{self.vehicle} left {self._what} by its {fence.boundary(position_ned_m)}",
        )

    def worst_figure(self, figure: str) -> str:
        """Return how far outside a place was. figure: its margin as text, negative."""
        return f"{figure.removeprefix('-')} m outside"


class AltitudeOracle(LimitOracle):
    """The oracle of the altitude; the lower limit from at_height to the landing only."""

    def __init__(
        self, terms: OracleTerms, *, min_m: float | None = None, max_m: float | None = None
    ) -> None:
        super().__init__(terms, unit="m", limit=shown_limit(min_m, max_m))
        self._min_m = min_m
        self._max_m = max_m

    def on_pose(self, sample: PoseSample) -> Flags:
        """Judge a pose; each time the altitude leaves its limits is a flag."""
        if not self.stages.covers(sample.t_s):
            return NO_FLAGS
        low_m = None if self.stages.near_ground_at(sample.t_s) else self._min_m
        if low_m is None and self._max_m is None:
            return NO_FLAGS
        up_m = -sample.pose.position_ned_m[2]
        margin_m = signed_margin(up_m, low_m, self._max_m)
        return self.judge_margin(
            sample.t_s,
            up_m,
            margin_m,
            lambda: (
                f"{self.vehicle} is at a height of "
                + value_beside_limit(up_m, low_m, self._max_m, "m")
            ),
        )


def _limits_of_fence(part: Mapping[str, Data]) -> Iterator[SignalLimit]:
    """Yield the limit of the margin to the fence: the vehicle is inside."""
    del part
    yield SignalLimit(signal="fence_margin_m", value=0.0, is_upper=False, in_the_air=True)


@oracle(
    "geofence",
    "stays inside of its geofence",
    Windowed,
    limits=_limits_of_fence,
)
def geofence(terms: OracleTerms, parameters: Windowed, context: OracleContext) -> Oracle:
    """Return the oracle of the fence's area. Raises OracleError when the campaign has none."""
    del parameters
    if context.fence is None:
        raise OracleError(
            f"oracle {terms.name!r}: the campaign has no geofence for {context.vehicle!r}"
        )
    return GeofenceOracle(terms, fence=context.fence)


@oracle("area", "stays in an area of the campaign's own, which no guard watches", AreaParameters)
def area(terms: OracleTerms, parameters: AreaParameters, context: OracleContext) -> Oracle:
    """Return the oracle of an area. Raises OracleError when it is no place in this world."""
    try:
        fence = parameters.keep.fence(context.frame)
    except FenceError as error:
        raise OracleError(f"oracle {terms.name!r}: {error}", key="keep") from error
    return GeofenceOracle(terms, fence=fence, what="its area", changes=False)


@oracle(
    "altitude",
    "stays between min_m and max_m over the world's origin",
    AltitudeParameters,
    limits=lambda part: band_limits(part, "up_m"),
)
def altitude(terms: OracleTerms, parameters: AltitudeParameters, context: OracleContext) -> Oracle:
    """Return the oracle of the altitude."""
    del context
    return AltitudeOracle(terms, min_m=parameters.min_m, max_m=parameters.max_m)
