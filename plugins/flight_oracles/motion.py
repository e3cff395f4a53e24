"""Oracles of the vehicle's motion: speed and attitude."""

from collections.abc import Callable, Iterator, Mapping
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from wil_campaign.foundation.files.documents import Data
from wil_campaign.safety.model import signals
from wil_campaign.safety.model.samples import PoseSample
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
    OracleTerms,
    SignalLimit,
    Windowed,
    oracle,
)

Axis = Literal["total", "horizontal", "vertical"]
Angle = Annotated[float | None, Field(gt=0, le=180)]

_SPEEDS: dict[Axis, Callable[[PoseSample], float]] = {
    "total": signals.speed_m_s,
    "horizontal": signals.ground_speed_m_s,
    "vertical": signals.vertical_speed_m_s,
}
_SIGNALS = {
    "total": "speed_m_s",
    "horizontal": "ground_speed_m_s",
    "vertical": "vertical_speed_m_s",
}


class SpeedParameters(BandParameters):
    """min_m_s, max_m_s: limits of the motion's speed along `axis`."""

    min_m_s: Annotated[
        float | None, Field(ge=0, description="slowest, between at_height and land")
    ] = None
    max_m_s: Annotated[float | None, Field(gt=0, description="fastest")] = None
    axis: Annotated[Axis, Field(description="of which part of the velocity")] = "total"


class AttitudeParameters(Windowed):
    """The greatest angles of the motion's attitude to either side, degrees; at least one."""

    max_tilt_deg: Annotated[
        Angle, Field(description="between its vertical axis and the world's")
    ] = None
    max_roll_deg: Annotated[Angle, Field(description="to either side")] = None
    max_pitch_deg: Annotated[Angle, Field(description="nose up or down")] = None

    @model_validator(mode="after")
    def _require_some_limit(self) -> Self:
        """Require a limit of tilt, roll or pitch."""
        if self.max_tilt_deg is None and self.max_roll_deg is None and self.max_pitch_deg is None:
            raise ValueError("give max_tilt_deg, max_roll_deg or max_pitch_deg")
        return self


class SpeedOracle(LimitOracle):
    """The oracle of the motion's speed; the lower limit from at_height to the landing only."""

    motion = frozenset({"velocity"})

    def __init__(
        self, terms: OracleTerms, *, min_m_s: float | None, max_m_s: float | None, axis: Axis
    ) -> None:
        super().__init__(terms, unit="m/s", limit=shown_limit(min_m_s, max_m_s))
        self._min_m_s = min_m_s
        self._max_m_s = max_m_s
        self._speed_m_s = _SPEEDS[axis]

    def on_pose(self, sample: PoseSample) -> Flags:
        """Judge a pose's speed; each time it leaves the limits is a flag."""
        if not self.stages.covers(sample.t_s):
            return NO_FLAGS
        low_m_s = None if self.stages.near_ground_at(sample.t_s) else self._min_m_s
        if low_m_s is None and self._max_m_s is None:
            return NO_FLAGS
        speed_m_s = self._speed_m_s(sample)
        margin_m_s = signed_margin(speed_m_s, low_m_s, self._max_m_s)
        return self.judge_margin(
            sample.t_s,
            speed_m_s,
            margin_m_s,
            lambda: (
                f"{self.vehicle} flew "
                f"{value_beside_limit(speed_m_s, low_m_s, self._max_m_s, 'm/s')}"
            ),
        )


class AttitudeOracle(LimitOracle):
    """The oracle of the motion's attitude: the angle with the least margin is reported."""

    motion = frozenset({"attitude"})

    def __init__(
        self,
        terms: OracleTerms,
        *,
        limits: tuple[tuple[str, Callable[[PoseSample], float], float], ...],
    ) -> None:
        smallest = min(limit_deg for _, _, limit_deg in limits)
        super().__init__(terms, unit="deg", limit=smallest)
        self._limits = limits
        self._least_deg: float | None = None

    def on_pose(self, sample: PoseSample) -> Flags:
        """Judge a pose's attitude; each time it exceeds a limit is a flag."""
        if not self.stages.covers(sample.t_s):
            return NO_FLAGS
        angles = [(limit - abs(of(sample)), what, limit) for what, of, limit in self._limits]
        margin_deg, what, limit_deg = min(angles)
        if self._least_deg is None or margin_deg < self._least_deg:
            self._least_deg, self._limit = margin_deg, limit_deg
        angle_deg = limit_deg - margin_deg
        return self.judge_margin(
            sample.t_s,
            angle_deg,
            margin_deg,
            lambda: (
                f"{self.vehicle} had a {what} of "
                + value_beside_limit(angle_deg, None, limit_deg, "deg", digits=1)
            ),
        )


def _speed_limits(part: Mapping[str, Data]) -> Iterator[SignalLimit]:
    """Yield the limits of the speed along the axis that a campaign names."""
    signal = _SIGNALS.get(str(part.get("axis", "total")), "")
    if signal:
        yield from band_limits(part, signal, low="min_m_s", high="max_m_s")


@oracle(
    "speed",
    "flies no faster than max_m_s and no slower than min_m_s",
    SpeedParameters,
    limits=_speed_limits,
)
def speed(terms: OracleTerms, parameters: SpeedParameters, context: OracleContext) -> Oracle:
    """Return the oracle of the motion's speed."""
    del context
    return SpeedOracle(
        terms, min_m_s=parameters.min_m_s, max_m_s=parameters.max_m_s, axis=parameters.axis
    )


@oracle("attitude", "tilts no more than its limits", AttitudeParameters)
def attitude(terms: OracleTerms, parameters: AttitudeParameters, context: OracleContext) -> Oracle:
    """Return the oracle of the motion's attitude."""
    del context
    angles = (
        ("tilt", signals.tilt_deg, parameters.max_tilt_deg),
        ("roll", signals.roll_deg, parameters.max_roll_deg),
        ("pitch", signals.pitch_deg, parameters.max_pitch_deg),
    )
    limits = tuple((what, of, limit) for what, of, limit in angles if limit is not None)
    return AttitudeOracle(terms, limits=limits)
