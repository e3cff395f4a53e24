"""The order of the tests: what flies on the wall clock is known, and one worker begins with it."""

from itertools import chain
from pathlib import Path
from typing import Any

import pytest

from tests import conftest
from tests.conftest import (
    FAST,
    FLIGHTS,
    ROOT,
    WALL,
    _is_among,
    _leave_core,
    _locks,
    _shares,
    _take_core,
)


@pytest.mark.parametrize("place", [*FAST, *FLIGHTS, *WALL])
def test_a_place_that_is_named_is_there(place: str) -> None:
    assert (ROOT / place).exists()


def test_every_module_that_flies_a_program_is_among_the_flights() -> None:
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


def test_a_worker_has_one_core_until_it_leaves_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    files = [tmp_path / name for name in ("first", "second", "third", "queue")]
    for file in files:
        file.touch()
    monkeypatch.setattr(conftest, "CORES", files[:3])
    monkeypatch.setattr(conftest, "CORES_QUEUE", files[3])
    monkeypatch.setattr(conftest, "_core", [])

    with files[0].open() as first, files[1].open() as second, files[2].open() as third:
        assert _locks(first)
        _take_core()
        _take_core()
        assert not _locks(second)
        assert _locks(third)
        _leave_core()
        assert _locks(second)
