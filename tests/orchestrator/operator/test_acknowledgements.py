"""Who has acknowledged a command, by node and bench, and commands for one of those alone."""

from pathlib import Path

import pytest

from tests.orchestrator.operator.controllers import FakeFleet, make_controller
from wil_campaign.orchestrator.operator.campaign_controller import CampaignController
from wil_campaign.orchestrator.operator.run_messages import (
    FlightPlace,
    RunEventReport,
    RunProgressReport,
)
from wil_campaign.orchestrator.run_results.run_result import RunResult, SyncResult
from wil_campaign.safety.guard.core.operator_command import OperatorCommand
from wil_campaign.safety.guard.operator.operator_lines import RefusedLineError, parse_line

FIRST, HALL = FlightPlace("first"), FlightPlace("hall-pc", "hall-a")


@pytest.fixture
def fleet() -> FakeFleet:
    return FakeFleet(flying=2)


@pytest.fixture
def controller(tmp_path: Path, fleet: FakeFleet) -> CampaignController:
    controller = make_controller(tmp_path, fleet)
    for number, place in ((1, FIRST), (2, HALL)):
        controller.begun(f"large/wil/{number}", place)
        controller.news(
            RunProgressReport("large", "wil", number, "goal", 12.0, verdict_so_far="PASS")
        )
    return controller


def acknowledge(controller: CampaignController, run: str, command: OperatorCommand) -> None:
    controller.news(
        RunEventReport(
            run, 13.0, "acknowledged", command.kind, "", "", command.command_id, command.who
        )
    )


def aborted(number: int) -> RunResult:
    return RunResult(
        case="large",
        mode="wil",
        rep=number,
        seed=1,
        verdict="ABORTED",
        reason="",
        also=(),
        required=True,
        duration_s=None,
        wall_s=0.0,
        oracles=(),
        sync=SyncResult(),
        mixing=None,
    )


def test_a_command_is_acknowledged_run_by_run_with_its_place(
    controller: CampaignController, fleet: FakeFleet
) -> None:
    assert controller.status()["acknowledged"] is None
    controller.obey(OperatorCommand("hold", "anna"))
    (sent,) = fleet.told
    acknowledge(controller, "large/wil/2", sent)
    acknowledge(controller, "large/wil/1", OperatorCommand("hold", "anna", command_id="an older"))
    assert controller.status()["acknowledged"] == {
        "command": "hold",
        "who": "anna",
        "by": {"large/wil/2": "bench hall-a on hall-pc"},
        "waiting": {"large/wil/1": "first"},
    }
    controller.finished(aborted(1), may_end=False)  # who has landed is waited for no more
    assert controller.status()["acknowledged"]["waiting"] == {}


def test_the_status_shows_each_flying_run_with_its_node_and_bench(
    controller: CampaignController,
) -> None:
    flying = controller.status()["flying"]
    assert {run: one["place"] for run, one in flying.items()} == {
        "large/wil/1": "first",
        "large/wil/2": "bench hall-a on hall-pc",
    }


@pytest.mark.parametrize("where", [{"node": "hall-pc"}, {"bench": "hall-a"}])
def test_an_abort_by_node_or_bench_leaves_the_others_flying(
    controller: CampaignController, fleet: FakeFleet, where: dict[str, str]
) -> None:
    said = controller.obey(OperatorCommand("abort", "anna", **where))
    assert said.startswith("1 run on ")
    (sent,) = fleet.aborted
    assert (sent.node, sent.bench) == (where.get("node", ""), where.get("bench", ""))
    assert controller.status()["acknowledged"]["waiting"] == {
        "large/wil/2": "bench hall-a on hall-pc"
    }
    controller.finished(aborted(2))
    assert len(fleet.aborted) == 1  # the rest of the campaign is not aborted
    assert (controller.stopped, controller.ended_by) == (None, "command")
    # An abort of all is still one.
    controller.obey(OperatorCommand("abort", "anna"))
    assert controller.stopped == "command"


def test_an_abort_where_nothing_flies_is_refused_with_the_places_that_there_are(
    controller: CampaignController, fleet: FakeFleet
) -> None:
    with pytest.raises(
        RefusedLineError, match="node desk; nodes and benches with runs: bench hall-a on hall-pc"
    ):
        controller.obey(OperatorCommand("abort", "anna", node="desk"))
    assert not fleet.aborted
    assert controller.ended_by is None


@pytest.mark.parametrize(
    ("node", "bench", "meant"),
    [("", "", True), ("hall-pc", "", True), ("", "hall-a", True), ("first", "hall-a", False)],
)
def test_a_command_means_a_place_by_its_node_or_bench(node: str, bench: str, meant: bool) -> None:
    assert HALL.is_meant(node=node, bench=bench) is meant


def test_a_line_has_node_and_bench_for_an_abort_alone() -> None:
    line = b'{"command": "abort", "node": "desk", "who": "anna"}'
    assert parse_line(line) == OperatorCommand("abort", "anna", node="desk")
    for bad, said in (
        (b'{"command": "hold", "node": "desk"}', "allowed with abort only"),
        (b'{"command": "abort", "bench": 1}', "must be texts"),
        (b'{"command": "abort", "node": "\\ud800"}', "texts of whole characters"),
        (b'{"command": "geofence", "geofence": "\\ud800", "id": "1"}', "texts of whole characters"),
    ):
        with pytest.raises(RefusedLineError, match=said):
            parse_line(bad)
