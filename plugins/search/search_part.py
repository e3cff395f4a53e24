"""The campaign's `search`: which variants are tried to find one that fails."""

import math
from typing import Annotated, Literal, Self

from pydantic import Field, field_validator, model_validator

from wil_campaign.foundation.files.documents import KeyFaultError, Part

StrategyName = Literal["tpe", "cma-es", "sobol", "random", "grid", "pairwise"]
ParameterValue = bool | int | float | str
ParameterName = Annotated[str, Field(pattern=r"^[A-Za-z_][A-Za-z0-9_]{0,31}$")]
Flights = Annotated[int, Field(ge=1, le=1_000_000)]


class ParameterPart(Part):
    """A parameter of the search. key: the dotted key that it changes, or several of them.

    from, to: its limits, both included. integer: whole numbers only. choices: its values instead
    of limits. steps: number of values that strategies of fixed values (grid, pairwise) use.
    """

    key: Annotated[str, Field(min_length=1)] | Annotated[list[str], Field(min_length=1)]
    from_: float | None = Field(default=None, alias="from")
    to: float | None = None
    integer: bool = False
    choices: Annotated[list[ParameterValue], Field(min_length=2)] | None = None
    steps: Annotated[int, Field(ge=2, le=1000)] = 5

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        """Require either limits, the lower one below the upper one, or choices."""
        if self.choices is not None:
            for key in ("from", "to", "integer", "steps"):
                if {key, f"{key}_"} & self.model_fields_set:
                    raise KeyFaultError(key, "has no effect with choices")
            return self
        if self.from_ is None or self.to is None:
            raise ValueError("give from and to, or choices")
        if self.from_ >= self.to:
            raise KeyFaultError("to", f"must be above from, {self.from_:g}, is {self.to:g}")
        if not math.isfinite(self.to - self.from_):
            raise KeyFaultError("to", f"is too far from from, {self.from_:g}")
        if self.integer:
            for key, value in (("from", self.from_), ("to", self.to)):
                if not value.is_integer():
                    raise KeyFaultError(key, f"must be a whole number, is {value:g}")
        return self

    @field_validator("choices")
    @classmethod
    def _distinct(cls, choices: list[ParameterValue] | None) -> list[ParameterValue] | None:
        """Refuse a value that is named twice."""
        for index, value in enumerate(choices or ()):
            if any(
                value == choice and type(value) is type(choice)
                for choice in (choices or ())[:index]
            ):
                raise KeyFaultError(index, f"'{value}' is named twice")
        return choices

    @property
    def keys(self) -> tuple[str, ...]:
        """Return the dotted keys that the parameter changes."""
        return (self.key,) if isinstance(self.key, str) else tuple(self.key)


class BudgetPart(Part):
    """The search's `budget`: number of flights that look for failures, by mode.

    sim, wil: of the twin alone, of the pair. real: of the real vehicle; by default none.
    """

    sim: Flights | None = None
    wil: Flights | None = None
    real: Flights | None = None

    @model_validator(mode="after")
    def _some(self) -> Self:
        if self.sim is None and self.wil is None and self.real is None:
            raise ValueError("give flights for at least one mode: {sim: 60}")
        return self


class ConfirmPart(Part):
    """The search's `confirm`: how failing variants are flown again, under other seeds.

    flights: of each failing variant. at_least: how many of them have to fail; null: more than half.
    most: how many failing variants are flown again.
    """

    flights: Annotated[int, Field(ge=1, le=1000)] = 5
    at_least: Annotated[int, Field(ge=1, le=1000)] | None = None
    most: Annotated[int, Field(ge=1, le=1000)] = 3

    @model_validator(mode="after")
    def _reachable(self) -> Self:
        """Refuse more failures than there are flights."""
        if self.at_least is not None and self.at_least > self.flights:
            raise KeyFaultError("at_least", f"is more than the {self.flights} flights")
        return self

    @property
    def votes(self) -> int:
        """Return how many of the flights have to fail."""
        return self.flights // 2 + 1 if self.at_least is None else self.at_least


class SearchPart(Part):
    """The campaign's `search`, which `wil-campaign search` flies.

    case: the case that is varied; null: the first one. parameters: by the names that constraints
    use. constraints: conditions between parameters, such as "aside + 0.5 * size <= 1.6". objective:
    the oracle whose margin is minimised; or several, of which the smallest counts. scale: by
    oracle, in its unit: the margin that counts as 1, where the oracle's limit is no suitable
    measure. strategy: what proposes variants. budget: flights that look for failures. seeds:
    flights of each variant. stop_after: number of confirmed failures that end the search; null: the
    budget is used up. reduce: largest number of flights to simplify each confirmed failure.
    """

    case: str | None = None
    parameters: Annotated[dict[ParameterName, ParameterPart], Field(min_length=1)]
    constraints: list[Annotated[str, Field(min_length=1)]] = Field(default_factory=list)
    objective: Annotated[str, Field(min_length=1)] | Annotated[list[str], Field(min_length=1)]
    scale: dict[str, Annotated[float, Field(gt=0)]] = Field(default_factory=dict)
    strategy: StrategyName = "tpe"
    budget: BudgetPart
    seeds: Annotated[int, Field(ge=1, le=1000)] = 1
    confirm: ConfirmPart = ConfirmPart()
    reduce: Annotated[int, Field(ge=0, le=100_000)] = 40
    stop_after: Annotated[int, Field(ge=1, le=1000)] | None = None

    @property
    def oracles(self) -> tuple[str, ...]:
        """Return the names of the oracles whose margins are the objective."""
        return (self.objective,) if isinstance(self.objective, str) else tuple(self.objective)

    @property
    def flights_by_mode(self) -> dict[Literal["sim", "wil", "real"], int]:
        """Return the budget of each mode that is flown, the cheapest first."""
        given = self.budget
        found: dict[Literal["sim", "wil", "real"], int] = {}
        if given.sim is not None:
            found["sim"] = given.sim
        if given.wil is not None:
            found["wil"] = given.wil
        if given.real is not None:
            found["real"] = given.real
        return found
