"""An order is flown and its result written, also into a folder that somebody removed meanwhile."""

import shutil
from pathlib import Path

import pytest

from campaigns.expansion.expansion import Options, load_campaign
from orchestrator.campaign.folder.campaign_folder import OutputError
from orchestrator.campaign.resuming.lost_runs import lost_result
from orchestrator.campaign.workers import run_order
from orchestrator.campaign.workers.run_workers import WorkerLost
from orchestrator.model.document_writer import to_json
from orchestrator.model.results import RunResult
from orchestrator.model.results_reader import read_result
from orchestrator.state.run_setup import RunOrder, RunSetup
from tests.orchestrator.conftest import NoCommands
from tests.orchestrator.hover import write_hover


def test_a_result_is_written_though_somebody_removed_the_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = load_campaign(write_hover(tmp_path), Options(repetitions=1)).runs[0]
    result = lost_result(plan, WorkerLost("somebody removed the folder"))
    folder = tmp_path / "out" / plan.name

    def fly(_: RunSetup, *__: object) -> RunResult:
        assert folder.is_dir()
        shutil.rmtree(tmp_path / "out")
        return result

    monkeypatch.setattr("orchestrator.run.flight.run.fly", fly)
    order = RunOrder(plan=plan, folder=folder, clock="virtual")
    assert run_order.fly_order(order, lambda _: None, NoCommands()) == result
    assert read_result(folder / "result.json") == result


def test_a_run_completed_its_result_only_if_it_is_its_own(tmp_path: Path) -> None:
    plan, other = load_campaign(write_hover(tmp_path), Options(repetitions=2)).runs
    order = RunOrder(plan=plan, folder=tmp_path / "out", clock="virtual")
    assert run_order.completed_run(order) is None
    order.folder.mkdir()
    for flown, counts in ((other, False), (plan, True)):
        result = lost_result(flown, WorkerLost("as it is"))
        (order.folder / "result.json").write_text(to_json(result))
        assert run_order.completed_run(order) == (result if counts else None)
    (order.folder / "result.json").write_text("cut o")
    assert run_order.completed_run(order) is None


def test_an_order_whose_folder_has_a_result_is_not_flown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = load_campaign(write_hover(tmp_path), Options(repetitions=1)).runs[0]
    folder = tmp_path / "out" / plan.name
    folder.mkdir(parents=True)
    (folder / "result.json").write_text("given up")
    flown: list[object] = []
    monkeypatch.setattr("orchestrator.run.flight.run.fly", lambda *given: flown.append(given))
    order = RunOrder(plan=plan, folder=folder, clock="virtual")
    with pytest.raises(OutputError, match="the campaign gave this run up"):
        run_order.fly_order(order, lambda _: None, NoCommands())
    assert not flown
    assert (folder / "result.json").read_text() == "given up"


def test_a_result_that_another_wrote_meanwhile_is_not_written_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As after a program on a machine whose locks this one does not see took the run over."""
    plan = load_campaign(write_hover(tmp_path), Options(repetitions=1)).runs[0]
    order = RunOrder(plan=plan, folder=tmp_path / "out" / plan.name, clock="virtual")

    def fly(*_: object) -> RunResult:
        (order.folder / "result.json").write_text("given up")
        return lost_result(plan, WorkerLost("as it is"))

    monkeypatch.setattr("orchestrator.run.flight.run.fly", fly)
    with pytest.raises(OutputError, match="the campaign gave this run up"):
        run_order.fly_order(order, lambda _: None, NoCommands())
    assert (order.folder / "result.json").read_text() == "given up"
