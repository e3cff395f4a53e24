"""A bench of a cluster: how it is announced and awaited, its gate, and who is refused."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from tests.orchestrator.hover import write_hover
from wil_campaign.campaigns.expansion.expansion import (
    Campaign,
    ExpansionOptions,
    load_campaign,
    requested_bench,
)
from wil_campaign.campaigns.setup.bench_file import Bench, BenchFacts, load_benches
from wil_campaign.campaigns.setup.bench_resolution import bench_departure
from wil_campaign.foundation.files.documents import BadInput, parse_document
from wil_campaign.orchestrator.campaign.folder.bench_lock import held_benches
from wil_campaign.orchestrator.campaign.folder.campaign_folder import FolderTakenError
from wil_campaign.orchestrator.cli import main
from wil_campaign.orchestrator.state.run_setup import RunOrder
from wil_campaign.plugins.cluster.bench.bench_engine import await_bench_of_cluster
from wil_campaign.plugins.cluster.bench.bench_resources import (
    announced_benches,
    announced_resources,
)
from wil_campaign.plugins.cluster.bench.bench_server import BenchGate
from wil_campaign.plugins.cluster.node_messages import ConsentAsked, RunOrdered

# A busy machine, which may hold up the positions, is no fault in them.
BENCH = """\
schema: wil/bench/1
bench: hall-a
properties: {indoor: true, net: "3 m, fine"}
vehicles:
  real:
    link: "udpin://127.0.0.1:%d"
    autopilot: px4
    telemetry: {max_gap_s: 10}
