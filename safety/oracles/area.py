"""Where the vehicle may be: the geofence and the height."""

from typing import Self

from pydantic import model_validator

from safety.geofence import Fence
from safety.oracles.base import (
    NO_FLAGS,
    Flags,
    Oracle,
    OracleContext,
    OracleError,
    Parameters,
    Stages,
    oracle,
)
from safety.results import OracleResult
from safety.samples import PoseSample, StageSample


class AltitudeParameters(Parameters):
    """min_m, max_m: heights over the world's origin, in metres, positive up."""

    min_m: float | None = None
    max_m: float | None = None

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.min_m is None and self.max_m is None:
            raise ValueError("give min_m, max_m or both")
        if self.min_m is not None and self.max_m is not None and self.min_m >= self.max_m:
            raise ValueError(f"min_m {self.min_m} is not below max_m {self.max_m}")
        return self


class Geofence(Oracle):
    """Stays inside of its fence from the takeoff command to the end of the landing.

    actual: the smallest signed distance to the boundary, positive inside; limit 0. The oracle
    judges where the vehicle was; whether it could still have stopped is the guard's business.
    """

    def __init__(self, *, name: str, vehicle: str, required: bool, fence: Fence) -> None:
        super().__init__(name=name, vehicle=vehicle, required=required)
        self._fence = fence
        self._stages = Stages()
        self._worst: tuple[float, float] | None = None
        self._outside = False

    def on_stage(self, sample: StageSample) -> Flags:
        """Take a stage."""
        self._stages.reach(sample)
        return NO_FLAGS

    def on_pose(self, sample: PoseSample) -> Flags:
        """Take a pose; each time the fence is left is a flag."""
        if not self._stages.flying:
            return NO_FLAGS
        position_ned_m = sample.pose.position_ned_m
        margin_m = self._fence.margin_m(position_ned_m)
        if self._worst is None or margin_m < self._worst[0]:
            self._worst = (margin_m, sample.t_s)
        left, self._outside = margin_m < 0.0 and not self._outside, margin_m < 0.0
        if not left:
            return NO_FLAGS
        side = self._fence.boundary(position_ned_m)
        return self.flag(sample.t_s, f"{self.vehicle} left the fence by its {side}")

    def result(self, t_s: float) -> OracleResult:
        """Return the smallest signed distance to the boundary."""
        del t_s
        if self._worst is None:
            return self.verdict(passed=False, limit=0.0, unit="m", detail="no pose seen")
        margin_m, at_s = self._worst
        return self.verdict(
            passed=margin_m >= 0.0,
            actual=margin_m,
            limit=0.0,
            unit="m",
            margin=margin_m,
            at_s=at_s,
        )


class Altitude(Oracle):
    """Keeps between two heights; the lower one holds from at_height to the landing only."""

    def __init__(
        self,
        *,
        name: str,
        vehicle: str,
        required: bool,
        min_m: float | None = None,
        max_m: float | None = None,
    ) -> None:
        super().__init__(name=name, vehicle=vehicle, required=required)
        self._min_m = min_m
        self._max_m = max_m
        self._stages = Stages()
        self._worst: tuple[float, float, float] | None = None
        self._outside = False

    def on_stage(self, sample: StageSample) -> Flags:
        """Take a stage."""
        self._stages.reach(sample)
        return NO_FLAGS

    def on_pose(self, sample: PoseSample) -> Flags:
        """Take a pose; each time the band is left is a flag."""
        if not self._stages.flying:
            return NO_FLAGS
        up_m = -sample.pose.position_ned_m[2]
        margins_m = []
        if self._max_m is not None:
            margins_m.append(self._max_m - up_m)
        if self._min_m is not None and not self._stages.near_ground:
            margins_m.append(up_m - self._min_m)
        if not margins_m:
            return NO_FLAGS
        margin_m = min(margins_m)
        if self._worst is None or margin_m < self._worst[0]:
            self._worst = (margin_m, up_m, sample.t_s)
        left, self._outside = margin_m < 0.0 and not self._outside, margin_m < 0.0
        if not left:
            return NO_FLAGS
        return self.flag(sample.t_s, f"{self.vehicle} is {up_m:.2f} m high")

    def result(self, t_s: float) -> OracleResult:
        """Return the height with the smallest margin."""
        del t_s
        limit = self._max_m if self._min_m is None else (self._min_m, self._max_m)
        if self._worst is None:
            return self.verdict(passed=False, limit=limit, unit="m", detail="no pose seen")
        margin_m, up_m, at_s = self._worst
        return self.verdict(
            passed=margin_m >= 0.0,
            actual=up_m,
            limit=limit,
            unit="m",
            margin=margin_m,
            at_s=at_s,
        )


@oracle("geofence", "stays inside of its geofence", Parameters)
def geofence(name: str, required: bool, parameters: Parameters, context: OracleContext) -> Oracle:
    """Return the oracle of the fence. Raises OracleError when the campaign has none."""
    del parameters
    if context.fence is None:
        raise OracleError(f"oracle {name!r}: the campaign has no geofence for {context.vehicle!r}")
    return Geofence(name=name, vehicle=context.vehicle, required=required, fence=context.fence)


@oracle("altitude", "keeps between min_m and max_m over the world's origin", AltitudeParameters)
def altitude(
    name: str, required: bool, parameters: AltitudeParameters, context: OracleContext
) -> Oracle:
    """Return the oracle of height."""
    return Altitude(
        name=name,
        vehicle=context.vehicle,
        required=required,
        min_m=parameters.min_m,
        max_m=parameters.max_m,
    )
