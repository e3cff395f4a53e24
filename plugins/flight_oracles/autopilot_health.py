"""Oracles of the reported health: the estimator, the battery, the flight modes."""

from typing import Annotated, Self

from pydantic import Field, model_validator

from wil_campaign.foundation.files.documents import KeyFaultError
from wil_campaign.safety.model.oracle_results import OracleResult
from wil_campaign.safety.model.samples import ModeName, StageSample, StateSample
from wil_campaign.safety.model.signals import battery_percent
from wil_campaign.safety.oracles.limit_oracle import LimitOracle, value_beside_limit
from wil_campaign.safety.oracles.oracle import (
    NO_FLAGS,
    Flags,
    Oracle,
    OracleContext,
    OracleTerms,
    Windowed,
    oracle,
)
from wil_campaign.safety.oracles.oracle_terms import ON_GOAL


class EstimatorParameters(Windowed):
    """max_unsound_s: how long the autopilot's estimator may report a fault, seconds."""

    max_unsound_s: float = Field(
        default=0.0,
        ge=0,
        description="how long its estimator may report a missing input; 0 for never",
    )


class BatteryParameters(Windowed):
    """min_percent: of the battery's capacity; min_v: volts. At least one."""

    min_percent: Annotated[
        float | None, Field(ge=0, le=100, description="least remaining charge")
    ] = None
    min_v: Annotated[float | None, Field(gt=0, description="least voltage")] = None

    @model_validator(mode="after")
    def _require_one_limit(self) -> Self:
        """Require one battery limit: percent or volts."""
        if (self.min_percent is None) == (self.min_v is None):
            raise ValueError("give min_percent or min_v; use two oracles for both")
        return self


class ModesParameters(Windowed):
    """allowed: the autopilot's allowed modes; max_changes: how often they may change."""

    allowed: Annotated[tuple[ModeName, ...], Field(description="the modes that it may be in")] = (
        "guided",
    )
    max_changes: Annotated[
        int | None, Field(ge=0, description="how often its mode may change within its window")
    ] = None

    @model_validator(mode="after")
    def _require_some_limit(self) -> Self:
        """Refuse an empty list of the autopilot's allowed modes."""
        if not self.allowed:
            raise KeyFaultError("allowed", "names no mode")
        return self


class EstimatorOracle(Oracle):
    """The oracle of the autopilot's estimator health: unsound no longer than the limit."""

    reports = frozenset({"estimator"})

    def __init__(self, terms: OracleTerms, *, max_unsound_s: float) -> None:
        super().__init__(terms)
        self._max_s = max_unsound_s
        self._seen = False
        self._since: tuple[float, str] | None = None
        self._worst: tuple[float, float, str] = (0.0, 0.0, "")
        self._flagged = False

    def on_stage(self, sample: StageSample) -> Flags:
        """Take a stage: an estimator fault that lasts beyond the window counts until its end."""
        was_open = self.stages.open
        self.stages.reach(sample)
        if was_open and not self.stages.open:
            return self._unsound_until(sample.t_s)
        return NO_FLAGS

    def on_state(self, sample: StateSample) -> Flags:
        """Take a state; an estimator fault that lasts too long is flagged once."""
        if not self.stages.open:
            return NO_FLAGS
        self._seen = True
        if sample.estimator_fault is not None and self._since is None:
            self._since = (sample.t_s, sample.estimator_fault)
        flags = self._unsound_until(sample.t_s)
        if sample.estimator_fault is None:
            self._since, self._flagged = None, False
        return flags

    def result(self, t_s: float) -> OracleResult:
        """Return the longest time for which the estimator was unsound."""
        del t_s
        limit = self._max_s
        if not self._seen:
            return self.invalid("no state seen")
        lasted_s, at_s, fault = self._worst
        return self.verdict(
            passed=not self._too_long(lasted_s, fault),
            actual=lasted_s,
            limit=limit,
            unit="s",
            margin=limit - lasted_s if limit > 0.0 else None,
            at_s=at_s if fault else None,
            detail=fault,
        )

    def _unsound_until(self, t_s: float) -> Flags:
        """Return flags of an estimator fault that has lasted until a time."""
        if self._since is None:
            return NO_FLAGS
        since_s, fault = self._since
        lasted_s = t_s - since_s
        if lasted_s >= self._worst[0]:
            self._worst = (lasted_s, since_s, fault)
        if self._flagged or not self._too_long(lasted_s, fault):
            return NO_FLAGS
        self._flagged = True
        return self.flag(t_s, f"{self.vehicle}: {fault}")

    def _too_long(self, lasted_s: float, fault: str) -> bool:
        # With a limit of 0 any fault is too long, however short.
        return bool(fault) and (lasted_s > self._max_s or self._max_s == 0.0)


