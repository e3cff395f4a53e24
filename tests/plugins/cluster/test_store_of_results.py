"""Results of a cluster that come through a store: real node processes, real flights, real loss."""

import json
import shutil
import time
from collections.abc import Callable, Iterator
from multiprocessing import Pipe
from pathlib import Path
from typing import Any

import pytest

from tests.orchestrator.hover import write_hover
from tests.plugins.cluster.fake_ray import FakeRay
from tests.plugins.cluster.test_ray_engine import Acting, MortalAgent, contents, events
from wil_campaign.campaigns.expansion.expansion import ExpansionOptions, load_campaign
from wil_campaign.orchestrator.campaign.campaign_runner import (
    CampaignOutcome,
    fly_campaign,
)
from wil_campaign.orchestrator.campaign.flight_options import ClearedCampaign, FlightOptions
from wil_campaign.orchestrator.campaign.folder.campaign_folder import OutputError
from wil_campaign.orchestrator.campaign.workers.run_engine import EngineError
from wil_campaign.orchestrator.campaign.workers.run_workers import WorkerLost
from wil_campaign.orchestrator.cli import main
from wil_campaign.orchestrator.cli.progress_display import SilentDisplay
from wil_campaign.orchestrator.run_results.result_reader import read_result
from wil_campaign.orchestrator.state.run_setup import RunOrder
from wil_campaign.plugins.cluster.node_messages import CampaignBrought, RunOrdered
from wil_campaign.plugins.cluster.node_process import NodeRuns
from wil_campaign.plugins.cluster.node_results import StoredResults
from wil_campaign.plugins.cluster.ray_agents import hire_agents
from wil_campaign.plugins.cluster.ray_engine import RayEngine
from wil_campaign.plugins.cluster.returned_results import LANDED_S, FetchedResults
from wil_campaign.plugins.cluster.store import StoreLimits, open_store
from wil_campaign.plugins.cluster.stored_runs import fetch_run, write_session
from wil_campaign.plugins.cluster.travelling_files import TravellingFiles

pytest.importorskip("fsspec", reason="needs the extra storage")

LIMITS = StoreLimits(tries=2, pauses_s=(0.1,), answer_s=5.0)


