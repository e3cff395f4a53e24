"""The engine over a cluster without Ray: real node processes, real flights, real deaths."""

import json
import os
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any

import psutil
import pytest

from tests.orchestrator.hover import write_hover
from tests.plugins.cluster.fake_ray import FakeRay
from wil_campaign.campaigns.expansion.expansion import Campaign, ExpansionOptions, load_campaign
from wil_campaign.orchestrator.campaign.campaign_runner import (
    CampaignOutcome,
    fly_campaign,
)
from wil_campaign.orchestrator.campaign.flight_options import ClearedCampaign, FlightOptions
from wil_campaign.orchestrator.campaign.folder.campaign_folder import OutputError
from wil_campaign.orchestrator.campaign.workers.run_engine import EngineError
from wil_campaign.orchestrator.cli import main
from wil_campaign.orchestrator.cli.progress_display import SilentDisplay
from wil_campaign.orchestrator.operator.run_messages import RunProgressReport
from wil_campaign.plugins.cluster import node_agent, ray_agents, ray_engine
from wil_campaign.plugins.cluster import node_facts as facts
from wil_campaign.plugins.cluster.node_facts import node_facts, unfit_text
from wil_campaign.plugins.cluster.node_messages import NodeFacts, encode_to_campaign
from wil_campaign.plugins.cluster.ray_agents import HIRED_S, hire_agents
from wil_campaign.plugins.cluster.ray_engine import RayEngine, engine_address
from wil_campaign.plugins.cluster.store import open_store
from wil_campaign.plugins.cluster.travelling_files import TravellingFiles, pack_files

NEAR_ENDLESS = "autonomy: {use: still.py:Still, with: {ticks: 20000}}"


class QuickAgent:
    """An agent that is up at once, without a process of its own."""

    def receive(self, _: float) -> list[bytes]:
        return [encode_to_campaign(NodeFacts(node_facts()))]

    def die(self) -> None: ...


class MortalAgent(node_agent.NodeAgent):
    """An agent that dies as a worker of Ray does: with its children, and its pipes are closed."""

    def die(self) -> None:
        for child in psutil.Process().children():
            with suppress(psutil.NoSuchProcess):  # a zombie, which another test may leave
                if "wil_campaign.plugins.cluster.node_process" in child.cmdline():
                    child.kill()
        self._to.close()

    def wait(self) -> None:
        assert node_agent.await_process_end(self.pid, 120.0)


class Acting(SilentDisplay):
    """Does something once, at the first sign that so many runs are in flight."""

    def __init__(self, act: Callable[[], object], at_once: int = 1) -> None:
        super().__init__()
        self._act: Callable[[], object] | None = act
        self._at_once = at_once
        self._seen: set[str] = set()

    def progress(self, progress: RunProgressReport) -> None:
        self._seen.add(progress.run)
        if self._act is not None and len(self._seen) >= self._at_once:
            act, self._act = self._act, None
            act()


def fly(
    campaign: Campaign,
    out: Path,
    *,
    act: Callable[[FakeRay], object] = lambda _: None,
    workers: int = 1,
    resume: bool = False,
    cpus: int = 64,
    jobs: int = 1,
) -> CampaignOutcome:
    ray = FakeRay(MortalAgent, cpus)
    store = open_store(f"file://{out}-store")
    engine = RayEngine(ray, 1, store, idle=hire_agents(ray, workers, cores=1))
    options = FlightOptions(out=out, resume=resume)
    cleared = ClearedCampaign("virtual", jobs, engine=engine)
    try:
        return fly_campaign(campaign, options, cleared, Acting(lambda: act(ray), jobs))
    finally:
        if ray.actors:
            assert ray.options["max_restarts"] == ray.options["max_task_retries"] == 0
        for actor in ray.actors:
            actor.die()


def contents(folder: Path) -> dict[str, object]:
    """Return what a campaign's folder says, without what each start has of its own."""
    found: dict[str, object] = {}
    for path in sorted(folder.glob("default/**/*")):
        if path.name == "result.json":
            found[str(path.relative_to(folder))] = {**json.loads(path.read_text()), "wall_s": 0}
        elif path.suffix in {".csv", ".jsonl", ".tlog"}:
            found[str(path.relative_to(folder))] = path.read_bytes()
    return found


