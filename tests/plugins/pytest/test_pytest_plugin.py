"""A campaign file is a pytest module: each run a test; one session is flown and read by all."""

import subprocess
import sys
import tomllib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest

import wil_campaign
from tests.made_once import made_once
from tests.orchestrator.hover import write_hover
from tests.test_house import ROOT
from wil_campaign.orchestrator.cli.engine_flight import campaign_of_runs
from wil_campaign.plugins.pytest import pytest_items

MODULE = "wil_campaign.plugins.pytest.pytest_plugin"
ARGUMENTS = ("-p", "no:wil-campaign", "-p", MODULE, "-p", "no:cacheprovider", "-rA")
CASES = """
cases:
  good: {}
  slow: {autonomy.with: {ticks: 60}}
  stuck: {sync.takeoff_timeout_s: 0.01}
  spare: {autonomy.with: {ticks: 60}}
controls:
  late:
    set: {autonomy.with: {ticks: 60}}
    expect: {oracle: time_limit}
accept: {good: {sim: 1/1}, slow: {sim: 1/1}, stuck: {sim: 1/1}}
"""


def write_cases(folder: Path) -> Path:
    path = write_hover(folder)
    text = path.read_text().replace("repetitions: 2", "repetitions: 1")
    text = text.replace("still.py:Still", "{use: still.py:Still}")
    low = "low: {use: altitude, max_m: 0.1, required: false}"
    oracles = f"{{landed: {{}}, time_limit: {{limit_s: 2}}, {low}}}"
    path.write_text(text.replace("{landed: {}}", oracles) + CASES)
    return path


@dataclass(frozen=True)
class Session:
    """A session of pytest that flew a campaign."""

    results: wil_campaign.CampaignResults
    outcomes: dict[str, int]
    text: str


EDITABLE = ("-W", "ignore::pytest.PytestAssertRewriteWarning")
"""pytest warns of the module that makes an installation editable: it cannot rewrite it."""


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Session:
    def fly(folder: Path) -> None:
        write_cases(folder)
        given = ("hover.yaml", "--wil-out", "out")
        done = subprocess.run(  # noqa: S603 - our own interpreter
            [sys.executable, "-m", "pytest", *ARGUMENTS, *EDITABLE, *given],
            cwd=folder,
            capture_output=True,
            text=True,
            check=False,
        )
        (folder / "stdout").write_text(done.stdout, "utf-8")

    folder = made_once(tmp_path_factory, "flown-by-pytest", fly)
    (flown,) = (folder / "out" / "hover").iterdir()
    text = (folder / "stdout").read_text("utf-8")
    words = text.splitlines()[-1].strip("= ").partition(" in ")[0].split(", ")
    outcomes = {word.split()[1].rstrip("s"): int(word.split()[0]) for word in words}
    return Session(wil_campaign.read_results(flown), outcomes, text)


def test_a_fail_is_a_failure_and_an_unproven_run_an_error(session: Session) -> None:
    assert session.outcomes == {"failed": 1, "passed": 2, "skipped": 1, "error": 1}, session.text
    assert "PASSED hover.yaml::good/sim/1" in session.text
    assert "PASSED hover.yaml::late/sim/1" in session.text
    assert "FAILED hover.yaml::slow/sim/1" in session.text
    assert "ERROR hover.yaml::stuck/sim/1" in session.text
    assert "reported only: FAIL: " in session.text


def test_a_failed_test_says_why_without_a_traceback(session: Session) -> None:
    assert "FAIL: twin was not done 2 s after its" in session.text
    assert "Traceback" not in session.text
    assert f"wil-campaign report: out/hover/{session.results.folder.name}/report.html" in (
        session.text
    )


def test_a_caveat_of_a_passed_run_is_named_at_the_end(session: Session) -> None:
    assert "wil-campaign caveat: reported only, and failed: low (good sim, 1 run)" in session.text


def test_the_session_flew_each_run_once_and_its_results_are_typed(session: Session) -> None:
    results = session.results
    verdicts = {run.case: run.verdict for run in (*results.runs, *results.controls)}
    assert verdicts == {
        "good": "PASS",
        "slow": "FAIL",
        "stuck": "ERROR",
        "spare": "FAIL",
        "late": "FAIL",
    }
    assert results.accepted is False
    assert results.exit_code is None
    assert (results.run_folder(results.runs[0]) / "trajectory.csv").is_file()
    assert results.study().rates.rates[0].passed == 1


