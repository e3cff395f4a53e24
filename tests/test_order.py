"""The order of the tests: what flies on the wall clock is known, and two workers begin with it."""

import fcntl
from itertools import chain
from typing import Any

import pytest

from tests.conftest import (
    FAST,
    FLIGHTS,
    ROOT,
    TURNS,
    WALL,
    _in_turn,
    _is_among,
    _shares,
    pytest_collection_modifyitems,
)


@pytest.mark.parametrize("place", [*FAST, *FLIGHTS, *WALL])
def test_a_place_that_is_named_is_there(place: str) -> None:
    assert (ROOT / place).exists()


def test_whoever_flies_a_program_has_its_turn() -> None:
    flying = "from tests.orchestrator.wall_runs import"
    found = [
        path.relative_to(ROOT)
        for path in ROOT.rglob("test_*.py")
        if any(line.startswith(flying) for line in path.read_text("utf-8").splitlines())
    ]
    assert len(found) > 5
    assert [path for path in found if not _is_among(path, FLIGHTS)] == []


@pytest.mark.parametrize(("workers", "others"), [(2, 7), (3, 100), (3, 0), (4, 1000)])
def test_each_worker_begins_with_its_own_and_none_is_lost(workers: int, others: int) -> None:
    begun: Any = [[f"{k}:{n}" for n in range(2)] for k in range(workers)]
    then: Any = [f"other {n}" for n in range(others)]
    ordered = list(_shares(begun, then))
    assert sorted(map(str, ordered)) == sorted(map(str, chain(*begun, then)))
    total, first = len(ordered), 0
    for k in range(workers):
        # As --dist worksteal cuts what is collected: each gets its part of what is left.
        size = (total - first) // (workers - k)
        assert ordered[first : first + len(begun[k])] == begun[k]
        first += size


INNER = """
import pytest

@pytest.mark.no_turn("lockstep")
def test_long(): ...
def test_mixed(): ...
@pytest.mark.unmixed
def test_unmixed(): ...
def test_mixed_too(): ...
"""


@pytest.mark.parametrize(
    ("workers", "begun"),
    [
        (2, ["test_mixed", "test_mixed_too", "test_unmixed", "test_long"]),
        (4, ["test_mixed", "test_mixed_too", "test_unmixed", "test_long"]),
    ],
)
def test_flights_that_mix_begin_and_then_those_that_do_not(
    pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch, workers: int, begun: list[str]
) -> None:
    monkeypatch.setenv("PYTEST_XDIST_WORKER_COUNT", str(workers))
    monkeypatch.setattr("tests.conftest.ROOT", pytester.path)
    monkeypatch.setattr("tests.conftest.FLIGHTS", ("test_flights.py",))
    pytester.makeini("[pytest]\nasyncio_default_fixture_loop_scope = function\n")
    items = pytester.getitems(INNER)
    for item in items:
        item.path = pytester.path / "test_flights.py"
    pytest_collection_modifyitems(items)
    assert [item.name for item in items] == begun


def test_of_two_turns_each_is_one_of_its_own() -> None:
    assert len({path.resolve() for path in TURNS.values()}) == len(TURNS) == 2
    with _in_turn("mixed"), _in_turn("unmixed"):
        for path in TURNS.values():
            with path.open() as other, pytest.raises(BlockingIOError):
                fcntl.flock(other, fcntl.LOCK_EX | fcntl.LOCK_NB)