def events(folder: Path) -> list[str]:
    return [
        json.loads(line)["event"] for line in (folder / "ledger.jsonl").read_text().splitlines()
    ]


def test_an_order_that_no_message_can_hold_is_not_in_the_ledger(tmp_path: Path) -> None:
    """A resumed campaign would wait for it, and take it for a flight that was lost."""
    sets = (f"autonomy={{use: still.py:Still, with: {{ticks: {10**30}}}}}",)
    campaign = load_campaign(write_hover(tmp_path), ExpansionOptions(repetitions=1, sets=sets))
    with pytest.raises(EngineError, match="cannot be sent to a node"):
        fly(campaign, tmp_path / "out")
    (ledger,) = (tmp_path / "out").glob("**/ledger.jsonl")
    assert "ordered" not in events(ledger.parent)


PRINTS = "import os\n\nprint([one for one in os.environ if one.startswith('RAY_')])\n"


def test_a_cluster_flies_the_same_to_the_byte_from_files_that_travel(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, source = write_hover(tmp_path), tmp_path / "still.py"
    source.write_text(PRINTS + source.read_text())
    campaign = load_campaign(path, ExpansionOptions(repetitions=1))
    local = fly_campaign(
        campaign,
        FlightOptions(out=tmp_path / "local"),
        ClearedCampaign("virtual", 1),
        SilentDisplay(),
    )
    monkeypatch.setenv("RAY_AUTH_TOKEN", "secret")
    flown = fly(campaign, tmp_path / "cluster")
    assert flown.exit_code == local.exit_code == 0
    assert contents(flown.folder) == contents(local.folder)
    assert len(contents(flown.folder)) > 2
    assert events(flown.folder) == ["begun", "ordered", "ended"]
    output = (flown.folder / "default/sim/1/output.txt").read_text()
    assert output == "[]\n"  # no token of the cluster in the environment of a run
    result = flown.folder / "default/sim/1/result.json"
    written = result.stat().st_mtime_ns
    assert fly(campaign, tmp_path / "cluster", workers=0, resume=True).folder == flown.folder
    assert result.stat().st_mtime_ns == written
    assert events(flown.folder) == ["begun", "ordered", "ended", "begun"]


def test_a_file_of_the_node_that_changes_while_the_campaign_flies_ends_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A file that is named absolutely does not travel: later runs flew with another one."""
    monkeypatch.setattr(ray_engine, "_PAUSE_S", 0.001)
    path, net = write_hover(tmp_path), tmp_path / "net.onnx"
    net.write_text("weights")
    named = f"autonomy: {{use: still.py:Still, with: {{model: '{net}'}}}}"
    path.write_text(path.read_text().replace("autonomy: still.py:Still", named))
    campaign = load_campaign(path, ExpansionOptions(repetitions=3))
    assert fly(campaign, tmp_path / "same").exit_code == 0
    with pytest.raises(EngineError, match=r"net\.onnx is not the file that it is") as error:
        fly(campaign, tmp_path / "other", act=lambda _: net.write_text("other weights"))
    assert error.value.code == 3
    assert len(list(tmp_path.glob("other/hover/*/default/sim/*/result.json"))) == 1


def test_files_that_changed_before_they_were_packed_are_not_flown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A resumed campaign waits until what flew has landed: an edit meanwhile was flown with."""
    campaign = load_campaign(write_hover(tmp_path), ExpansionOptions(repetitions=1))
    source = tmp_path / "still.py"

    def edit_and_pack(*given: Any) -> TravellingFiles:
        source.write_text(f"{source.read_text()}# changed\n")
        return pack_files(*given)

    monkeypatch.setattr(ray_engine, "pack_files", edit_and_pack)
    with pytest.raises(OutputError, match=r"still\.py changed while the campaign flew"):
        fly(campaign, tmp_path / "out")
    assert not list(tmp_path.glob("out/**/result.json"))


def test_a_worker_that_dies_in_flight_takes_one_run_which_is_not_flown_again(
    tmp_path: Path,
) -> None:
    path = write_hover(tmp_path)
    path.write_text(path.read_text().replace("autonomy: still.py:Still", NEAR_ENDLESS))
    campaign = load_campaign(path, ExpansionOptions(repetitions=1))
    flown = fly(campaign, tmp_path / "out", act=lambda ray: ray.actors[0].die())
    (run,) = flown.summary.runs
    assert (run.verdict, flown.exit_code) == ("ERROR", 3)
    assert "has lost the worker" in run.reason
    assert events(flown.folder) == ["begun", "ordered", "lost"]
    # What flew on its own has landed, and flies no more: its folder is free.
    assert (flown.folder / "default/sim/1/log.jsonl").is_file()


def test_a_lost_node_keeps_a_campaign_from_nothing_that_others_fly(
    tmp_path: Path,
) -> None:
    lost = tmp_path / "lost"

    def lose_node(ray: FakeRay) -> None:
        ray.cpus = 0  # of the two places one is gone, and the other is taken
        ray.actors[1].die()
        lost.touch()

    # Both runs wait until the node of one is lost, and neither ends soon after that.
    path = write_hover(tmp_path, waits_for=lost)
    longer = "autonomy: {use: still.py:Still, with: {ticks: 1200}}"
    path.write_text(path.read_text().replace("autonomy: still.py:Still", longer))
    campaign = load_campaign(path, ExpansionOptions(repetitions=4))
    began_s = time.monotonic()
    flown = fly(campaign, tmp_path / "out", act=lose_node, workers=2, jobs=2)
    # It was waited for a place for the lost one's successor, for five minutes.
    assert time.monotonic() - began_s < HIRED_S / 2
    verdicts = sorted(run.verdict for run in flown.summary.runs)
    assert (verdicts, flown.exit_code) == (["ERROR", "PASS", "PASS", "PASS"], 3)
    assert sorted(events(flown.folder)) == ["begun", *["ended"] * 3, "lost", *["ordered"] * 4]


def test_a_cluster_with_fewer_places_flies_fewer_at_once_and_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ray, said = FakeRay(MortalAgent, 1), list[str]()

    @contextmanager
    def running(address: str | None, *, cpus: int) -> Iterator[FakeRay]:
        yield ray

    monkeypatch.setattr(ray_engine, "running_ray", running)
    store = open_store(tmp_path.as_uri())
    with ray_engine.ray_engine(
        "127.0.0.1:1", jobs=3, cores=1, store=store, say=said.append
    ) as engine:
        assert (len(engine.idle), engine.places) == (1, 3)
        engine.idle[0].actor.die()
    assert said[0] == (
        "the cluster has place for 1 of 3 runs at once, of 1 CPU each (here 1); the others fly as "
        "soon as there is place for them"
    )


def test_the_wait_for_a_full_cluster_is_reported_and_a_part_flies(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    node_facts()  # The first call takes its time, and is kept.
    monkeypatch.setattr(ray_agents, "HIRED_S", 3.0)
    ray, said = FakeRay(MortalAgent, 0), list[str]()
    monkeypatch.setattr(ray_agents, "REPORT_S", 0.1)
    with pytest.raises(EngineError, match="no place for 2 runs of 1 CPUs each within 3 s"):
        hire_agents(ray, 2, cores=1, say=said.append)
    (waiting,) = said
    assert waiting == (
        "a run waits for a worker with 1 CPU: its node is still loading wil-campaign, others "
        "have its place, or a node is missing; places: here 0; waiting up to 3 s"
    )
    assert all(actor.is_dead for actor in ray.actors)
    ray = FakeRay(QuickAgent, 1)
    (agent,) = hire_agents(ray, 2, cores=1, say=said.append)
    assert said[-1] == "1 of 2 runs have a place on the cluster and start"
    assert [actor.is_dead for actor in ray.actors] == [False, True]
    assert agent.node == node_facts()["node"]


def test_an_operator_reaches_the_run_on_its_node(tmp_path: Path) -> None:
    path = write_hover(tmp_path)
    path.write_text(path.read_text().replace("autonomy: still.py:Still", NEAR_ENDLESS))
    campaign = load_campaign(path)
    flown = fly(campaign, tmp_path / "out", act=lambda _: os.kill(os.getpid(), signal.SIGTERM))
    assert [run.verdict for run in flown.summary.runs] == ["ABORTED"]
    assert flown.exit_code == 130


def test_a_node_with_other_programs_is_refused_by_name_and_remedy() -> None:
    here = node_facts()
    assert unfit_text(here, here) == ""
    assert unfit_text(here, {**here, "node": "another"}) == ""
    assert unfit_text(here, {**here, "commit": "unknown commit"}) == ""  # its code is the same
    said = unfit_text(
        here, {**here, "node": "hall", "numpy": "1.0", "code": "0", "commit": "0f-dirty"}
    )
    assert "node hall" in said
    assert "numpy is 1.0" in said
    assert f"code of wil-campaign differs (0f-dirty, here it is {here['commit']})" in said
    assert "install the same wheel" in said
    assert "guards" in unfit_text(here, {**here, "subreaper": "1"})


def test_an_unfit_node_flies_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    ray = FakeRay(MortalAgent)
    monkeypatch.setattr(
        "wil_campaign.plugins.cluster.ray_agents.node_facts",
        lambda: {**node_facts(), "python": "2.7"},
    )
    with pytest.raises(EngineError, match=r"here it is 2\.7") as raised:
        hire_agents(ray, 1, cores=1)
    assert raised.value.code == 2
    ray.actors[0].made.wait()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("rai", "must be local, ray or ray://HOST:PORT"),
        ("ray://", "must be local"),
        ("ray://host", "must be local"),
        ("http://host:1", "must be local"),
        ("ray://10.0.0.1:6379", "needs a token"),
    ],
)
def test_an_unknown_engine_is_exit_2(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    text: str,
    said: str,
) -> None:
    monkeypatch.delenv("RAY_AUTH_MODE", raising=False)
    campaign = str(write_hover(tmp_path))
    out = tmp_path / "out"
    assert main(["run", campaign, "--engine", text, "--out", str(out)]) == 2
    assert said in capsys.readouterr().err.replace("\n", " ")
    assert not out.exists()


