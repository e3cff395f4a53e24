"""A run whose node is lost: its result counts, or it is given up, and nothing flies it then."""

import os
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path

import pytest

from tests.orchestrator.conftest import NoCommands
from tests.orchestrator.hover import write_hover
from wil_campaign.campaigns.expansion.expansion import Options, load_campaign
from wil_campaign.orchestrator.campaign.folder.campaign_folder import OutputError, held_run
from wil_campaign.orchestrator.campaign.resuming.lost_runs import lost_result
from wil_campaign.orchestrator.campaign.workers import run_order
from wil_campaign.orchestrator.campaign.workers.run_workers import WorkerLost
from wil_campaign.orchestrator.model.document_writer import to_json
from wil_campaign.orchestrator.model.results_reader import read_result
from wil_campaign.orchestrator.state.run_setup import RunOrder
from wil_campaign.plugins.cluster import returned_results
from wil_campaign.plugins.cluster.node_process import _is_deserted
from wil_campaign.plugins.cluster.returned_results import SharedResults


@pytest.fixture
def order(tmp_path: Path) -> RunOrder:
    plan = load_campaign(write_hover(tmp_path), Options(repetitions=1)).runs[0]
    return RunOrder(plan=plan, folder=tmp_path / "out" / plan.name, clock="virtual")


def test_a_run_that_had_not_begun_is_given_up_to_a_new_start(
    order: RunOrder, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert SharedResults().of_lost(order, "") == "it had not begun"
    given_up = read_result(order.folder / "result.json")
    assert (given_up.verdict, "had not begun" in given_up.reason) == ("ERROR", True)
    monkeypatch.setattr(
        "wil_campaign.orchestrator.run.flight.run.fly", lambda *_: pytest.fail("it was flown")
    )
    with pytest.raises(OutputError, match="gave this run up"):
        run_order.fly_order(order, lambda _: None, NoCommands())
    assert read_result(order.folder / "result.json") == given_up


def test_a_run_that_was_finished_counts(order: RunOrder) -> None:
    order.folder.mkdir(parents=True)
    result = lost_result(order.plan, WorkerLost("as it is"), order.folder)
    (order.folder / "result.json").write_text(to_json(result))
    assert SharedResults().of_lost(order, "") == result


def test_a_run_in_flight_is_waited_for_and_not_given_up(
    order: RunOrder, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(returned_results, "LANDED_S", 0.4)
    order.folder.mkdir(parents=True)
    with held_run(order.folder):
        assert "still in flight" in str(SharedResults().of_lost(order, ""))
        assert not (order.folder / "result.json").exists()


def test_a_node_notices_that_its_cluster_is_gone_also_with_words_unread() -> None:
    reading, writing = os.pipe()
    commands, sender = Connection(reading, writable=False), Connection(writing, readable=False)
    assert not _is_deserted(commands)
    sender.send("an order")
    assert not _is_deserted(commands)
    sender.close()
    assert _is_deserted(commands)
    here, there = Pipe()
    there.close()
    assert _is_deserted(here)
