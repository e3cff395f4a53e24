"""The base of oracles that judge a value against limits, and their parameters."""

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Self

from pydantic import model_validator

from wil_campaign.foundation.files.documents import Data, KeyFaultError
from wil_campaign.safety.model.oracle_results import Limit, OracleResult
from wil_campaign.safety.oracles.oracle import (
    NO_FLAGS,
    Flags,
    Oracle,
    OracleTerms,
    SignalLimit,
    Windowed,
)
from wil_campaign.worlds.figures import distinct_value_text


class LimitOracle(Oracle):
    """The base of oracles with limits: keeps the least margin; flags when it becomes negative."""

    def __init__(
        self, terms: OracleTerms, *, unit: str, limit: Limit, nothing: str = "no pose seen"
    ) -> None:
        super().__init__(terms)
        self._unit = unit
        self._limit = limit
        self._nothing = nothing
        self._worst: tuple[float, float, float] | None = None
        self._outside = False
        self._left_s: float | None = None

    def judge_margin(
        self, t_s: float, actual: float, margin: float, text: Callable[[], str]
    ) -> Flags:
        """Judge a value by its margin to the limit; `text` describes a violation."""
        known = margin if self._worst is None else self._worst[0]
        # A margin that is not a number is worse than a limit that is kept, and no violation.
        unknown, was_unknown = math.isnan(margin), math.isnan(known)
        is_worse = margin < known or (unknown and known >= 0.0) or (was_unknown and margin < 0.0)
        if self._worst is None or is_worse:
            self._worst = (margin, actual, t_s)
        left, self._outside = margin < 0.0 and not self._outside, margin < 0.0
        if not left:
            return NO_FLAGS
        if self._left_s is None:
            self._left_s = t_s
        return self.flag(t_s, text())

    @property
    def worst_text(self) -> str:
        """Return the value with the least margin, where it came after the first violation."""
        if self._worst is None or self._left_s is None or self._worst[2] <= self._left_s:
            return ""
        margin, actual, _ = self._worst
        # The limit is as far on one of both sides.
        limits = (actual - margin, actual + margin)
        figure = max((distinct_value_text(actual, limit) for limit in limits), key=len)
        return f"at worst {self.worst_figure(figure)}"

    def worst_figure(self, figure: str) -> str:
        """Return a value that exceeds its limit in words. figure: the value as text."""
        return f"{figure} {self._unit}"

    def result(self, t_s: float) -> OracleResult:
        """Return the oracle's value with the least margin to its limit."""
        del t_s
        if self._worst is None:
            return self.invalid(self._nothing)
        margin, actual, at_s = self._worst
        return self.verdict(
            passed=margin >= 0.0,
            actual=actual,
            limit=self._limit,
            unit=self._unit,
            margin=margin,
            at_s=at_s,
        )


def value_beside_limit(
    value: float, low: float | None, high: float | None, unit: str, *, digits: int = 2
) -> str:
    """Return a value that is beyond a limit, with the limit: "2.13 m/s; the limit is 2 m/s"."""
    limit = high if high is not None and (low is None or value > high) else low
    if limit is None:
        return f"{value:.{digits}f} {unit}"
    return (
        f"{distinct_value_text(value, limit, digits=digits)} {unit}; the limit is {limit:g} {unit}"
    )


def signed_margin(value: float, low: float | None, high: float | None) -> float:
    """Return the signed distance to the nearest of the given limits; one is given."""
    if high is None:
        return value - (low or 0.0)
    return high - value if low is None else min(value - low, high - value)


def shown_limit(low: float | None, high: float | None) -> Limit:
    """Return the limits as results show them: the upper limit alone, or (low, high)."""
    if low is None:
        return high
    return (low, high)


def band_limits(
    part: Mapping[str, Data],
    signal: str,
    *,
    low: str = "min_m",
    high: str = "max_m",
    in_the_air: bool = True,
) -> Iterator[SignalLimit]:
    """Yield the limits of a signal in the parameters of a file, the upper one first.

    low, high: their keys. in_the_air: whether the lower one does not hold at takeoff and landing.
    """
    high_value, low_value = _number(part, high), _number(part, low)
    if high_value is not None:
        yield SignalLimit(signal=signal, value=high_value, is_upper=True)
    if low_value is not None:
        yield SignalLimit(signal=signal, value=low_value, is_upper=False, in_the_air=in_the_air)


def _number(part: Mapping[str, Data], key: str) -> float | None:
    """Return a number in the parameters of a file; None for anything else."""
    value = part.get(key)
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return float(value) if is_number and isinstance(value, int | float) else None


class BandParameters(Windowed):
    """Parameters of an oracle with a lower and an upper limit, at least one given.

    A subclass has the fields min_<unit> and max_<unit>.
    """

    @property
    def low(self) -> float | None:
        """Return the lower limit of the oracle."""
        return self._limit("min_")

    @property
    def high(self) -> float | None:
        """Return the upper limit of the oracle."""
        return self._limit("max_")

    @model_validator(mode="after")
    def _require_order(self) -> Self:
        """Require a limit, and the lower one below the upper one."""
        low_key, high_key = _keys(type(self))
        if self.low is None and self.high is None:
            raise ValueError(f"give {low_key}, {high_key} or both")
        if self.low is not None and self.high is not None and self.low >= self.high:
            raise KeyFaultError(low_key, f"{self.low:g} is not below {high_key} {self.high:g}")
        return self

    def _limit(self, prefix: str) -> float | None:
        key = next(name for name in type(self).model_fields if name.startswith(prefix))
        value: float | None = getattr(self, key)
        return value


def _keys(model: type[Windowed]) -> tuple[str, str]:
    """Return the keys of the lower and upper limit in an oracle's parameters."""
    names = list(model.model_fields)
    low = next(name for name in names if name.startswith("min_"))
    return low, next(name for name in names if name.startswith("max_"))
