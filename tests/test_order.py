"""The order of the tests: what flies on the wall clock is known, and one worker begins with it."""

import os
import subprocess
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
from tests.in_turn import IN_TURN, SHARES, flies_in_turn, share_of_commit


@pytest.mark.parametrize("place", [*FAST, *FLIGHTS, *WALL])
def test_a_place_that_is_named_is_there(place: str) -> None:
    assert (ROOT / place).exists()


@pytest.mark.parametrize("place", IN_TURN)
def test_what_flies_in_turn_is_there(place: str) -> None:
    source = (ROOT / place).read_text("utf-8")
    for function in IN_TURN[place]:
        assert f"def {function}(" in source
        assert flies_in_turn(place, f"{function}[a case]")
    assert flies_in_turn(place, "test_another") != bool(IN_TURN[place])


def test_a_commit_has_its_share_and_what_is_no_checkout_has_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever Git is told where it runs the tests, as in a hook, and by its user."""
    for name in ("GIT_DIR", "GIT_WORK_TREE", "GIT_INDEX_FILE"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("GIT_CONFIG_GLOBAL", os.devnull)
    monkeypatch.setenv("GIT_CEILING_DIRECTORIES", str(tmp_path.parent))

    def git(*words: str) -> str:
        who = ("-c", "user.name=Test", "-c", "user.email=test@localhost")
        return subprocess.check_output(["git", *who, "-C", tmp_path, *words], text=True)  # noqa: S603, S607

    assert share_of_commit(tmp_path) is None
    git("init", "-q")
    assert share_of_commit(tmp_path) is None
    git("commit", "-qm", "the first", "--allow-empty")
    assert share_of_commit(tmp_path) == int(git("rev-parse", "HEAD")[:8], 16) % SHARES


CONFTEST = """\
import tests.conftest as ours
from tests.conftest import pytest_addoption, pytest_report_header

ours.share_of_commit = lambda folder: 1
ours._flies_in_turn = lambda item: item.name != "test_it[0]"
ours._is_among = lambda *_: True
pytest_configure = ours.pytest_configure

def pytest_collection_modifyitems(config, items):
    ours.ROOT = config.rootpath
    ours.pytest_collection_modifyitems(config, items)
"""


def test_all_tests_leave_out_whose_turn_it_is_not_and_who_names_a_test_flies_it(
    pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", str(ROOT.parent))
    cases = "import pytest\n@pytest.mark.parametrize('k', range(21))\ndef test_it(k): ...\n"
    pytester.makepyfile(**{"tests/test_cases": cases})
    pytester.makeini("[pytest]\ntestpaths = tests")
    pytester.makeconftest(CONFTEST)

    def ended(*words: str) -> pytest.RunResult:
        return pytester.runpytest_subprocess("-p", "no:wil-campaign", *words)

    some = ended()
    some.assert_outcomes(passed=1 + 2, deselected=18)
    some.stdout.fnmatch_lines(["in turn: of tests/in_turn.py share 2 of 10, by the commit;*"])
    ended("--all").assert_outcomes(passed=21)
    ended("-k", "test_it").assert_outcomes(passed=21)
    ended("--lf").assert_outcomes(passed=21)
    ended("-n", "1").assert_outcomes(passed=1 + 2)
    ended("-n", "1", "tests/test_cases.py").assert_outcomes(passed=21)


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
