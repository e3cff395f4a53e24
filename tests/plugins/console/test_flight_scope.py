"""Which flights a console is for: it shows and commands no others."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from wil_campaign.foundation.processes.identity import ProcessId
from wil_campaign.orchestrator.operator.campaign_records import CampaignRecord
from wil_campaign.plugins.console.campaign_poller import CampaignPoller
from wil_campaign.plugins.console.flight_scope import FlightScope
from wil_campaign.plugins.console.page_commands import CommandSender, PageCommand
from wil_campaign.safety.guard.process.orphaned_processes import (
    GuardRecord,
    remove_guard_record,
    write_guard_record,
)
from wil_campaign.safety.guard.process.runtime_folder import open_runtime_folder

OTHER = 1
"""A process that has no campaign."""


@pytest.fixture(autouse=True)
def _own_runtime(short_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(short_folder))


@contextmanager
def guard(run: Path, campaign: Path | None = None) -> Iterator[None]:
    runtime, me = open_runtime_folder().path, ProcessId.own()
    record = GuardRecord(
        run="gate/wil/1",
        folder=str(run),
        socket=str(runtime / "guard.sock"),
        guard=me,
        owner=None,
        since_s=0.0,
        campaign="" if campaign is None else str(campaign),
    )
    write_guard_record(runtime, record)
    try:
        yield
    finally:
        remove_guard_record(runtime, me)


def test_a_program_s_console_is_for_its_campaign_alone(tmp_path: Path) -> None:
    run = tmp_path / "gate" / "large" / "wil" / "1"
    mine, strangers, whole = (
        FlightScope(program=os.getpid()),
        FlightScope(program=OTHER),
        FlightScope(),
    )
    assert (whole.is_whole_machine, mine.is_whole_machine) == (True, False)
    with guard(run):
        with CampaignRecord(name="gate", folder=tmp_path / "gate"):
            for scope, campaigns in ((mine, 1), (whole, 1), (strangers, 0)):
                found = scope.places()
                assert (len(found.campaigns), len(found.guards)) == (campaigns, campaigns)
                assert scope.covers(str(run)) is bool(campaigns)
            assert not mine.covers(str(tmp_path / "avoid" / "fast" / "wil" / "1"))
        # The program is gone, its guard lands what it flew: that is its campaign's still.
        assert len(mine.places().guards) == 1
        with CampaignPoller(mine) as poller, CampaignPoller(strangers) as other:
            assert (poller.is_landing(), other.is_landing()) == (True, False)


def test_a_guard_that_writes_elsewhere_is_its_campaign_s(tmp_path: Path) -> None:
    """By a store a run's files are in a folder of the node's until they are sent."""
    gate = tmp_path / "gate"
    with guard(tmp_path / "wil-run-1" / "large/wil/1", gate):
        with CampaignRecord(name="gate", folder=gate):
            mine = FlightScope(program=os.getpid())
            assert len(mine.places().guards) == 1
            (flying,) = FlightScope().places().by_campaign().values()
            assert flying.guards_of(flying.campaigns[0]) == flying.guards
        assert [*FlightScope().places().by_campaign()] == [gate]
        assert len(FlightScope(folder=gate).places().guards) == 1
        assert FlightScope(folder=tmp_path / "hall").places().guards == ()


async def test_an_abort_reaches_no_other_program_s_campaign(tmp_path: Path) -> None:
    with CampaignRecord(name="gate", folder=tmp_path / "gate"):
        sender = CommandSender(FlightScope(program=OTHER))
        outcome = await sender.send(PageCommand("abort"), "console:anna")
        sender.close()
    assert not outcome.ok
    assert outcome.texts == ("no campaign is in flight for this console",)


def test_a_folder_s_console_is_for_what_is_in_it_or_around_it(tmp_path: Path) -> None:
    run = tmp_path / "gate" / "large" / "wil" / "1"
    for folder in (tmp_path, tmp_path / "gate", run):
        assert FlightScope(folder=folder).covers(str(run))
    assert not FlightScope(folder=tmp_path / "avoid").covers(str(run))


def test_a_folder_s_console_is_for_it_by_any_of_its_names(tmp_path: Path) -> None:
    (tmp_path / "disk").mkdir()
    link = tmp_path / "results"
    link.symlink_to("disk")
    scope = FlightScope(folder=tmp_path / "disk")
    with CampaignRecord(name="gate", folder=link / "gate"):
        assert [one.name for one in scope.places().campaigns] == ["gate"]
    assert scope.covers(str(link / "gate" / "1"))
    assert not scope.covers(str(tmp_path / "gate" / "1"))
