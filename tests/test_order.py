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
from tests.nightly import NIGHTLY, flies_nightly


@pytest.mark.parametrize("place", [*FAST, *FLIGHTS, *WALL])
def test_a_place_that_is_named_is_there(place: str) -> None:
    assert (ROOT / place).exists()


@pytest.mark.parametrize("place", NIGHTLY)
def test_what_flies_each_night_is_there(place: str) -> None:
    """Whether the cases that stand in for others are there is known with all tests: conftest."""
    source = (ROOT / place).read_text("utf-8")
    for function, kept in NIGHTLY[place].items():
        assert f"def {function}(" in source
        assert not any(flies_nightly(place, f"{function}[{case}]") for case in kept)
        assert flies_nightly(place, f"{function}[another]")


CONFTEST = """\
import tests.conftest as ours
from tests.conftest import pytest_addoption, pytest_configure

def pytest_collection_modifyitems(config, items):
    ours._flies_nightly = lambda item: item.name == "test_it[2]"
    ours._is_among = lambda *_: True
    ours.ROOT = config.rootpath
    ours.NIGHTLY = {"tests/test_cases.py": {"test_it": ("KEPT",)}}
    ours.pytest_collection_modifyitems(config, items)
"""


def test_all_tests_leave_out_what_flies_each_night_and_who_names_a_test_flies_it(
    pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", str(ROOT.parent))
    cases = "import pytest\n@pytest.mark.parametrize('k', [1, 2])\ndef test_it(k): ...\n"
    pytester.makepyfile(**{"tests/test_cases": cases})
    pytester.makeini("[pytest]\ntestpaths = tests")

    def ended(*words: str, kept: str = "1") -> pytest.RunResult:
        pytester.makeconftest(CONFTEST.replace("KEPT", kept))
        return pytester.runpytest_subprocess("-p", "no:wil-campaign", *words)

    ended().assert_outcomes(passed=1, deselected=1)
    ended("--nightly").assert_outcomes(passed=2)
    ended("tests/test_cases.py").assert_outcomes(passed=2)
    ended("-n", "1").assert_outcomes(passed=1)
    ended("-n", "1", "tests/test_cases.py").assert_outcomes(passed=2)
    missing = "*names what is no test: tests/test_cases.py::test_it[[]3[]]*"
    ended(kept="3").stderr.fnmatch_lines([missing])


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
