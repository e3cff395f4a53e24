"""Searches over made-up objectives: what is flown comes of a function, at once."""

from collections.abc import Callable
from typing import Any

from wil_campaign.plugins.search.exploration.constraints import parse_constraint
from wil_campaign.plugins.search.exploration.learning_strategies import make_strategy
from wil_campaign.plugins.search.exploration.model import (
    FlightBatch,
    FlightOutcome,
    SearchFindings,
    SearchProblem,
)
from wil_campaign.plugins.search.exploration.search import Search
from wil_campaign.plugins.search.exploration.space import SearchSpace, SpaceParameter, Values
from wil_campaign.plugins.stl.units import SignalKind

Answer = Callable[[Values, str, int], float | None]
"""The value of a flight by the whole values, the mode and a seed; None: INVALID."""


def plane(*, constraints: tuple[str, ...] = (), **more: Any) -> SearchSpace:
    """Two numbers from -1 to 1, of which the campaign itself has 0."""
    parameters = tuple(
        SpaceParameter(name=name, keys=(f"world.{name}_m",), low=-1.0, high=1.0, own=0.0, unit="m")
        for name in ("x", "y", *more)
    )
    kinds = {parameter.name: SignalKind("m", "") for parameter in parameters}
    return SearchSpace(
        parameters=parameters,
        constraints=tuple(parse_constraint(text, kinds) for text in constraints),
    )


def problem(space: SearchSpace, **changed: Any) -> SearchProblem:
    given: dict[str, Any] = {
        "space": space,
        "budget": {"sim": 40},
        "refuse": lambda _: "",
        "at_once": 2,
    }
    return SearchProblem(**(given | changed))


def fly(space: SearchSpace, batch: FlightBatch, answer: Answer) -> list[FlightOutcome]:
    """What came of a batch: below 0 is a failure."""
    outcomes = []
    for flight in batch.flights:
        whole = {k: v for k, v in space.whole(flight.variant.values).items() if v is not None}

        value = answer(whole, flight.mode, flight.repetition)
        verdict: Any = "INVALID" if value is None else "FAIL" if value <= 0.0 else "PASS"
        outcomes.append(
            FlightOutcome(
                verdict=verdict,
                value=value,
                cause="collision/twin" if verdict == "FAIL" else "",
                duration_s=10.0,
            )
        )
    return outcomes


def searched(
    given: SearchProblem, answer: Answer, *, strategy: Any = "tpe", seed: int = 1
) -> tuple[SearchFindings, list[FlightBatch]]:
    """What a search finds, and the batches that it wanted."""
    search = Search(given, make_strategy(strategy, given.space, seed))
    batches = drive(search, lambda batch: fly(given.space, batch, answer))
    return search.findings, batches


def drive(
    search: Search, fly_batch: Callable[[FlightBatch], list[FlightOutcome]]
) -> list[FlightBatch]:
    """Fly all that a search wants, and return it."""
    steps, batches = search.steps(), []
    try:
        batch = next(steps)
        while True:
            batches.append(batch)
            batch = steps.send(fly_batch(batch))
    except StopIteration:
        return batches


def number(values: Values, name: str) -> float:
    value = values[name]
    assert isinstance(value, int | float)
    return float(value)


def corner(values: Values, mode: str, seed: int) -> float:
    """Fail where x is above 0.6 and y above 0.5, the more the farther."""
    del mode, seed
    return max(0.6 - number(values, "x"), 0.5 - number(values, "y"))
