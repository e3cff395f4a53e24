"""The desk: what becomes of commands, and who is told."""

import asyncio
import json
import os
import socket
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from tests.orchestrator.operator.controllers import FakeFleet, make_controller
from wil_campaign.orchestrator.operator.campaign_controller import CampaignController
from wil_campaign.orchestrator.operator.campaign_records import (
    CampaignRecord,
    OperatorPlace,
    OperatorPlaces,
    operator_places,
)
from wil_campaign.orchestrator.operator.errors import OperatingError
from wil_campaign.orchestrator.operator.local_commands import send_command
from wil_campaign.orchestrator.operator.operator_channels import open_operator_channels
from wil_campaign.orchestrator.operator.run_messages import FlightPlace, RunProgressReport
from wil_campaign.orchestrator.run_results.run_result import RunResult, SyncResult
from wil_campaign.safety.guard.core.operator_command import OperatorCommand
from wil_campaign.safety.guard.operator.operator_lines import RefusedLineError

ABORT = OperatorCommand("abort", "anna")
HOLD = OperatorCommand("hold", "anna")
RESUME = OperatorCommand("resume", "anna")
RESULT = RunResult(
    case="large",
    mode="wil",
    rep=1,
    seed=1,
    verdict="PASS",
    reason="",
    also=(),
    required=True,
    duration_s=None,
    wall_s=0.0,
    oracles=(),
    sync=SyncResult(),
    mixing=None,
)


def log(folder: Path) -> list[tuple[str, str, bool]]:
    lines = map(json.loads, (folder / "operator.jsonl").read_text("utf-8").splitlines())
    return [(line["command"], line["who"], line["ok"]) for line in lines]


def test_abort_wins_and_is_reported_once(tmp_path: Path) -> None:
    fleet = FakeFleet()
    said: list[str] = []
    controller = make_controller(tmp_path, fleet, said=said)
    controller.obey(HOLD)
    controller.obey(ABORT)
    assert (controller.stopped, controller.held) == ("command", False)
    assert [(one.kind, one.who) for one in fleet.aborted] == [("abort", "anna")]
    assert controller.obey(ABORT) == "all vehicles are landing already"
    for command in (HOLD, RESUME):
        with pytest.raises(RefusedLineError, match="landing already"):
            controller.obey(command)
    assert log(tmp_path) == [
        ("hold", "anna", True),
        ("abort", "anna", True),
        ("abort", "anna", True),
        ("hold", "anna", False),
        ("resume", "anna", False),
    ]
    assert said[0].startswith("hold by anna: held: 1 run in flight")


def test_nothing_is_begun_while_held(tmp_path: Path) -> None:
    fleet = FakeFleet(flying=2)
    controller = make_controller(tmp_path, fleet)
    with pytest.raises(RefusedLineError, match="no vehicle holds"):
        controller.obey(RESUME)
    assert controller.obey(HOLD) == "held: 2 runs in flight; no run is started"
    assert not fleet.going
    with pytest.raises(RefusedLineError, match="all vehicles hold already"):
        controller.obey(HOLD)
    controller.obey(RESUME)
    assert fleet.going
    assert [one.kind for one in fleet.told] == ["hold", "resume"]
    assert len({one.command_id for one in fleet.told} - {""}) == 2  # by which runs acknowledge


def test_a_signal_aborts_and_counts_as_a_signal(tmp_path: Path) -> None:
    fleet = FakeFleet()
    said: list[str] = []
    controller = make_controller(tmp_path, fleet, said=said)
    controller.signal("Ctrl-C")
    controller.signal("Ctrl-C")
    assert controller.stopped == "signal"
    assert [command.who for command in fleet.aborted] == ["Ctrl-C"]
    assert said[-1] == "still landing; the program ends when the vehicles are down"


def test_a_run_that_a_pilot_ended_ends_the_campaign(tmp_path: Path) -> None:
    fleet = FakeFleet()
    controller = make_controller(tmp_path, fleet)
    controller.news(RunProgressReport("large", "wil", 1, "goal", 12.0, verdict_so_far="PASS"))
    assert list(controller.status()["flying"]) == ["large/wil/1"]
    controller.finished(RESULT)
    assert controller.stopped is None
    assert controller.status()["flying"] == {}
    controller.finished(replace(RESULT, rep=2, verdict="ABORTED", reason="the pilot has control"))
    assert controller.stopped == "command"
    assert fleet.aborted[0].who == "large/wil/2 (the pilot has control)"
    assert controller.status()["finished"] == {"large/wil/1": "PASS", "large/wil/2": "ABORTED"}


