"""Wherever an exception of ours comes up in a run, it is no PASS, and stands in the log.

Where that may be is found by flying under instrumentation. The sample of each run of the tests is
drawn by a seed; WIL_EXCEPTIONS=all flies every point, WIL_EXCEPTIONS=NUMBER so many of each kind.
"""

import os
from pathlib import Path
from typing import Literal

import numpy as np
import pytest

from tests.faults.exceptions.flights import Flights, injections_of, print_count
from tests.faults.exceptions.injection import Injection, Point

_SEED = 9
_SAMPLE = 2
"""How many of each kind and mode fly in the ordinary suite."""
_STAGES = {"opening", "start", "identify", "ready", "arm", "takeoff", "at_height", "goal", "done"}
_STAGES |= {"land", "landed", "end"}


def sample(injections: list[Injection], kind: str) -> list[Injection]:
    """Return those of a kind that are to be flown now."""
    of_kind = [injection for injection in injections if injection.point.kind == kind]
    asked = os.environ.get("WIL_EXCEPTIONS", str(_SAMPLE))
    if asked == "all" or len(of_kind) <= int(asked):
        return of_kind
    rng = np.random.default_rng([_SEED, len(kind)])
    chosen = rng.choice(len(of_kind), size=int(asked), replace=False)
    return [of_kind[index] for index in sorted(chosen)]


@pytest.mark.timeout(0)
@pytest.mark.parametrize(
    ("mode", "kinds"),
    [(mode, kinds) for mode in ("sim", "wil") for kinds in (("await", "callback"), ("call",))],
)
def test_no_exception_is_lost(tmp_path: Path, mode: str, kinds: tuple[str, ...]) -> None:
    flights = Flights(tmp_path, mode)
    probe, undisturbed = flights.find(calls=kinds == ("call",))
    assert undisturbed.result is not None
    assert (undisturbed.result.verdict, undisturbed.result.exceptions) == ("PASS", ())
    assert {point.stage for point in probe.counts} >= _STAGES - {"end"}
    lost: dict[Injection, list[str]] = {}
    happened = 0
    injections = [one for one in injections_of(probe) if one.point.kind in kinds]
    chosen = [one for kind in kinds for one in sample(injections, kind)]
    for injection in chosen:
        outcome = flights.inject(injection)
        happened += outcome.happened
        if outcome.faults:
            lost[injection] = outcome.faults
    where = f"{mode}, {' and '.join(kinds)}"
    print_count(where, injected=len(chosen), happened=happened, points=len(injections))
    assert lost == {}
    assert happened


def test_the_count_of_injections_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    print_count("sim, call", injected=2, happened=1, points=40)
    assert capsys.readouterr().out == "sim, call: 2 of 40 injections made, 1 of them raised\n"


@pytest.mark.parametrize("stage", ["done", "landed", "end"])
@pytest.mark.parametrize("error", ["exception", "cancelled"])
def test_a_watcher_that_raises_at_the_end_of_a_flight_is_no_pass(
    tmp_path: Path, stage: str, error: Literal["exception", "cancelled"]
) -> None:
    flights = Flights(tmp_path, "sim")
    outcome = flights.watch_stage(stage, Injection(Point("call", "", "a watcher", stage), 1, error))
    assert outcome.faults == []
    assert outcome.result is not None
    assert outcome.result.verdict == "ERROR"
    assert outcome.result.exceptions
