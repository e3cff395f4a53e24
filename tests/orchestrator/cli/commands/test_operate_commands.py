"""`wil-campaign abort | hold | resume | watch`, against a campaign controller in this process."""

import asyncio
import io
import json
from collections.abc import AsyncIterator, Awaitable, Callable
from dataclasses import replace
from pathlib import Path

import pytest

from tests.orchestrator.operator.controllers import FakeFleet, make_controller, silent_place
from wil_campaign.orchestrator.cli import main
from wil_campaign.orchestrator.operator.campaign_controller import CampaignController
from wil_campaign.orchestrator.operator.campaign_records import (
    OperatorPlace,
    OperatorPlaces,
    operator_places,
)
from wil_campaign.orchestrator.operator.operator_channels import open_operator_channels
from wil_campaign.orchestrator.operator.run_messages import (
    FlightPlace,
    RunEventReport,
    RunProgressReport,
)
from wil_campaign.orchestrator.operator.socket_client import NoAnswerError
from wil_campaign.safety.guard.core.operator_command import OperatorCommand
from wil_campaign.safety.guard.operator.operator_socket import OperatorSocket

Said = tuple[int, str, str]
Cli = Callable[..., Awaitable[Said]]


@pytest.fixture(autouse=True)
def runtime(short_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(short_folder))


@pytest.fixture
def cli(capsys: pytest.CaptureFixture[str]) -> Cli:
    async def call(*arguments: str) -> Said:
        code = await asyncio.to_thread(main, arguments)
        said = capsys.readouterr()
        return code, said.out, said.err

    return call


@pytest.fixture
def fleet() -> FakeFleet:
    return FakeFleet()


@pytest.fixture
async def controller(tmp_path: Path, fleet: FakeFleet) -> AsyncIterator[CampaignController]:
    controller = make_controller(tmp_path, fleet)
    controller.news(RunProgressReport("large", "wil", 1, "goal", 12.0))
    async with open_operator_channels(controller):
        yield controller


@pytest.mark.parametrize("command", ["abort", "hold", "resume", "watch"])
async def test_a_command_reports_that_nothing_flies(cli: Cli, command: str, tmp_path: Path) -> None:
    assert await cli(command) == (3, "", "no campaign is in flight on this machine\n")
    assert await cli(command, str(tmp_path)) == (3, "", f"no run is in flight in {tmp_path}\n")


@pytest.mark.usefixtures("controller")
async def test_commands_reach_the_campaign_with_a_name(cli: Cli, fleet: FakeFleet) -> None:
    assert await cli("hold", "--who", "anna") == (
        0,
        "gate: held: 1 run in flight; no run is started\n",
        "",
    )
    assert await cli("hold") == (3, "", "gate: hold: all vehicles hold already\n")
    code, out, _ = await cli("resume", "--who", "anna")
    assert (code, out) == (0, "gate: resumed: 1 run in flight\n")
    assert [(one.kind, one.who) for one in fleet.told] == [
        ("hold", "cli:anna"),
        ("resume", "cli:anna"),
    ]
    code, out, _ = await cli("abort", "--who", "anna")
    assert (code, out) == (0, "gate: all vehicles land, and no further run is flown\n")
    assert [one.who for one in fleet.aborted] == ["cli:anna"]


async def test_a_fence_is_answered_by_the_runs(
    cli: Cli, controller: CampaignController, fleet: FakeFleet, tmp_path: Path
) -> None:
    path = tmp_path / "fence.yaml"
    path.write_text("box: {}")
    for ok, code in ((True, 0), (False, 3)):
        calling = asyncio.ensure_future(cli("fence", str(path), "--who", "anna"))
        before = len(fleet.told)
        while len(fleet.told) == before:  # noqa: ASYNC110 - another thread sets no event
            await asyncio.sleep(0.01)
        asked = fleet.told[-1]
        assert (asked.kind, asked.who, asked.document) == ("geofence", "cli:anna", "box: {}")
        word = "ok" if ok else "refused"
        news = RunEventReport("large/wil/1", 9.0, "answer", word, "", "said", asked.command_id)
        controller.news(news)
        assert await calling == (
            code,
            "large/wil/1: said\n" if ok else "",
            "" if ok else "large/wil/1: said\n",
        )
    lines = (tmp_path / "operator.jsonl").read_text("utf-8").splitlines()
    assert [json.loads(line)["ok"] for line in lines] == [True, True, True, False]