def test_an_abort_of_a_bench_between_two_of_its_runs_bars_the_next(tmp_path: Path) -> None:
    """While a person at the bench puts the vehicle back nothing flies there, but more will."""
    fleet = FakeFleet()
    controller = make_controller(tmp_path, fleet)
    hall = replace(ABORT, bench="hall")
    with pytest.raises(RefusedLineError, match="no run flies on bench hall"):
        controller.obey(hall)
    controller.begun("large/wil/1", FlightPlace("desk", "hall"))
    controller.finished(RESULT)
    assert controller.obey(hall) == (
        "0 runs on bench hall will land, and no further run is flown there"
    )
    assert [(one.kind, one.bench) for one in fleet.aborted] == [("abort", "hall")]
    assert (controller.stopped, controller.ended_by) == (None, "command")
    assert controller.acknowledged is not None
    assert controller.acknowledged.command.bench == "hall"
    with pytest.raises(RefusedLineError, match="attic; nodes and benches with runs: bench hall on"):
        controller.obey(replace(ABORT, bench="attic"))


def test_a_log_that_cannot_be_written_does_not_keep_an_abort(tmp_path: Path) -> None:
    fleet = FakeFleet()
    make_controller(tmp_path / "gone", fleet).obey(ABORT)
    assert [one.kind for one in fleet.aborted] == ["abort"]


def left(folder: Path) -> list[Path]:
    return list(folder.iterdir())


@pytest.fixture
def runtime(short_folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(short_folder))
    return short_folder / "wil-campaign"


async def test_a_campaign_says_on_its_machine_that_it_flies(tmp_path: Path, runtime: Path) -> None:
    controller = make_controller(tmp_path, FakeFleet())
    async with open_operator_channels(controller):
        (place,) = operator_places().campaigns
        assert (place.name, place.folder) == ("gate", tmp_path)
        assert place.socket.stat().st_mode & 0o777 == 0o600
        assert operator_places().beneath(tmp_path.parent).campaigns == (place,)
        assert operator_places().beneath(tmp_path / "large").campaigns == (place,)
        assert operator_places().beneath(tmp_path.parent / "other").campaigns == ()
    assert operator_places().campaigns == ()
    assert left(runtime) == []