def test_rows_are_flat_and_have_the_same_columns(session: Session) -> None:
    rows = session.results.rows()
    assert (rows[0]["case"], rows[0]["verdict"], rows[0]["is_control"]) == ("good", "PASS", False)
    assert rows[-1]["is_control"] is True
    limits = [row for row in session.results.oracle_rows() if row["oracle"] == "time_limit"]
    assert {row["limit_high"] for row in limits if row["actual"] is not None} == {2.0}
    assert all(row["limit_low"] is None for row in limits)
    for table in (rows, session.results.oracle_rows()):
        assert {tuple(row) for row in table} == {tuple(table[0])}
        plain = str | int | float | bool | None
        assert all(isinstance(value, plain) for row in table for value in row.values())


@pytest.fixture
def inner(pytester: pytest.Pytester) -> pytest.Pytester:
    pytester.makeini("[pytest]\nasyncio_default_fixture_loop_scope = function\n")
    return pytester


def test_a_campaign_is_collected_only_where_it_is_named(inner: pytest.Pytester) -> None:
    write_cases(inner.path)
    inner.makepyfile("def test_other(): pass")
    whole = inner.runpytest_inprocess(*ARGUMENTS, "--collect-only", "-q")
    assert [line.partition("::")[2] for line in whole.outlines if "::" in line] == ["test_other"]
    named = inner.runpytest_inprocess(*ARGUMENTS, "--collect-only", "-q", "hover.yaml")
    assert [line for line in named.outlines if "::" in line] == [
        f"hover.yaml::{case}/sim/1" for case in ("good", "slow", "stuck", "spare", "late")
    ]
    world = inner.runpytest_inprocess(*ARGUMENTS, "--collect-only", "-q", "world.yaml")
    assert world.ret == pytest.ExitCode.USAGE_ERROR


def test_a_campaign_is_collected_where_the_settings_point_to_it(inner: pytest.Pytester) -> None:
    """As a package of ament_python has it, for `colcon test`."""
    write_hover(inner.path)
    settings = "[pytest]\nasyncio_default_fixture_loop_scope = function\n"
    inner.makeini(f"{settings}testpaths = hover.yaml\n")
    found = inner.runpytest_inprocess(*ARGUMENTS, "--collect-only", "-q")
    found.stdout.fnmatch_lines(["hover.yaml::*"])


def test_faults_of_the_file_are_errors_of_collection(inner: pytest.Pytester) -> None:
    path = write_cases(inner.path)
    path.write_text(path.read_text().replace("goal:", "gaol:"))
    result = inner.runpytest_inprocess(*ARGUMENTS, "hover.yaml")
    result.assert_outcomes(errors=1)
    result.stdout.fnmatch_lines(["*unknown key 'gaol'*"])
    assert not (inner.path / "results").exists()


def test_a_campaign_that_cannot_be_flown_is_an_error_of_each_run(inner: pytest.Pytester) -> None:
    write_cases(inner.path)
    result = inner.runpytest_inprocess(*ARGUMENTS, "hover.yaml", "--wil-jobs", "0", "-k", "good")
    result.assert_outcomes(errors=1, deselected=4)
    result.stdout.fnmatch_lines(["*--jobs 0: must be at least 1"])


def test_an_exception_of_this_program_is_an_error_that_no_share_forgives(
    inner: pytest.Pytester, monkeypatch: pytest.MonkeyPatch, session: Session
) -> None:
    write_cases(inner.path)
    flown = session.results
    spoilt = {"good": "PASS", "spare": "FAIL"}
    runs = tuple(
        replace(run, exceptions=("RuntimeError: boom",)) if run.case in spoilt else run
        for run in flown.runs
    )
    results = replace(flown, summary=replace(flown.summary, runs=runs))
    monkeypatch.setattr(pytest_items, "run", lambda *_, **__: results)
    result = inner.runpytest_inprocess(*ARGUMENTS, "hover.yaml", "-k", "good or spare")
    result.assert_outcomes(errors=2, deselected=3)
    result.stdout.fnmatch_lines(["RuntimeError: boom"])


