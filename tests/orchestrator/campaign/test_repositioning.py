"""Between runs on hardware: held until a person says that it was put back."""

import asyncio
import os
import select
import sys
from pathlib import Path

import pytest

from tests.orchestrator.operator.controllers import FakeFleet, make_controller
from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.orchestrator.campaign.repositioning import Repositioning
from wil_campaign.safety.guard.core.operator_command import OperatorCommand
from wil_campaign.safety.guard.operator.operator_lines import RefusedLineError


def test_nothing_is_begun_until_somebody_resumes(tmp_path: Path) -> None:
    fleet, said = FakeFleet(flying=0), list[str]()
    controller = make_controller(tmp_path, fleet)

    async def scenario() -> None:
        between = Repositioning(
            vehicles="real", controller=controller, say=said.append, wait_s=100.0
        )
        between.ask()
        assert (controller.held, fleet.going) == (True, False)
        await asyncio.sleep(60.0)
        controller.obey(OperatorCommand("resume", "anna"))
        between.end_wait()
        await asyncio.sleep(60.0)

    run_virtual(scenario())
    assert (controller.held, fleet.going, controller.stopped) == (False, True, None)
    (asked,) = said
    assert asked.startswith("move real back to its start")
    assert asked.endswith("then run: wil-campaign resume")


def test_the_person_reads_where_the_next_run_starts(tmp_path: Path) -> None:
    said = list[str]()
    controller = make_controller(tmp_path, FakeFleet(flying=0))

    async def scenario() -> None:
        between = Repositioning(vehicles="real", controller=controller, say=said.append)
        between.ask("north 1 m for real")
        between.end_wait()

    run_virtual(scenario())
    assert said[0].startswith("move real to the start of the next run, north 1 m for real, check")


def test_the_campaign_ends_when_nobody_comes(tmp_path: Path) -> None:
    fleet, said = FakeFleet(flying=0), list[str]()
    controller = make_controller(tmp_path, fleet)

    async def scenario() -> None:
        Repositioning(vehicles="real", controller=controller, say=said.append, wait_s=100.0).ask()
        await asyncio.sleep(101.0)

    run_virtual(scenario())
    assert controller.stopped == "command"
    assert said[-1] == "nobody confirmed within 100 s that real is back"


def test_a_campaign_that_ends_asks_for_nothing(tmp_path: Path) -> None:
    said = list[str]()
    controller = make_controller(tmp_path, FakeFleet())
    controller.obey(OperatorCommand("abort", "anna"))
    Repositioning(vehicles="real", controller=controller, say=said.append).ask()
    assert (said, controller.held) == ([], False)


async def test_enter_on_the_terminal_is_enough(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    leader, follower = os.openpty()
    fleet, said = FakeFleet(flying=0), list[str]()
    controller = make_controller(tmp_path, fleet)
    with os.fdopen(follower, encoding="utf-8") as terminal:
        monkeypatch.setattr(sys, "stdin", terminal)
        os.write(leader, b"typed in flight\n")
        Repositioning(vehicles="real", controller=controller, say=said.append).ask()
        assert "press Enter" in said[0]
        assert select.select([terminal], [], [], 0.0) == ([], [], [])
        os.write(leader, b"\n")
        for _ in range(1000):
            if not controller.held:
                break
            await asyncio.sleep(0.01)
    os.close(leader)
    assert fleet.going


@pytest.mark.parametrize("held", ["before", "while the person is asked"])
async def test_enter_does_not_release_what_an_operator_holds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, held: str
) -> None:
    """As `on_operator_loss: hold`, which says so once."""
    leader, follower = os.openpty()
    fleet, said = FakeFleet(flying=0), list[str]()
    controller = make_controller(tmp_path, fleet, said=said)
    hold = OperatorCommand("hold", "cli:anna")
    with os.fdopen(follower, encoding="utf-8") as terminal:
        monkeypatch.setattr(sys, "stdin", terminal)
        waiting = Repositioning(vehicles="real", controller=controller, say=said.append)
        if held == "before":
            controller.obey(hold)
        waiting.ask()
        assert ("press Enter" in said[-1]) == (held != "before")
        if held != "before":
            controller.obey(hold)
        os.write(leader, b"\n")
        async with asyncio.timeout(10.0):
            while held != "before" and "held by cli:anna; " not in said[-1]:  # noqa: ASYNC110 - no event
                await asyncio.sleep(0.01)
        await asyncio.sleep(0)
        assert (controller.held, fleet.going) == (True, False)
        with pytest.raises(RefusedLineError):
            controller.obey(OperatorCommand("hold", "cli:ben"))
        controller.obey(OperatorCommand("resume", "cli:ben"))
        waiting.end_wait()
    os.close(leader)
    assert fleet.going


@pytest.mark.parametrize("how", ["end of file", "end of file after a text", "hang-up"])
async def test_the_end_of_the_terminal_confirms_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, how: str
) -> None:
    leader, follower = os.openpty()
    fleet, messages = FakeFleet(flying=0), list[str]()
    controller = make_controller(tmp_path, fleet)
    with os.fdopen(follower, encoding="utf-8") as terminal:
        monkeypatch.setattr(sys, "stdin", terminal)
        waiting = Repositioning(
            vehicles="real", controller=controller, say=messages.append, wait_s=3.0
        )
        waiting.ask()
        if how == "end of file":
            os.write(leader, b"\x04")
        elif how == "end of file after a text":
            os.write(leader, b"wait\x04\x04")
        else:
            os.close(leader)
        await asyncio.sleep(0.1)
        assert controller.held
        assert not fleet.going
        async with asyncio.timeout(30.0):  # and the limit of the wait still holds
            while controller.stopped is None:  # noqa: ASYNC110 - it sets no event
                await asyncio.sleep(0.01)
    if how != "hang-up":
        os.close(leader)
    assert controller.stopped == "command"