async def test_a_campaign_is_found_by_any_name_of_its_folder(
    tmp_path: Path, runtime: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A shell in a folder behind a link has another name for it than the one that was given."""
    (tmp_path / "disk" / "gate").mkdir(parents=True)
    link = tmp_path / "results"
    link.symlink_to("disk")
    for given in (link / "gate", tmp_path / "disk" / ".." / "results" / "gate"):
        async with open_operator_channels(make_controller(given, FakeFleet())):
            (place,) = operator_places().campaigns
            guard = OperatorPlace("1", given / "1", given / "1.sock", campaign=given)
            flying = OperatorPlaces(
                (place,), (guard, replace(guard, folder=tmp_path / "x", campaign=None))
            )
            for other in (tmp_path / "disk" / "gate", link, tmp_path / "disk" / "gate" / "1"):
                assert flying.beneath(other) == OperatorPlaces((place,), (guard,)), (given, other)
            monkeypatch.chdir(link / "gate")
            assert flying.beneath(Path()) == OperatorPlaces((place,), (guard,))
            assert flying.beneath(tmp_path / "x") == OperatorPlaces((), (flying.guards[1],))


def change_process(runtime: Path, pid: int) -> Path:
    """Let the one record of a campaign name another process; return its socket."""
    (path,) = runtime.glob("campaign-*.json")
    document = json.loads(path.read_text())
    path.write_text(json.dumps(document | {"process": {"pid": pid, "started": 1}}))
    return Path(document["socket"])


def test_records_of_a_killed_campaign_are_removed(tmp_path: Path, runtime: Path) -> None:
    CampaignRecord(name="gate", folder=tmp_path).__enter__()
    with socket.socket(socket.AF_UNIX) as end:
        end.bind(str(change_process(runtime, os.getpid())))
    assert operator_places().campaigns == ()
    assert left(runtime) == []


@pytest.mark.usefixtures("runtime")
@pytest.mark.parametrize("has_ended", [True, False])
def test_an_abort_spares_a_program_whose_flights_have_just_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *, has_ended: bool
) -> None:
    """It was killed while it wrote its report; one that lost only its socket still gets SIGTERM."""
    killed: list[int] = []
    monkeypatch.setattr(os, "kill", lambda pid, _: killed.append(pid))
    with CampaignRecord(name="gate", folder=tmp_path):
        flying = operator_places()
        if not has_ended:
            replies = list(send_command(flying, "abort", "anna"))
    if has_ended:
        replies = list(send_command(flying, "abort", "anna"))
        assert [(reply.ok, reply.text) for reply in replies] == [
            (True, "gate: its flights are over")
        ]
    assert not all(reply.ok for reply in replies) or has_ended
    assert killed == ([] if has_ended else [os.getpid()])


async def test_a_campaign_of_a_container_that_shares_the_folder_is_found_and_lands(
    tmp_path: Path, runtime: Path
) -> None:
    """Its process ids mean nothing here: it was taken for killed, and its socket removed."""
    controller = make_controller(tmp_path, fleet := FakeFleet())
    async with open_operator_channels(controller):
        path = change_process(runtime, 4194303)
        (place,) = operator_places().campaigns
        assert (place.socket, place.process) == (path, None)
        replies = await asyncio.to_thread(
            lambda: list(send_command(operator_places(), "abort", "anna"))
        )
        assert [reply.ok for reply in replies] == [True]
    assert [command.who for command in fleet.aborted] == ["anna"]


@pytest.fixture
def unsafe(runtime: Path, short_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No place for sockets is ours alone."""
    monkeypatch.setenv("HOME", str(short_folder))
    for folder in (runtime, short_folder / ".local" / "state" / "wil-campaign" / "run"):
        folder.mkdir(parents=True)
        folder.chmod(0o755)


@pytest.mark.usefixtures("unsafe")
async def test_an_unsafe_folder_for_sockets_is_reported(tmp_path: Path) -> None:
    said = r"the operator socket cannot be opened: no safe folder .* \(mode 0755\)"
    with pytest.raises(OperatingError, match=said):
        async with open_operator_channels(make_controller(tmp_path, FakeFleet())):
            pass


class Listener(threading.Thread):
    """A guard's socket that hears one line and never answers: it may be stopped."""

    def __init__(self, path: Path) -> None:
        super().__init__(daemon=True)
        import socket

        self.end = socket.socket(socket.AF_UNIX)
        self.end.bind(str(path))
        self.end.listen()
        self.heard = b""

    def run(self) -> None:
        peer, _ = self.end.accept()
        with peer:
            self.heard = peer.recv(1000)
        self.end.close()


@pytest.fixture
def listener(short_folder: Path) -> Iterator[Listener]:
    made = Listener(short_folder / "guard.sock")
    made.start()
    yield made
    made.join(5.0)


def test_an_abort_goes_straight_to_the_guards(
    tmp_path: Path, short_folder: Path, listener: Listener
) -> None:
    controller = make_controller(tmp_path, FakeFleet())
    gone = OperatorPlace("gone", tmp_path, short_folder / "gone.sock")
    controller.guards = lambda: (
        gone,
        OperatorPlace("large/wil/1", tmp_path, short_folder / "guard.sock"),
    )
    controller.obey(ABORT)
    listener.join(5.0)
    assert json.loads(listener.heard) == {"command": "abort", "who": "anna"}


def test_an_abort_reaches_the_runs_before_anyone_looks_for_guards(tmp_path: Path) -> None:
    """The folders of guards may be on a network that does not answer."""
    fleet = FakeFleet()
    controller = make_controller(tmp_path, fleet)
    aborted_before: list[bool] = []
    answers, looked = threading.Event(), threading.Event()

    def guards() -> tuple[OperatorPlace, ...]:
        aborted_before.append(bool(fleet.aborted))
        answers.wait(60.0)
        looked.set()
        return ()

    controller.guards = guards
    obeying = threading.Thread(target=controller.obey, args=(ABORT,), daemon=True)
    obeying.start()
    obeying.join(30.0)
    has_returned = not obeying.is_alive()
    answers.set()
    assert looked.wait(60.0)
    assert aborted_before == [True]
    assert has_returned
    assert controller.stopped == "command"


def with_guard(folder: Path, fleet: FakeFleet, short_folder: Path) -> CampaignController:
    """Return a controller of a run whose guard has the socket of `listener`."""
    controller = make_controller(folder, fleet)
    controller.guards = lambda: (OperatorPlace("large/wil/1", folder, short_folder / "guard.sock"),)
    return controller


def test_an_abort_needs_no_thread(
    tmp_path: Path, short_folder: Path, listener: Listener, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A system that starts no thread lands the vehicles all the same, and tells the guards."""
    fleet = FakeFleet()
    controller = with_guard(tmp_path, fleet, short_folder)

    def refuse(thread: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    with monkeypatch.context() as patch:
        patch.setattr(threading.Thread, "start", refuse)
        assert controller.obey(ABORT).startswith("all vehicles land")
    assert [one.kind for one in fleet.aborted] == ["abort"]
    assert controller.stopped == "command"
    listener.join(5.0)
    assert json.loads(listener.heard) == {"command": "abort", "who": "anna"}
    controller.obey(ABORT)
    assert log(tmp_path) == [("abort", "anna", True)] * 2


def test_an_abort_that_fails_reaches_the_guards_and_can_be_given_again(
    tmp_path: Path, short_folder: Path, listener: Listener, monkeypatch: pytest.MonkeyPatch
) -> None:
    fleet = FakeFleet()
    controller = with_guard(tmp_path, fleet, short_folder)

    def fail(command: OperatorCommand) -> None:
        raise ValueError("filedescriptor out of range in select()")

    with monkeypatch.context() as patch:
        patch.setattr(fleet, "abort", fail)
        with pytest.raises(ValueError, match="filedescriptor"):
            controller.obey(ABORT)
    listener.join(5.0)
    assert json.loads(listener.heard) == {"command": "abort", "who": "anna"}
    assert controller.stopped is None
    controller.signal("Ctrl-C")
    assert [one.who for one in fleet.aborted] == ["Ctrl-C"]