async def test_a_fence_that_no_run_answers_before_it_ends_is_reported(
    cli: Cli, controller: CampaignController, fleet: FakeFleet, tmp_path: Path
) -> None:
    path = tmp_path / "fence.yaml"
    path.write_text("box: {}")
    calling = asyncio.ensure_future(cli("fence", str(path)))
    while not fleet.told:  # noqa: ASYNC110 - another thread sets no event
        await asyncio.sleep(0.01)
    controller.left("large/wil/1")
    code, out, err = await calling
    assert (code, out) == (3, "")
    assert err == (
        "gate: no run confirmed the fence: each ended before it answered; send the fence again "
        "when a run is in flight (`wil-campaign watch` shows them)\n"
    )


async def test_a_run_that_ends_before_it_answers_beside_one_that_took_the_fence_is_named(
    cli: Cli, controller: CampaignController, fleet: FakeFleet, tmp_path: Path
) -> None:
    controller.news(RunProgressReport("large", "wil", 2, "goal", 3.0))
    path = tmp_path / "fence.yaml"
    path.write_text("box: {}")
    calling = asyncio.ensure_future(cli("fence", str(path)))
    while not fleet.told:  # noqa: ASYNC110 - another thread sets no event
        await asyncio.sleep(0.01)
    asked = fleet.told[-1]
    controller.news(
        RunEventReport("large/wil/1", 9.0, "answer", "ok", "", "taken", asked.command_id)
    )
    controller.left("large/wil/2")
    code, out, err = await calling
    assert (code, out) == (0, "large/wil/1: taken\n")
    assert err == (
        "large/wil/2: ended before it answered: whether its vehicles got the fence is not known\n"
    )


@pytest.fixture
async def hall(
    tmp_path: Path, short_folder: Path
) -> AsyncIterator[tuple[OperatorPlace, FakeFleet]]:
    """A second campaign on the machine, whose record the tests show or not."""
    fleet, path = FakeFleet(), short_folder / "hall.sock"
    other = make_controller(tmp_path / "hall", fleet)
    (tmp_path / "hall").mkdir()
    other.news(RunProgressReport("small", "sim", 3, "takeoff", 2.0))
    async with OperatorSocket(path=path, obey=other.obey, status=other.status, refused=other.warn):
        yield OperatorPlace("hall", tmp_path / "hall", path), fleet


@pytest.mark.usefixtures("controller")
@pytest.mark.parametrize("command", ["abort", "hold", "resume", "fence"])
async def test_several_campaigns_are_listed_and_nothing_is_sent(
    *,
    cli: Cli,
    fleet: FakeFleet,
    hall: tuple[OperatorPlace, FakeFleet],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    command: str,
) -> None:
    (gate,) = operator_places().campaigns
    file = tmp_path / "a fence.yaml"
    file.write_text("box: {}")
    words = (command, str(file)) if command == "fence" else (command,)
    show_places(monkeypatch, OperatorPlaces((gate, hall[0]), ()))
    code, out, err = await cli(*words, "--who", "anna")
    verb = {"abort": "land", "fence": "change the fence of"}.get(command, command)
    typed = f"{command} '{file}'" if command == "fence" else command
    assert (code, out) == (2, "")
    assert err == (
        "2 campaigns are in the air on this machine; nothing was sent. "
        f"To {verb} all of them:\n"
        f"  wil-campaign {typed} --all --who anna\n"
        "or one of them:\n"
        f"  wil-campaign {typed} {gate.folder} --who anna"
        "  # gate: 0 of 4 runs; large/wil/1: goal, nothing decided so far\n"
        f"  wil-campaign {typed} {hall[0].folder} --who anna"
        "  # hall: 0 of 4 runs; small/sim/3: takeoff, nothing decided so far\n"
    )
    assert not fleet.told
    assert not fleet.aborted
    assert not hall[1].told
    assert not hall[1].aborted