@pytest.mark.parametrize(
    ("ended", "code", "said"),
    [
        ({"broken": True}, 3, "*exit code 3: an internal exception occurred outside of its runs*"),
        ({"stopped": "command"}, 4, "*exit code 4: stopped by an operator's command*"),
        ({"broken": None}, 3, "*exit code 3: summary.json does not record the end*"),
        ({"stopped": "signal"}, 130, "*exit code 130: stopped by Ctrl-C or SIGTERM*"),
    ],
)
def test_the_end_of_a_campaign_outside_of_its_runs_is_an_error_of_its_own(
    inner: pytest.Pytester,
    monkeypatch: pytest.MonkeyPatch,
    session: Session,
    *,
    ended: dict[str, Any],
    code: int,
    said: str,
) -> None:
    write_cases(inner.path)
    flown = session.results
    runs = tuple(replace(run, verdict="PASS") for run in flown.runs)
    summary = replace(flown.summary, runs=runs, accepted=False, **ended)
    results = replace(flown, summary=summary, exit_code=code)
    monkeypatch.setattr(pytest_items, "run", lambda *_, **__: results)
    result = inner.runpytest_inprocess(*ARGUMENTS, "hover.yaml")
    result.assert_outcomes(passed=5, errors=1)
    assert result.ret == pytest.ExitCode.TESTS_FAILED
    result.stdout.fnmatch_lines([said, "ERROR hover.yaml::late/sim/1*"])


def test_an_aborted_run_is_an_error_whether_or_not_it_counts(
    inner: pytest.Pytester, monkeypatch: pytest.MonkeyPatch, session: Session
) -> None:
    """By it alone `wil-campaign run` ends with exit code 4."""
    write_cases(inner.path)
    flown = session.results
    runs = tuple(
        replace(run, verdict="ABORTED" if run.case == "spare" else "PASS") for run in flown.runs
    )
    results = replace(flown, summary=replace(flown.summary, runs=runs), exit_code=4)
    monkeypatch.setattr(pytest_items, "run", lambda *_, **__: results)
    result = inner.runpytest_inprocess(*ARGUMENTS, "hover.yaml")
    result.assert_outcomes(passed=4, errors=1)


def test_an_exit_code_that_the_runs_explain_is_no_further_error(
    inner: pytest.Pytester, monkeypatch: pytest.MonkeyPatch, session: Session
) -> None:
    """Nor is one by what was not selected: a share that some of its runs cannot meet."""
    write_cases(inner.path)
    results = replace(session.results, exit_code=3)
    monkeypatch.setattr(pytest_items, "run", lambda *_, **__: results)
    whole = inner.runpytest_inprocess(*ARGUMENTS, "hover.yaml")
    whole.assert_outcomes(passed=2, failed=1, skipped=1, errors=1)
    one = inner.runpytest_inprocess(*ARGUMENTS, "hover.yaml", "-k", "good")
    one.assert_outcomes(passed=1, deselected=4)


def test_some_runs_of_a_campaign_are_a_campaign_that_says_what_is_missing(tmp_path: Path) -> None:
    campaign = wil_campaign.load(write_cases(tmp_path))
    part = campaign_of_runs(campaign, {"good/sim/1", "late/sim/1"})
    assert [plan.name for plan in part.plans] == ["good/sim/1", "late/sim/1"]
    assert part.left_out == ("3 of 5 runs and controls",)
    assert [str(wanted) for wanted in part.requirements] == ["1/1"]
    assert part.requirements[0].case == "good"
    whole = campaign_of_runs(campaign, [plan.name for plan in campaign.plans])
    assert (whole.left_out, whole.requirements) == ((), campaign.requirements)
    five = wil_campaign.load(write_hover(tmp_path), repetitions=5)
    (wanted,) = campaign_of_runs(five, {"default/sim/2", "default/sim/4"}).requirements
    assert str(wanted) == "2/2"


def test_the_program_registers_the_plugin() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    assert project["entry-points"]["pytest11"] == {"wil-campaign": MODULE}