class BatteryOracle(LimitOracle):
    """The oracle of battery health: a least charge or voltage."""

    reports = frozenset({"battery"})

    def __init__(
        self, terms: OracleTerms, *, min_percent: float | None, min_v: float | None
    ) -> None:
        self._in_percent = min_percent is not None
        self._least = min_v or 0.0 if min_percent is None else min_percent
        super().__init__(
            terms,
            unit="%" if self._in_percent else "V",
            limit=self._least,
            nothing="it never reported its battery",
        )
        self._is_known = False
        self._lost_s: float | None = None

    def on_state(self, sample: StateSample) -> Flags:
        """Take a state; a battery below its limit is a flag."""
        value = battery_percent(sample) if self._in_percent else sample.battery_v
        if not self.stages.open:
            return NO_FLAGS
        if value is None:
            if self._is_known and self._lost_s is None:
                self._lost_s = sample.t_s
            return NO_FLAGS
        self._is_known = True
        unit = "%" if self._in_percent else "V"
        return self.judge_margin(
            sample.t_s,
            value,
            value - self._least,
            lambda: (
                f"{self.vehicle}: battery at "
                + value_beside_limit(value, self._least, None, unit, digits=1)
            ),
        )

    def result(self, t_s: float) -> OracleResult:
        """Return the least charge or voltage; INVALID if it became unknown in the window."""
        found = super().result(t_s)
        if self._lost_s is None or found.verdict != "PASS":
            return found
        what = "charge" if self._in_percent else "voltage"
        return self.invalid(
            f"its battery's {what} is reported as unknown{self.stages.since(self._lost_s)}"
        )


class ModesOracle(Oracle):
    """The oracle of the autopilot's modes: allowed ones only, and few enough changes."""

    reports = frozenset({"heartbeat"})

    def __init__(
        self, terms: OracleTerms, *, allowed: tuple[ModeName, ...], max_changes: int | None
    ) -> None:
        super().__init__(terms)
        self._allowed = frozenset(allowed)
        self._max_changes = max_changes
        self._last: str | None = None
        self._changes = 0
        self._first_bad: tuple[float, str] | None = None

    def on_state(self, sample: StateSample) -> Flags:
        """Take a state; a mode that is not allowed, and each change too many, is a flag."""
        if not self.stages.open:
            return NO_FLAGS
        mode = sample.mode.value
        last, self._last = self._last, mode
        if mode == last:
            return NO_FLAGS
        self._changes += 0 if last is None else 1
        many = self._max_changes is not None and self._changes > self._max_changes
        if mode in self._allowed and not many:
            return NO_FLAGS
        name = sample.mode_name or mode
        text = f"{self.vehicle} was in {name} ({mode})"
        if mode in self._allowed:
            text = f"{self.vehicle} changed its mode {self._changes} times, last into {name}"
        self._first_bad = self._first_bad or (sample.t_s, text)
        return self.flag(sample.t_s, text)

    def result(self, t_s: float) -> OracleResult:
        """Return the number of mode changes, and the first mode or change that was not allowed.

        A mode that is not allowed has no margin, however few the changes.
        """
        del t_s
        if self._last is None:
            return self.invalid("no state seen")
        at_s, text = self._first_bad or (None, "")
        most = self._max_changes
        limit = most if self._first_bad is None or self._changes > (most or 0) else None
        return self.verdict(
            passed=self._first_bad is None,
            actual=float(self._changes),
            limit=limit,
            unit="changes",
            margin=None if limit is None else float(limit - self._changes),
            at_s=at_s,
            detail=text,
        )


@oracle("estimator", "has a healthy estimator in flight", EstimatorParameters)
def estimator(
    terms: OracleTerms, parameters: EstimatorParameters, context: OracleContext
) -> Oracle:
    """Return the oracle of the autopilot's estimator health."""
    del context
    return EstimatorOracle(terms, max_unsound_s=parameters.max_unsound_s)


@oracle("battery", "keeps at least a charge or voltage", BatteryParameters)
def battery(terms: OracleTerms, parameters: BatteryParameters, context: OracleContext) -> Oracle:
    """Return the oracle of the battery's health."""
    del context
    return BatteryOracle(terms, min_percent=parameters.min_percent, min_v=parameters.min_v)


@oracle("modes", "flies in the allowed modes only", ModesParameters, window=ON_GOAL)
def modes(terms: OracleTerms, parameters: ModesParameters, context: OracleContext) -> Oracle:
    """Return the oracle of the autopilot's mode changes."""
    del context
    return ModesOracle(terms, allowed=parameters.allowed, max_changes=parameters.max_changes)
