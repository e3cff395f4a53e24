"""An order is flown and its result written, also into a folder that somebody removed meanwhile."""

import os
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from mcap.reader import make_reader

from tests.orchestrator.conftest import NoCommands
from tests.orchestrator.hover import write_hover
from tests.orchestrator.recording.test_run_video import record
from wil_campaign.campaigns.expansion.expansion import ExpansionOptions, load_campaign
from wil_campaign.foundation.files.document_writer import to_json
from wil_campaign.foundation.files.documents import BadInput
from wil_campaign.orchestrator.campaign.folder.campaign_folder import OutputError
from wil_campaign.orchestrator.campaign.resuming.runs_without_result import lost_result
from wil_campaign.orchestrator.campaign.workers import run_order
from wil_campaign.orchestrator.campaign.workers.run_workers import WorkerLost
from wil_campaign.orchestrator.run_results.result_reader import read_result
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.orchestrator.state.run_setup import RunOrder, RunSetup
from wil_campaign.safety.model.oracle_results import Verdict


def test_a_result_is_written_though_somebody_removed_the_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = load_campaign(write_hover(tmp_path), ExpansionOptions(repetitions=1)).runs[0]
    result = lost_result(plan, WorkerLost("somebody removed the folder"), tmp_path)
    folder = tmp_path / "out" / plan.name

    def fly(_: RunSetup, *__: object) -> RunResult:
        assert folder.is_dir()
        shutil.rmtree(tmp_path / "out")
        return result

    monkeypatch.setattr("wil_campaign.orchestrator.run.flight.run.fly_one_run", fly)
    order = RunOrder(plan=plan, folder=folder, clock="virtual")
    flown = run_order.fly_order(order, lambda _: None, NoCommands())
    assert replace(flown, code={}) == result
    assert read_result(folder / "result.json") == flown


def test_an_autonomy_that_changes_the_folder_loses_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Recordings were sought where its process was by then, and its own module as well."""
    campaign = write_hover(tmp_path)
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path)
    plan = load_campaign(Path(campaign.name), ExpansionOptions(repetitions=1)).runs[0]
    result = lost_result(plan, WorkerLost("as it is"), tmp_path)
    setups: list[RunSetup] = []

    def fly(setup: RunSetup, *_: object) -> RunResult:
        setups.append(setup)
        os.chdir("elsewhere")
        return result

    monkeypatch.setattr("wil_campaign.orchestrator.run.flight.run.fly_one_run", fly)
    folder = Path("out") / plan.name
    order = RunOrder(plan=plan, folder=folder, clock="virtual", campaign=Path("out"))
    flown = run_order.fly_order(order, lambda _: None, NoCommands())
    assert read_result(tmp_path / folder / "result.json") == flown
    flown_order = setups[0].order
    assert flown_order.campaign == tmp_path / "out"
    assert all(path.is_absolute() for path in flown_order.plan.files.paths)


def test_a_run_completed_its_result_only_if_it_is_its_own(tmp_path: Path) -> None:
    plan, other = load_campaign(write_hover(tmp_path), ExpansionOptions(repetitions=2)).runs
    order = RunOrder(plan=plan, folder=tmp_path / "out", clock="virtual")
    assert run_order.completed_run(order) is None
    order.folder.mkdir()
    for flown, counts in ((other, False), (plan, True)):
        result = lost_result(flown, WorkerLost("as it is"), tmp_path)
        (order.folder / "result.json").write_text(to_json(result))
        assert run_order.completed_run(order) == (result if counts else None)
    (order.folder / "result.json").write_text("cut o")
    assert run_order.completed_run(order) is None


def test_an_order_whose_folder_has_a_result_is_not_flown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = load_campaign(write_hover(tmp_path), ExpansionOptions(repetitions=1)).runs[0]
    folder = tmp_path / "out" / plan.name
    folder.mkdir(parents=True)
    (folder / "result.json").write_text("given up")
    flown: list[object] = []
    monkeypatch.setattr(
        "wil_campaign.orchestrator.run.flight.run.fly_one_run", lambda *given: flown.append(given)
    )
    order = RunOrder(plan=plan, folder=folder, clock="virtual")
    with pytest.raises(OutputError, match="the campaign gave this run up"):
        run_order.fly_order(order, lambda _: None, NoCommands())
    assert not flown
    assert (folder / "result.json").read_text() == "given up"


def test_a_result_that_another_wrote_meanwhile_is_not_written_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As after a program on a machine whose locks this one does not see took the run over."""
    plan = load_campaign(write_hover(tmp_path), ExpansionOptions(repetitions=1)).runs[0]
    order = RunOrder(plan=plan, folder=tmp_path / "out" / plan.name, clock="virtual")

    def fly(*_: object) -> RunResult:
        (order.folder / "result.json").write_text("given up")
        return lost_result(plan, WorkerLost("as it is"), tmp_path)

    monkeypatch.setattr("wil_campaign.orchestrator.run.flight.run.fly_one_run", fly)
    with pytest.raises(OutputError, match="the campaign gave this run up"):
        run_order.fly_order(order, lambda _: None, NoCommands())
    assert (order.folder / "result.json").read_text() == "given up"


