"""A search flown under virtual time by the command line, and the file of the failure it found."""

import json
from pathlib import Path
from typing import Any

import pytest

from tests.plugins.search.searches import LIMIT_M, SEARCH, write_search
from wil_campaign.campaigns.expansion.expansion import Campaign, ExpansionOptions
from wil_campaign.orchestrator.campaign.flight_options import ClearedCampaign, FlightOptions
from wil_campaign.orchestrator.campaign.workers import run_engine
from wil_campaign.orchestrator.campaign.workers.run_order import fly_order
from wil_campaign.orchestrator.cli import main
from wil_campaign.orchestrator.cli.progress_display import SilentDisplay
from wil_campaign.orchestrator.operator.run_messages import (
    News,
    OperatorInbox,
    Report,
    RunProgressReport,
)
from wil_campaign.orchestrator.run_results.result_reader import read_result
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.orchestrator.state.run_setup import RunOrder
from wil_campaign.plugins.search.engine import BatchEngine, EngineResult
from wil_campaign.plugins.search.exploration.search_file import load_search
from wil_campaign.plugins.search.ledger import read_ledger
from wil_campaign.plugins.search.search_runner import fly_search
from wil_campaign.safety.guard.core.operator_command import OperatorCommand

WITH_LIDAR = (
    "autopilot: px4}",
    "autopilot: px4, sensors: {scan: {type: lidar, rate_hz: 5, beams: 16}}}",
)
LONGER = ("autonomy: still.py:Still", "autonomy: {use: still.py:Still, with: {ticks: 20}}")


def flown_height_m(result: Path) -> Any:
    """The highest place of a run, to its last digit."""
    oracles = json.loads(result.read_text())["oracles"]
    return next(oracle["actual"] for oracle in oracles if oracle["name"] == "altitude")


def test_a_failure_is_found_confirmed_made_smaller_and_flown_from_its_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_search(
        tmp_path, SEARCH.replace("steps: 3", "steps: 2").replace("sim: 3", "sim: 2")
    )
    path.write_text(path.read_text().replace(*WITH_LIDAR).replace(*LONGER))
    out = tmp_path / "out"
    assert main(["search", str(path), "--out", str(out), "--jobs", "1", "--json"]) == 1
    found = json.loads(capsys.readouterr().out)
    (failure,) = found["failures"]
    assert (failure["cause"], failure["failed"]) == ("altitude/twin", 2)
    assert failure["reduced"]["values"] == {"height": 1.6}
    assert sum(one["flights"] for one in found["costs"]) == 8
    # Open ground, and nothing on it: each sector is empty in each of the flights.
    (scan,) = found["sensed"]
    assert (scan["sensor"], scan["flights"], scan["seen_in"]) == ("scan", 8, 0)
    assert (scan["distinct_readings"], scan["last_new_in_flight"]) == (1, 1)
    levels = [(one["sector"], one["level"], one["flights"]) for one in scan["cells"]]
    assert levels == [(sector, 5, 8) for sector in range(8)]
    (folder,) = (out / "hover" / "search").iterdir()
    assert "nearest by scan" in (folder / "report.html").read_text()
    contents = read_ledger((folder / "ledger.jsonl").read_text())
    assert {one.sensed[0].reduced for each in contents.outcomes.values() for one in each} == {
        ("55555555",)
    }
    assert "<svg" in (folder / "report.html").read_text()
    assert main(["run", str(folder / failure["file"]), "--out", str(tmp_path / "again")]) == 1
    again = sorted((tmp_path / "again").glob("*/*/failure-*/sim/*/result.json"))
    reduced = sorted((folder / "flights" / "0005").glob("*/sim/*/result.json"))
    # The same seeds: the same flights, to the last digit.
    assert [flown_height_m(one) for one in again] == [flown_height_m(one) for one in reduced]
    assert len(again) == 2


class Orphaned:
    """Has the program of a flight die once the flight has failed: its run lands. Lives in a run."""

    def __init__(self, report: Report) -> None:
        self._report = report
        self._has_failed = False
        self._has_told = False

    def report(self, news: News) -> None:
        if isinstance(news, RunProgressReport):
            heights_m = [
                -vehicle.position_ned_m[2] for vehicle in news.vehicles if vehicle.position_ned_m
            ]
            self._has_failed |= max(heights_m, default=0.0) > LIMIT_M + 0.1
        self._report(news)

    def poll(self) -> OperatorCommand | None:
        if self._has_told or not self._has_failed:
            return None
        self._has_told = True
        return OperatorCommand("abort", "the run itself: its parent process died")


def fly_cut_off(order: RunOrder, report: Report, _: OperatorInbox) -> RunResult:
    """Fly an order whose program dies when it has failed; lives in the worker process."""
    orphaned = Orphaned(report)
    return fly_order(order, orphaned.report, orphaned)


class KilledError(Exception):
    """Ends a search as kill -9 does: nothing after it is written."""


class KilledEngine:
    """Is killed in its first batch, when the flight that fails has done so."""

    def __init__(self, engine: BatchEngine) -> None:
        self._engine = engine

    def fly(self, campaign: Campaign, folder: Path) -> EngineResult:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(run_engine, "fly_order", fly_cut_off)
            self._engine.fly(campaign, folder)
        raise KilledError


@pytest.mark.usefixtures("forked_workers")
def test_a_search_killed_after_a_flight_had_failed_comes_to_the_same(tmp_path: Path) -> None:
    engine = BatchEngine(cleared=ClearedCampaign("virtual", 1), watcher=SilentDisplay())
    documents: dict[str, Any] = {}
    for name in ("whole", "killed"):
        (tmp_path / name).mkdir()
        path = write_search(
            tmp_path / name, SEARCH.replace("steps: 3", "steps: 2").replace("sim: 3", "sim: 2")
        )
        search, out = load_search(path, ExpansionOptions()), tmp_path / name / "out"
        options, cleared = FlightOptions(out=out), ClearedCampaign("virtual", 2)
        if name == "killed":
            with pytest.raises(KilledError):
                fly_search(search, options, cleared, KilledEngine(engine), lambda _: None)
            options = FlightOptions(out=out, resume=True)
        folder = fly_search(search, options, cleared, engine, lambda _: None).folder
        documents[name] = json.loads((folder / "search.json").read_text())
        for cost in documents[name]["costs"]:
            cost["wall_s"] = 0.0
    (aside,) = folder.glob("flights/0001/earlier/*/sim/*/result.json")
    cut_off = read_result(aside)
    assert (cut_off.verdict, [one.verdict for one in cut_off.also]) == ("FAIL", ["ABORTED"])
    (kept,) = folder.glob(f"flights/0001/{cut_off.case}/sim/1/result.json")
    assert flown_height_m(kept) > flown_height_m(aside) + 0.1
    (attempt,) = read_result(kept).attempts
    assert (attempt.verdict, attempt.reason[:21]) == (None, "in flight, after FAIL")
    assert documents["killed"] == documents["whole"]