def test_addresses_of_clusters(monkeypatch: pytest.MonkeyPatch) -> None:
    assert engine_address("ray") is None
    assert engine_address("ray://127.0.0.1:6379") == "127.0.0.1:6379"
    monkeypatch.setenv("RAY_AUTH_MODE", "token")
    assert engine_address("ray://10.0.0.1:6379") == "10.0.0.1:6379"


def test_a_missing_extra_is_named_with_the_remedy(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "ray", None)
    for name in ("RAY_AUTH_MODE", "RAY_AUTH_TOKEN", "RAY_DEDUP_LOGS", "RAY_worker_niceness"):
        monkeypatch.setenv(name, "")
    assert main(["run", str(write_hover(tmp_path)), "--engine", "ray", "--out", str(tmp_path)]) == 2
    assert "pip install 'wil-campaign[cluster]'" in capsys.readouterr().err


def test_an_attached_vehicle_is_not_flown_over_a_cluster(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_hover(tmp_path)
    path.write_text(path.read_text().replace("link: embedded", "link: udpin://127.0.0.1:14999"))
    assert main(["run", str(path), "--engine", "ray", "--out", str(tmp_path)]) == 2
    assert "consent to arm" in capsys.readouterr().err


def test_a_node_with_other_plugins_of_others_does_not_fly(monkeypatch: pytest.MonkeyPatch) -> None:
    """An oracle of another version judges otherwise, and no file of the campaign differs."""
    monkeypatch.setattr(facts, "flown_plugins", lambda: {"lab": "wil-lab 1.2"})
    here = node_facts()
    for there, said in ({"lab": "wil-lab 1.1"}, "lab (wil-lab 1.1)"), ({}, "none"):
        monkeypatch.setattr(facts, "flown_plugins", partial(dict, there))
        found = unfit_text(here, node_facts())
        assert f"plugins is {said}, here it is lab (wil-lab 1.2)" in found
    assert unfit_text(node_facts(), node_facts()) == ""
