"""Exceptions under the wall clock: in the guard, on our side of it, and at the operator's side.

Where that may be is found by operating each under instrumentation, as for a run. The sample of the
suite is drawn by a seed; WIL_EXCEPTIONS=all raises at every point, WIL_EXCEPTIONS=NUMBER at so
many of each kind.
"""

import os
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Protocol

import numpy as np
import pytest

from tests.faults.exceptions.flights import injections_of, print_count
from tests.faults.exceptions.guard_flights import GuardFlights
from tests.faults.exceptions.injection import Injection, Point, Probe
from tests.faults.exceptions.operator_flights import OperatorFlights

if sys.version_info < (3, 11, 7):
    # What is raised before the first line of a connection's handler leaves the connection to
    # asyncio, which closes it since then.
    pytestmark = pytest.mark.filterwarnings(
        "ignore:Exception ignored in. <(function _SelectorTransport|socket.socket)"
        ":pytest.PytestUnraisableExceptionWarning"
    )

_SEED = 9
_SAMPLE = 1
"""How many of each kind in the ordinary suite: each takes seconds of the wall's time."""


class Outcome(Protocol):
    """What came of an operation in which something was raised."""

    counts: dict[Point, int]
    happened: bool
    reported: list[str]

    @property
    def faults(self) -> list[str]:
        """Return what must not be."""


class Flown(Protocol):
    """What is operated again and again."""

    def fly(self, injection: Injection | None = None) -> Outcome:
        """Operate once."""


OPERATOR = "the operator's side"
MAKERS: dict[str, Callable[[Path], Flown]] = {
    "the guard": partial(GuardFlights, side="guard"),
    "our side of the guard": partial(GuardFlights, side="orchestrator"),
    OPERATOR: OperatorFlights,
}


def injections_at(side: str, counts: dict[Point, int]) -> list[Injection]:
    """Return what to raise: at the operator's side no cancellations.

    The MQTT client waits by asyncio.wait_for, which takes no notice of one that comes together
    with what it waits for: nothing ends by it, and nothing is lost.
    """
    found = injections_of(Probe(counts=counts))
    return [one for one in found if side != OPERATOR or one.error == "exception"]


def sample(injections: list[Injection]) -> list[Injection]:
    """Return those that are to be raised now."""
    asked = os.environ.get("WIL_EXCEPTIONS", str(_SAMPLE))
    if asked == "all":
        return injections
    chosen: list[Injection] = []
    for kind in ("await", "callback"):
        of_kind = [injection for injection in injections if injection.point.kind == kind]
        rng = np.random.default_rng([_SEED, len(kind)])
        indices = rng.choice(len(of_kind), size=min(int(asked), len(of_kind)), replace=False)
        chosen += [of_kind[index] for index in sorted(indices)]
    return chosen


@pytest.mark.timeout(0)
@pytest.mark.parametrize("side", MAKERS)
def test_no_exception_is_lost(short_folder: Path, side: str) -> None:
    flown = MAKERS[side](short_folder)
    undisturbed = flown.fly()
    assert undisturbed.reported == []
    lost: dict[Injection, list[str]] = {}
    happened = 0
    injections = injections_at(side, undisturbed.counts)
    chosen = sample(injections)
    for injection in chosen:
        outcome = flown.fly(injection)
        happened += outcome.happened
        if outcome.faults:
            lost[injection] = outcome.faults
    print_count(side, injected=len(chosen), happened=happened, points=len(injections))
    assert lost == {}
    assert happened