@pytest.mark.usefixtures("controller")
async def test_one_of_several_campaigns_is_commanded_by_its_folder_or_all(
    cli: Cli,
    fleet: FakeFleet,
    hall: tuple[OperatorPlace, FakeFleet],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    (gate,) = operator_places().campaigns
    gate = replace(gate, folder=tmp_path / "gate")
    show_places(monkeypatch, OperatorPlaces((gate, hall[0]), ()))
    assert (await cli("hold", str(hall[0].folder)))[0] == 0
    assert ([one.kind for one in hall[1].told], fleet.told) == (["hold"], [])
    # The folder around both names none of them.
    code, _, err = await cli("abort", str(tmp_path))
    assert (code, f"wil-campaign abort {tmp_path} --all\n" in err) == (2, True)
    assert not fleet.aborted
    assert (await cli("abort", "--all"))[0] == 0
    assert len(fleet.aborted) == len(hall[1].aborted) == 1


@pytest.mark.usefixtures("controller")
async def test_a_guard_of_another_campaign_whose_program_has_died_is_in_the_air(
    cli: Cli,
    fleet: FakeFleet,
    hall: tuple[OperatorPlace, FakeFleet],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    (gate,) = operator_places().campaigns
    folder = Path("/r/avoid")
    orphans = tuple(
        OperatorPlace(f"fast/wil/{n}", folder / f"fast/wil/{n}", hall[0].socket, campaign=folder)
        for n in (1, 2)
    )
    show_places(monkeypatch, OperatorPlaces((gate,), orphans))
    code, _, err = await cli("abort")
    assert code == 2
    assert "2 campaigns are in the air" in err
    assert f"wil-campaign abort {folder}  # fast/wil/1: 0 of 4 runs; " in err
    assert not fleet.aborted
    # Programs and guards of one campaign are one, however many runs it flies.
    own = tuple(
        replace(orphan, folder=gate.folder / orphan.name, campaign=None) for orphan in orphans
    )
    show_places(monkeypatch, OperatorPlaces((gate,), own))
    assert (await cli("abort"))[0] == 0
    show_places(monkeypatch, OperatorPlaces((), orphans))
    assert (await cli("abort"))[0] == 0


@pytest.mark.usefixtures("controller")
async def test_all_reaches_a_campaign_that_begins_meanwhile(
    cli: Cli,
    fleet: FakeFleet,
    hall: tuple[OperatorPlace, FakeFleet],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    (gate,) = operator_places().campaigns
    for options, reached in (((), 0), (("--all",), 1)):
        listed = [OperatorPlaces((gate,), ())]

        def later() -> OperatorPlaces:
            return listed.pop() if listed else OperatorPlaces((gate, hall[0]), ())  # noqa: B023

        monkeypatch.setattr("wil_campaign.orchestrator.cli.flight_choice.operator_places", later)
        assert (await cli("abort", *options))[0] == 0
        assert len(hall[1].aborted) == reached
    assert len(fleet.aborted) == 2


async def test_a_fence_for_all_names_the_guards_that_no_program_is_left_to_send_it_to(
    cli: Cli, hall: tuple[OperatorPlace, FakeFleet], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "fence.yaml"
    path.write_text("box: {}")
    show_places(monkeypatch, OperatorPlaces((), (replace(hall[0], name="large/wil/1"),)))
    code, _, err = await cli("fence", str(path), "--all")
    assert code == 3
    assert err == (
        "large/wil/1: its program has ended; its guard keeps the present fence, and lands\n"
    )


async def test_a_fence_that_cannot_be_read_or_sent_is_reported(cli: Cli, tmp_path: Path) -> None:
    code, _, said = await cli("fence", str(tmp_path / "none.yaml"))
    assert (code, "cannot be read" in said) == (2, True)
    path = tmp_path / "long.yaml"
    path.write_text("#" * 40_000)
    code, _, said = await cli("fence", str(path))
    assert (code, "more than" in said) == (2, True)
    path.write_text("box: {}")
    assert (await cli("fence", str(path))) == (3, "", "no campaign is in flight on this machine\n")


@pytest.mark.usefixtures("controller")
async def test_a_folder_chooses_what_is_meant(cli: Cli, fleet: FakeFleet, tmp_path: Path) -> None:
    assert (await cli("abort", str(tmp_path.parent / "another")))[0] == 3
    assert fleet.aborted == []
    assert (await cli("abort", str(tmp_path)))[0] == 0


async def test_watch_shows_what_flies_until_it_is_over(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    written = io.StringIO()
    monkeypatch.setattr("sys.stdout", written)
    controller = make_controller(tmp_path, FakeFleet())

    async def until(said: Callable[[list[str]], bool]) -> list[str]:
        while not said(lines := written.getvalue().splitlines()):  # noqa: ASYNC110 - threads write
            await asyncio.sleep(0.05)
        return lines

    def in_json(lines: list[str], run: str) -> bool:
        statuses = [json.loads(line) for line in lines if line.startswith("{")]
        return any(run in status["flying"] if run else not status["flying"] for status in statuses)

    none = "gate: 0 of 4 runs; none flies"
    flies = "gate: 0 of 4 runs; large/wil/1: goal, nothing decided so far"
    async with asyncio.timeout(60.0), open_operator_channels(controller):
        watching = asyncio.create_task(asyncio.to_thread(main, ["watch"]))
        as_json = asyncio.create_task(asyncio.to_thread(main, ["watch", "--json"]))
        await until(lambda lines: none in lines and in_json(lines, ""))
        controller.news(RunProgressReport("large", "wil", 1, "goal", 12.0))
        shown = await until(lambda lines: flies in lines and in_json(lines, "large/wil/1"))
        # The unchanged state is not shown again while further ones come as JSON.
        await until(lambda lines: len(lines) >= len(shown) + 2)
    assert await watching == await as_json == 0
    lines = written.getvalue().splitlines()
    assert lines.count(none) == lines.count(flies) == 1
    # What is over says how it ended; here nothing was written.
    assert sum(line.startswith("gate: over, and ") for line in lines) == 1
    statuses = [json.loads(line) for line in lines if line.startswith("{")]
    assert statuses[-1]["flying"]["large/wil/1"]["stage"] == "goal"


@pytest.mark.usefixtures("controller")
async def test_watch_reports_records_that_it_cannot_read_any_longer(
    cli: Cli, monkeypatch: pytest.MonkeyPatch
) -> None:
    readable = [operator_places()]

    def read_once() -> OperatorPlaces:
        if readable:
            return readable.pop()
        raise PermissionError(13, "Permission denied", "/run/user/1/wil-campaign")

    monkeypatch.setattr("wil_campaign.orchestrator.cli.flight_choice.operator_places", read_once)
    code, _, err = await cli("watch")
    assert code == 3
    assert err == (
        "the records of this machine's flights cannot be read: /run/user/1/wil-campaign: "
        "Permission denied; check who may read this folder\n"
    )


async def test_a_command_names_the_runs_that_acknowledge_it_and_those_that_do_not(
    cli: Cli, controller: CampaignController, fleet: FakeFleet, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("wil_campaign.orchestrator.cli.commands.operate.WITHIN_S", 0.3)
    for run, node in (("large/wil/1", "first"), ("large/wil/2", "second")):
        controller.begun(run, FlightPlace(node))
    pass_on = fleet.pass_on

    def acknowledging(command: OperatorCommand) -> int:
        asyncio.get_running_loop().call_soon(
            controller.news,
            RunEventReport(
                "large/wil/1", 1.0, "acknowledged", "", "", "", command.command_id, "anna"
            ),
        )
        return pass_on(command)

    monkeypatch.setattr(fleet, "pass_on", acknowledging)
    code, out, err = await cli("hold")
    assert code == 3
    assert "gate: acknowledged by large/wil/1 on first\n" in out
    assert "gate: not acknowledged within 0.3 s by large/wil/2 on second" in err


async def test_an_abort_of_a_node_goes_to_its_campaign_alone(
    cli: Cli, controller: CampaignController, fleet: FakeFleet, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("wil_campaign.orchestrator.cli.commands.operate.WITHIN_S", 0.1)
    controller.begun("large/wil/1", FlightPlace("first"))
    assert (await cli("abort", "--node", "third"))[0] == 3
    assert not fleet.aborted
    code, out, err = await cli("abort", "--node", "first")
    assert "gate: 1 run on node first will land, and no further run is flown there" in out
    assert (code, fleet.aborted[0].node) == (3, "first")  # for nobody acknowledges it here
    assert "large/wil/1 on first" in err


def show_places(monkeypatch: pytest.MonkeyPatch, flying: OperatorPlaces) -> None:
    monkeypatch.setattr(
        "wil_campaign.orchestrator.cli.flight_choice.operator_places", lambda: flying
    )


@pytest.mark.parametrize("command", ["abort", "hold"])
async def test_a_command_that_one_of_two_campaigns_does_not_answer_names_it(
    cli: Cli,
    controller: CampaignController,
    short_folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    command: str,
) -> None:
    del controller
    (gate,) = operator_places().campaigns
    with silent_place("hall", short_folder / "hall", short_folder / "hall.sock") as hall:
        show_places(monkeypatch, OperatorPlaces((gate, hall), ()))
        code, out, err = await cli(command, "--all")
    assert code == 3
    assert out.startswith("gate: ")
    assert err.startswith("hall: ")
    assert "hall: neither its program nor the guard of each of its runs has confirmed" in err


async def test_a_campaign_that_does_not_answer_is_reached_by_the_guard_of_each_of_its_runs(
    cli: Cli, controller: CampaignController, short_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    del controller
    (gate,) = operator_places().campaigns
    folder = short_folder / "hall"
    first = OperatorPlace("first", folder / "first", gate.socket)
    with (
        silent_place("hall", folder, short_folder / "hall.sock") as hall,
        silent_place("second", folder / "second", short_folder / "second.sock") as second,
    ):
        show_places(monkeypatch, OperatorPlaces((hall,), (first,)))
        assert (await cli("abort"))[0] == 0
        show_places(monkeypatch, OperatorPlaces((hall,), (first, second)))
        assert (await cli("abort"))[0] == 3
        # A guard whose program has died counts by itself.
        show_places(monkeypatch, OperatorPlaces((), (first, second)))
        code, _, err = await cli("abort", "--all")
    assert code == 3
    assert "second: the guard has not confirmed" in err


async def test_a_program_that_stands_still_is_not_shown_by_its_last_state(
    cli: Cli, controller: CampaignController, short_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    del controller
    monkeypatch.setattr("wil_campaign.orchestrator.operator.socket_client._ANSWER_S", 0.05)
    monkeypatch.setattr("wil_campaign.plugins.console.watch_command._EVERY_S", 0.01)
    (gate,) = operator_places().campaigns
    with silent_place("gate", gate.folder, short_folder / "gate.sock") as hung:
        seen = iter([OperatorPlaces((one,), ()) for one in (gate, gate, hung, hung, gate)])
        show = lambda: next(seen, OperatorPlaces((), ()))  # noqa: E731
        monkeypatch.setattr("wil_campaign.orchestrator.cli.flight_choice.operator_places", show)
        _, out, _ = await cli("watch")
    flying = "gate: 0 of 4 runs; large/wil/1: goal, nothing decided so far"
    assert out.splitlines()[:2] == [flying, "gate: it does not answer; its state is not known"]


async def test_a_campaign_that_stops_answering_has_not_acknowledged(
    cli: Cli, controller: CampaignController, monkeypatch: pytest.MonkeyPatch
) -> None:
    del controller
    monkeypatch.setattr("wil_campaign.orchestrator.cli.commands.operate.WITHIN_S", 0.1)

    def silent(path: Path, command: str, *, who: str) -> dict[str, object]:
        raise NoAnswerError(f"{path} does not answer to {command} of {who}")

    monkeypatch.setattr(
        "wil_campaign.orchestrator.cli.commands.operate.ask_operator_socket", silent
    )
    code, out, err = await cli("abort")
    assert (code, out) == (3, "gate: all vehicles land, and no further run is flown\n")
    assert err == (
        "gate: it does not answer any more: whether its runs have acknowledged the command is not "
        "known; `wil-campaign watch` shows them\n"
    )
    (gate,) = operator_places().campaigns
    flights = [OperatorPlaces((gate,), ()), OperatorPlaces((), ())]
    monkeypatch.setattr(
        "wil_campaign.orchestrator.cli.flight_choice.operator_places", lambda: flights.pop(0)
    )
    # It has ended meanwhile: nothing of it flies.
    assert (await cli("abort"))[0] == 0


async def test_an_abort_of_a_node_needs_only_the_campaign_that_flies_there(
    cli: Cli,
    controller: CampaignController,
    short_folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    # The acknowledgements are not the subject.
    monkeypatch.setattr(
        "wil_campaign.orchestrator.cli.commands.operate.ask_operator_socket", lambda *_, **__: {}
    )
    controller.begun("large/wil/1", FlightPlace("first"))
    (gate,) = operator_places().campaigns
    other = make_controller(tmp_path / "other", FakeFleet())
    path = short_folder / "other.sock"
    async with OperatorSocket(path=path, obey=other.obey, status=other.status, refused=other.warn):
        beside = OperatorPlace("other", tmp_path / "other", path)
        show_places(monkeypatch, OperatorPlaces((gate, beside), ()))
        code, out, err = await cli("abort", "--node", "first", "--all")
        assert (code, "no run flies on node first" in err) == (0, True)
        assert out.startswith("gate: 1 run on node first will land")
        with silent_place("hall", short_folder / "hall", short_folder / "hall.sock") as hall:
            show_places(monkeypatch, OperatorPlaces((gate, hall), ()))
            code, _, err = await cli("abort", "--node", "first")
            assert (code, "wil-campaign abort --all --node first\n" in err) == (2, True)
            code, _, err = await cli("abort", "--node", "first", "--all")
    assert (code, "hall: " in err) == (3, True)