def fly_filmed(
    folder: Path, monkeypatch: pytest.MonkeyPatch, *, verdict: Verdict, repetition: int, video: str
) -> RunResult:
    """Fly an order whose flight leaves a recording of images and this verdict."""
    options = ExpansionOptions(repetitions=2, sets=(f"record.video={video}",))
    plan = load_campaign(write_hover(folder), options).runs[repetition - 1]
    order = RunOrder(plan=plan, folder=folder / "out", clock="virtual")

    def fly(*_: object) -> RunResult:
        record(order.folder, perceived="/mixed/front")
        lost = lost_result(plan, WorkerLost("as it is"), folder)
        return replace(lost, verdict=verdict, artifacts=("run.mcap",))

    monkeypatch.setattr("wil_campaign.orchestrator.run.flight.run.fly_one_run", fly)
    return run_order.fly_order(order, lambda _: None, NoCommands())


@pytest.mark.parametrize(
    ("flown", "is_made"),
    [
        (("failed", "PASS", 1), True),
        (("failed", "PASS", 2), False),
        (("failed", "FAIL", 2), True),
        (("failed", "INVALID", 2), True),
        (("always", "PASS", 2), True),
        (("never", "FAIL", 1), False),
    ],
)
def test_a_video_is_made_of_runs_that_failed_and_of_the_first(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    flown: tuple[str, Verdict, int],
    is_made: bool,
) -> None:
    video, verdict, repetition = flown
    result = fly_filmed(tmp_path, monkeypatch, verdict=verdict, repetition=repetition, video=video)
    out = tmp_path / "out"
    assert (out / "mixed.mp4").exists() is is_made
    assert result.artifacts == (("mixed.mp4", "run.mcap") if is_made else ("run.mcap",))
    assert read_result(out / "result.json") == result


def test_a_video_that_cannot_be_made_costs_no_result(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(*_: object, **__: object) -> bool:
        assert read_result(tmp_path / "out/result.json").verdict == "FAIL"
        raise MemoryError("a lot")

    monkeypatch.setattr("wil_campaign.orchestrator.recording.run_video.make_video", fail)
    result = fly_filmed(tmp_path, monkeypatch, verdict="FAIL", repetition=1, video="always")
    assert read_result(tmp_path / "out/result.json") == result
    assert capsys.readouterr().err == "mixed.mp4 was not made: MemoryError: a lot\n"


def fly_recorded_also(folder: Path, monkeypatch: pytest.MonkeyPatch) -> RunResult:
    """Fly an order whose recording is to be a bag, too."""
    options = ExpansionOptions(repetitions=1, sets=("record={video: never, also: [ros2]}",))
    plan = load_campaign(write_hover(folder), options).runs[0]
    order = RunOrder(plan=plan, folder=folder / "out", clock="virtual")

    def fly(*_: object) -> RunResult:
        record(order.folder, perceived="/mixed/front")
        return replace(lost_result(plan, WorkerLost("as it is"), folder), artifacts=("run.mcap",))

    monkeypatch.setattr("wil_campaign.orchestrator.run.flight.run.fly_one_run", fly)
    return run_order.fly_order(order, lambda _: None, NoCommands())


def test_a_recording_is_written_in_a_form_of_other_tools_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    result = fly_recorded_also(tmp_path, monkeypatch)
    assert result.artifacts == ("ros2.mcap", "run.mcap")
    assert read_result(tmp_path / "out/result.json") == result
    with (tmp_path / "out/ros2.mcap").open("rb") as stream:
        assert make_reader(stream).get_header().profile == "ros2"


def test_a_form_of_other_tools_that_cannot_be_written_costs_no_result(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(*_: object) -> str:
        raise OSError("the disk is full")

    monkeypatch.setattr("wil_campaign.plugins.ros2.bags.bag_file_of_run.write", fail)
    result = fly_recorded_also(tmp_path, monkeypatch)
    assert result.artifacts == ("run.mcap",)
    assert capsys.readouterr().err == (
        "the recording as ros2 was not made: OSError: the disk is full\n"
    )


def test_a_form_that_nobody_writes_is_refused(tmp_path: Path) -> None:
    options = ExpansionOptions(sets=("record.also=[ros1]",))
    with pytest.raises(BadInput, match="ros2"):
        load_campaign(write_hover(tmp_path), options)