geofence: {box: {north_m: [-9, 9], east_m: [-9, 9], up_m: [-2, 5]}}
"""
ASKING = {
    "vehicles: {twin: {link: embedded, autopilot: px4}}": (
        "bench: hall-a\nvehicles: {}\nretries: 2\npreflight: {failsafe: set}"
    ),
    "autonomy: still.py:Still": "autonomy: {use: still.py:Still, with: {ticks: 40}}",
    "modes: [sim]": "modes: [real]",
    "oracles: {landed: {}}": "oracles: {landed: {}, geofence: {}}",
}
PLACE = "anna on desk"


def write_campaign(folder: Path, *, ticks: int = 40) -> Path:
    path = write_hover(folder)
    text = path.read_text()
    for old, new in ASKING.items():
        assert old in text
        text = text.replace(old, new)
    path.write_text(text.replace("ticks: 40", f"ticks: {ticks}"))
    return path


def write_bench(folder: Path, port: int = 14540) -> Bench:
    path = folder / "hall-a.yaml"
    path.write_text(BENCH % port)
    (bench,) = load_benches((path,))
    return bench


def node(facts: BenchFacts, *, alive: bool = True, name: str = "hall") -> dict[str, Any]:
    return {
        "Alive": alive,
        "Resources": {"CPU": 0.0, "node:10.0.0.2": 1.0, **announced_resources(facts)},
        "NodeManagerHostname": name,
    }


def test_a_node_announces_its_bench_with_all_its_properties(tmp_path: Path) -> None:
    facts = write_bench(tmp_path).facts
    assert not any("," in name for name in announced_resources(facts))  # Ray splits its list there
    (found,) = announced_benches([node(facts), node(facts, alive=False, name="gone")])
    assert (found.facts, found.node) == (facts, "hall")


class Nodes:
    """A cluster in which a bench is missing at first."""

    def __init__(self, *looks: list[dict[str, Any]]) -> None:
        self._looks = list(looks)

    def nodes(self) -> list[dict[str, Any]]:
        return self._looks.pop(0) if len(self._looks) > 1 else self._looks[0]


def test_a_bench_is_waited_for_named_when_missing_and_refused_when_there_twice(
    tmp_path: Path,
) -> None:
    path, facts = write_campaign(tmp_path), write_bench(tmp_path).facts
    asked = requested_bench(path, ExpansionOptions(sets=("bench={name: hall-a, wait_s: 0.2}",)))
    assert asked is not None
    other = BenchFacts("hall-b", facts.properties)
    shown: list[str] = []
    there = [node(facts)]
    assert await_bench_of_cluster(Nodes([], there), *asked, shown.append) == "hall-a"
    assert shown == ["waiting up to 0.2 s for the bench; the cluster has none"]
    with pytest.raises(BadInput, match=r"no bench 'hall-a'; there is hall-b .*, after 0\.2 s"):
        await_bench_of_cluster(Nodes([node(other)]), *asked, shown.append)
    with pytest.raises(BadInput, match="two benches named 'hall-a', on hall and shed"):
        await_bench_of_cluster(Nodes([*there, node(facts, name="shed")]), *asked, shown.append)


def order_of(campaign: Campaign, folder: Path, *, arm: bool = True) -> RunOrder:
    plan = campaign.plans[0]
    return RunOrder(plan=plan, folder=folder / plan.name, clock="wall", arm=arm)


def test_the_gate_of_a_bench_passes_the_consented_runs_and_no_more(tmp_path: Path) -> None:
    path, bench = write_campaign(tmp_path), write_bench(tmp_path)
    order = RunOrdered(
        order_of(load_campaign(path, ExpansionOptions(benches=(bench,))), tmp_path), "a"
    )
    gate = BenchGate(bench)
    assert "nobody at bench hall-a has consented" in gate.refusal(order)
    gate.open_for(ConsentAsked("hover", 2, arm=True, place=PLACE))
    assert [gate.refusal(order) for _ in range(2)] == ["", ""]
    assert "has consent for 2 runs, not more" in gate.refusal(order)
    gate.open_for(ConsentAsked("hover", 2, arm=False, place=PLACE))
    assert "has consent for a campaign that does not arm" in gate.refusal(order)
    assert gate.refusal(RunOrdered(replace(order.order, arm=False), "a")) == ""


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            "127.0.0.1:14540",
            "127.0.0.1:14999",
            "vehicles.real.link differs from that of bench hall-a",
        ),
        ("up_m: [-2, 5]", "up_m: [-2, 500]", "geofence differs from that of bench hall-a"),
    ],
)
def test_the_gate_of_a_bench_knows_its_vehicle_and_its_fence(
    tmp_path: Path, old: str, new: str, said: str
) -> None:
    path, bench = write_campaign(tmp_path), write_bench(tmp_path)
    (tmp_path / "other.yaml").write_text((BENCH % 14540).replace(old, new))
    other = load_benches((tmp_path / "other.yaml",))
    gate = BenchGate(bench)
    gate.open_for(ConsentAsked("hover", 9, arm=True, place=PLACE))
    campaign = load_campaign(path, ExpansionOptions(benches=other))
    assert gate.refusal(RunOrdered(order_of(campaign, tmp_path), "a")) == said


def test_the_gate_of_a_bench_passes_no_attached_actor(tmp_path: Path) -> None:
    path, bench = write_campaign(tmp_path), write_bench(tmp_path)
    order = order_of(load_campaign(path, ExpansionOptions(benches=(bench,))), tmp_path)
    data = order.plan.files.campaign.data
    assert isinstance(data, dict)
    for link, said in (
        ("udpin://0.0.0.0:14560", "actors.ghost.link is udpin://0.0.0.0:14560: a bench has one"),
        ("embedded", ""),
    ):
        text = json.dumps({**data, "actors": {"ghost": {"link": link, "autopilot": "px4"}}})
        document = parse_document(text.encode(), name=str(path))
        assert bench_departure(document, bench).startswith(said)
        assert bool(bench_departure(document, bench)) is bool(said)


def test_a_bench_is_flown_on_by_one_program_at_a_time(tmp_path: Path) -> None:
    bench = write_bench(tmp_path)
    with (
        held_benches((bench,)),
        pytest.raises(FolderTakenError, match="bench hall-a is in use"),
        held_benches((bench,)),
    ):
        pass
    with held_benches((bench,)):
        pass


def test_a_bench_that_cannot_be_served_or_reached_is_exit_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, bench = write_campaign(tmp_path), write_bench(tmp_path)
    file = str(bench.document.path)
    assert main(["bench", "serve", file, "--engine", "ray://127.0.0.1:6379"]) == 2
    assert "bench serve needs a terminal" in capsys.readouterr().err
    assert main(["run", str(path), "--engine", "ray"]) == 2
    assert "a Ray of this machine alone has no benches" in capsys.readouterr().err
    assert main(["run", str(path), "--engine", "ray://127.0.0.1:1", "--bench-file", file]) == 2
    assert "a cluster has its own benches" in capsys.readouterr().err
    assert main(["bench", "check", file, file]) == 2
    assert "is another bench named 'hall-a'" in capsys.readouterr().err
    assert main(["bench", "check", file]) == 0
    assert "bench hall-a (autopilot: px4, indoor: true, net: 3 m" in capsys.readouterr().out
    assert requested_bench(write_hover(tmp_path), ExpansionOptions()) is None