@pytest.fixture(autouse=True)
def node_folders(short_folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Have a folder of this test alone for what nodes write, sockets too: their paths are short."""
    monkeypatch.setenv("TMPDIR", str(short_folder))
    return short_folder


@pytest.fixture
def store(tmp_path: Path) -> Path:
    return tmp_path / "store"


def fly(
    path: Path,
    out: Path,
    store: Path,
    *,
    act: Callable[[FakeRay], object] = lambda _: None,
    resume: bool = False,
    repetitions: int = 1,
) -> CampaignOutcome:
    campaign = load_campaign(path, ExpansionOptions(repetitions=repetitions))
    ray = FakeRay(MortalAgent)
    place = open_store(f"file://{store}", LIMITS)
    engine = RayEngine(ray, 1, place, idle=hire_agents(ray, 1, cores=1))
    options = FlightOptions(out=out, resume=resume)
    cleared = ClearedCampaign("virtual", 1, engine=engine)
    try:
        return fly_campaign(campaign, options, cleared, Acting(lambda: act(ray)))
    finally:
        for actor in ray.actors:
            actor.die()
            actor.made.wait()


def lines(folder: Path) -> list[dict[str, str]]:
    return [json.loads(line) for line in (folder / "ledger.jsonl").read_text().splitlines()]


def left_on_nodes(folder: Path) -> Iterator[Path]:
    """Yield the results that nodes have kept."""
    return folder.glob("wil-run-*/default/sim/*/result.json")


def test_results_through_a_store_are_the_same_to_the_byte(
    tmp_path: Path, store: Path, node_folders: Path
) -> None:
    path = write_hover(tmp_path)
    campaign = load_campaign(path, ExpansionOptions(repetitions=2))
    local = fly_campaign(
        campaign,
        FlightOptions(out=tmp_path / "local"),
        ClearedCampaign("virtual", 1),
        SilentDisplay(),
    )
    flown = fly(path, tmp_path / "cluster", store, repetitions=2)
    assert flown.exit_code == local.exit_code == 0
    assert contents(flown.folder) == contents(local.folder)
    assert events(flown.folder) == ["begun", "ordered", "ended", "ordered", "ended"]
    # What the ledger names is what the store has, and the node has nothing left.
    begun, ordered = lines(flown.folder)[:2]
    assert begun["store"] == f"file://{store}"
    assert (store / ordered["place"] / "sent.json").is_file()
    assert not list(node_folders.glob("wil-run-*"))


def test_a_result_that_cannot_be_sent_stays_on_the_node_that_the_reason_names(
    tmp_path: Path, store: Path, node_folders: Path
) -> None:
    refused = tmp_path / "refused"

    def refuse(_: FakeRay) -> None:
        (place,) = store.glob("hover/*/default/sim")
        shutil.rmtree(place)
        place.write_text("no folder")  # as a store does that takes nothing more
        refused.touch()

    path = write_hover(tmp_path, waits_for=refused)
    flown = fly(path, tmp_path / "out", store, act=refuse)
    (run,) = flown.summary.runs
    assert (run.verdict, flown.exit_code) == ("ERROR", 3)
    assert "it is PASS, but its files are not in the store; they are kept in" in run.reason
    assert events(flown.folder) == ["begun", "ordered", "lost"]
    (result,) = left_on_nodes(node_folders)
    assert str(result.parent) in run.reason
    # A person brings it back: what was finished counts.
    home = flown.folder / "default/sim/1"
    shutil.rmtree(home)
    shutil.copytree(result.parent, home)
    again = fly(tmp_path / "hover.yaml", tmp_path / "out", store, resume=True)
    assert [one.verdict for one in again.summary.runs] == ["PASS"]
    assert again.exit_code == 0


@pytest.mark.parametrize(
    ("before", "failing", "counted"),
    [
        ("        return Command(", "self.mistake", ("ERROR", 3)),
        ("        self.ticks -= 1", "os._exit(7)", ("FAIL", 1)),
    ],
)
def test_a_failure_whose_files_cannot_be_sent_is_not_flown_again(
    tmp_path: Path, store: Path, before: str, failing: str, counted: tuple[str, int]
) -> None:
    refused = tmp_path / "refused"

    def refuse(_: FakeRay) -> None:
        (place,) = store.glob("hover/*/default/sim")
        shutil.rmtree(place)
        place.write_text("no folder")
        refused.touch()

    path, code = write_hover(tmp_path, waits_for=refused), tmp_path / "still.py"
    path.write_text(path.read_text() + "retries: 1\n")
    code.write_text(
        f"import os\n{code.read_text()}".replace(before, f"        {failing}\n{before}")
    )
    flown = fly(path, tmp_path / "out", store, act=refuse)
    (run,) = flown.summary.runs
    assert (run.attempts, (run.verdict, flown.exit_code)) == ((), counted)
    assert "its files are not in the store; they are kept in" in run.reason
    assert events(flown.folder) == ["begun", "ordered", "lost"]


def test_a_store_that_is_gone_when_the_result_is_fetched_leaves_it_on_the_node(
    tmp_path: Path, store: Path, node_folders: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def gone(*_: object) -> bool:
        shutil.rmtree(store)
        return False

    monkeypatch.setattr("wil_campaign.plugins.cluster.returned_results.fetch_run", gone)
    flown = fly(write_hover(tmp_path), tmp_path / "out", store)
    (run,) = flown.summary.runs
    assert (run.verdict, flown.exit_code) == ("ERROR", 3)
    assert "it is PASS, but its files are not here; they are kept in" in run.reason
    (result,) = left_on_nodes(node_folders)
    assert str(result.parent) in run.reason


def test_a_damaged_file_does_not_count(
    tmp_path: Path, store: Path, node_folders: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def damaged(*given: object) -> bool:
        for path in store.rglob("trajectory.csv"):
            path.write_bytes(path.read_bytes()[:-1])
        return fetch_run(*given)  # type: ignore[arg-type]

    monkeypatch.setattr("wil_campaign.plugins.cluster.returned_results.fetch_run", damaged)
    flown = fly(write_hover(tmp_path), tmp_path / "out", store)
    (run,) = flown.summary.runs
    assert run.verdict == "ERROR"
    assert "trajectory.csv is not what its node has sent: its SHA-256 differs" in run.reason
    assert list(left_on_nodes(node_folders))


def test_a_worker_that_dies_in_flight_is_waited_for_in_the_store(
    tmp_path: Path, store: Path
) -> None:
    path = write_hover(tmp_path)
    path.write_text(
        path.read_text().replace("still.py:Still", "{use: still.py:Still, with: {ticks: 20000}}")
    )
    flown = fly(path, tmp_path / "out", store, act=lambda ray: ray.actors[0].die())
    (run,) = flown.summary.runs
    assert (run.verdict, flown.exit_code) == ("ERROR", 3)
    assert "has lost the worker" in run.reason
    assert events(flown.folder) == ["begun", "ordered", "lost"]
    # Ray kills what its worker has started; the run has landed, and was sent all the same.
    (sent,) = store.rglob("sent.json")
    landed = read_result(sent.with_name("result.json"))
    assert (landed.verdict, landed.reason) == (
        "ABORTED",
        "aborted by the node: its cluster is gone",
    )
    home = flown.folder / "default/sim/1"
    assert (home / "log.jsonl").is_file()
    assert read_result(home / "result.json").verdict == "ERROR"
    assert read_result(home / "result.landed.json") == landed


class IdleWorkers:
    """Starts a worker that gets no order."""

    async def start(self) -> "IdleWorkers":
        return self

    async def end(self) -> str:
        return ""


async def test_a_node_that_is_deserted_before_a_run_begins_says_so_in_the_store(
    tmp_path: Path, store: Path
) -> None:
    plan = load_campaign(write_hover(tmp_path), ExpansionOptions(repetitions=1)).runs[0]
    order = RunOrder(plan=plan, folder=tmp_path / "out" / plan.name, clock="virtual")
    place, run = open_store(f"file://{store}", LIMITS), "hover/1/default/sim/1/a"
    write_session(place, "hover/1", "session")
    brought: Any = CampaignBrought(
        tmp_path / "out", "session", TravellingFiles(()), store=place.url, place="hover/1"
    )
    commands, sender = Pipe()
    node: Any = NodeRuns(commands, Pipe()[0], tmp_path / "node")
    node._results, node._workers = StoredResults(brought, place), IdleWorkers()
    sender.close()
    ended = await node._fly(RunOrdered(order, run))
    assert isinstance(ended.outcome, WorkerLost)
    began_s = time.monotonic()
    found = FetchedResults(place, tmp_path / "out", "hover/1").of_lost(order, run)
    # It was waited for, for two minutes: the node had said that it begins, and sent nothing more.
    assert time.monotonic() - began_s < LANDED_S / 4
    assert found == "its node has sent no result: it had not begun to fly, or was killed"


def test_a_result_sent_for_a_program_that_died_is_fetched_by_the_next_one(
    tmp_path: Path, store: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Killed(BaseException):
        """In place of a SIGKILL between the node's word and the look into the store."""

    def killed(*_: object) -> None:
        raise Killed

    path = write_hover(tmp_path)
    with monkeypatch.context() as patch:
        patch.setattr("wil_campaign.plugins.cluster.returned_results.fetch_run", killed)
        with pytest.raises(BaseExceptionGroup):
            fly(path, tmp_path / "out", store)
    (folder,) = (tmp_path / "out/hover").iterdir()
    assert events(folder) == ["begun", "ordered"]
    assert not (folder / "default/sim/1/result.json").exists()
    again = fly(path, tmp_path / "out", store, resume=True)
    assert [run.verdict for run in again.summary.runs] == ["PASS"]
    assert events(folder) == ["begun", "ordered", "found", "begun"]


def test_an_order_of_an_earlier_start_is_refused_by_the_store(tmp_path: Path, store: Path) -> None:
    def resumed_elsewhere(_: object) -> None:
        (newest,) = store.glob("hover/*/newest")
        newest.write_text("another")

    class Meddling(SilentDisplay):
        def finished(self, result: object) -> None:
            resumed_elsewhere(result)

    campaign = load_campaign(write_hover(tmp_path), ExpansionOptions(repetitions=2))
    ray = FakeRay(MortalAgent)
    place = open_store(f"file://{store}", LIMITS)
    engine = RayEngine(ray, 1, place, idle=hire_agents(ray, 1, cores=1))
    options = FlightOptions(out=tmp_path / "out")
    cleared = ClearedCampaign("virtual", 1, engine=engine)
    try:
        flown = fly_campaign(campaign, options, cleared, Meddling())
    finally:
        for actor in ray.actors:
            actor.die()
            actor.made.wait()
    assert [run.verdict for run in flown.summary.runs] == ["PASS", "ERROR"]
    assert "resumed by another start" in flown.summary.runs[1].reason


def test_a_store_that_does_not_answer_keeps_a_resumed_campaign_from_flying(
    tmp_path: Path, store: Path
) -> None:
    path = write_hover(tmp_path)
    fly(path, tmp_path / "out", store)
    shutil.rmtree(store)
    store.write_text("no folder")
    with pytest.raises(OutputError, match="resume again when the store is reachable"):
        fly(path, tmp_path / "out", store, resume=True)


def test_a_store_that_takes_nothing_is_refused_before_anything_flies(
    tmp_path: Path, store: Path
) -> None:
    store.write_text("no folder")
    with pytest.raises(EngineError, match="the store of results is not usable") as raised:
        fly(write_hover(tmp_path), tmp_path / "out", store)
    assert raised.value.code == 3


def test_a_node_that_sees_another_store_is_refused(
    tmp_path: Path, store: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Elsewhere(MortalAgent):
        def send(self, message: bytes) -> None:
            for newest in store.glob("hover/*/newest"):
                newest.write_text("of another store")
            super().send(message)

    monkeypatch.setattr("tests.plugins.cluster.test_store_of_results.MortalAgent", Elsewhere)
    with pytest.raises(EngineError, match="give a URL by --store that means the same") as raised:
        fly(write_hover(tmp_path), tmp_path / "out", store)
    assert raised.value.code == 2


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--store", "s3://bucket"], "leave --store out"),
        (["--engine", "ray://127.0.0.1:6379"], "add --store file:///FOLDER"),
        (["--engine", "ray", "--store", "bucket"], "must be a URL"),
        (["--engine", "ray", "--store", "s3://k:s@bucket"], "must not contain credentials"),
        (["--engine", "ray", "--store", "nothing://x"], "nothing://x"),
    ],
)
def test_a_missing_store_is_exit_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], said: str
) -> None:
    out = tmp_path / "out"
    assert main(["run", str(write_hover(tmp_path)), "--out", str(out), *options]) == 2
    assert said in capsys.readouterr().err.replace("\n", " ")
    assert not out.exists()
