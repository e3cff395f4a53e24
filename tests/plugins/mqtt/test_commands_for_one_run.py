"""Commands by MQTT that name one run: what reaches it, and what reaches the others."""

import asyncio
import json
from collections.abc import AsyncIterator
from pathlib import Path

import pytest

from wil_campaign.orchestrator.campaign.workers.run_workers import OrderDone, WorkerLost
from wil_campaign.orchestrator.campaign.workers.worker_pool import WorkerPool
from wil_campaign.orchestrator.operator.campaign_controller import CampaignController
from wil_campaign.orchestrator.operator.run_messages import FlightPlace, RunProgressReport
from wil_campaign.plugins.mqtt.message_signing import signed_message
from wil_campaign.plugins.mqtt.mqtt_commands import CommandReader, RefusedCommandError
from wil_campaign.safety.guard.core.operator_command import OperatorCommand
from wil_campaign.safety.guard.operator.operator_lines import RefusedLineError

FIRST, SECOND = "A/wil/1", "B/wil/1"
TOKEN = "of the test"  # noqa: S105 - opens nothing
NOW_S = 1_763_739_600.0


class RecordingWorker:
    """Flies until the test ends, and remembers the kinds of the commands that reach it."""

    place = FlightPlace()

    def __init__(self, received: dict[str, list[str]]) -> None:
        self._received = received
        self._run = ""

    async def begin(self, order: str) -> None:
        self._run = order
        self._received[order] = []

    async def receive(self) -> object:
        await asyncio.Event().wait()
        return OrderDone("")

    def send(self, command: OperatorCommand) -> None:
        self._received[self._run].append(command.kind)

    def kill(self) -> None: ...

    async def outcome_of_lost(self, reason: str) -> WorkerLost:
        return WorkerLost(reason)

    async def end(self) -> str:
        return ""


class Campaign:
    """Two runs in flight on two workers of a pool, and the operator who commands them by MQTT."""

    def __init__(self, folder: Path) -> None:
        self.received: dict[str, list[str]] = {}
        self._sent = 0
        self.pool = WorkerPool[str, str](
            jobs=2,
            workers=self,
            report=lambda _: None,
            done=lambda _, __: None,
            begun=self._begun,
        )
        self.controller = CampaignController(
            campaign="gate", folder=folder, total=3, fleet=self.pool, say=lambda _: None
        )
        self._reader = CommandReader(
            base="wil/gate",
            token=TOKEN,
            session=self.controller.session,
            flying=lambda: self.controller.flying,
        )

    def _begun(self, run: str, place: FlightPlace) -> None:
        self.controller.begun(run, place)

    async def start(self) -> RecordingWorker:
        return RecordingWorker(self.received)

    async def close(self) -> None: ...

    def obey(self, kind: str, **fields: object) -> str:
        self._sent += 1
        session = self.controller.session
        body = {"session": session, "id": f"a{self._sent}", "at": NOW_S, "who": "anna", **fields}
        topic = f"wil/gate/operator/{kind}"
        payload = signed_message(topic, json.dumps(body).encode(), TOKEN.encode())
        return self.controller.obey(self._reader.read(kind, payload, retained=False, now_s=NOW_S))

    def take(self) -> dict[str, list[str]]:
        """Return what each run has received since the last call."""
        taken = {run: list(kinds) for run, kinds in self.received.items()}
        for kinds in self.received.values():
            kinds.clear()
        return taken


@pytest.fixture
async def campaign(tmp_path: Path) -> AsyncIterator[Campaign]:
    campaign = Campaign(tmp_path)
    flying = asyncio.create_task(campaign.pool.fly([FIRST, SECOND, "C/wil/1"]), name="the pool")
    async with asyncio.timeout(10):
        while len(campaign.received) < 2:  # noqa: ASYNC110 - sets no event
            await asyncio.sleep(0)
    for case in ("A", "B"):
        campaign.controller.news(
            RunProgressReport(case, "wil", 1, "goal", 12.0, verdict_so_far="PASS")
        )
    yield campaign
    flying.cancel()
    await asyncio.wait({flying})


async def test_a_resume_of_one_run_leaves_the_other_held(campaign: Campaign) -> None:
    campaign.obey("hold")
    assert campaign.take() == {FIRST: ["hold"], SECOND: ["hold"]}
    said = campaign.obey("resume", run=FIRST)
    assert campaign.take() == {FIRST: ["resume"], SECOND: []}
    assert said == (
        "resumed: 1 run in flight, A/wil/1 only; no run is started until a resume of all"
    )
    acknowledged = campaign.controller.acknowledged
    assert acknowledged is not None
    assert list(acknowledged.waiting) == [FIRST]
    assert campaign.controller.held
    with pytest.raises(RefusedLineError, match=r"^resume: A/wil/1 does not hold$"):
        campaign.obey("resume", run=FIRST)
    assert campaign.take() == {FIRST: [], SECOND: []}
    assert campaign.obey("resume", run=SECOND).startswith("resumed: 1 run in flight, B/wil/1")
    assert campaign.take() == {FIRST: [], SECOND: ["resume"]}
    assert campaign.obey("resume") == "resumed: 2 runs in flight"
    assert not campaign.controller.held


async def test_a_run_that_was_resumed_can_be_held_again(campaign: Campaign) -> None:
    campaign.obey("hold")
    campaign.obey("resume", run=FIRST)
    campaign.take()
    assert campaign.obey("hold").startswith("held: 2 runs in flight")
    assert campaign.take() == {FIRST: ["hold"], SECOND: ["hold"]}
    with pytest.raises(RefusedLineError, match="all vehicles hold already"):
        campaign.obey("hold")


async def test_a_hold_of_one_run_lets_the_campaign_go_on(campaign: Campaign) -> None:
    assert campaign.obey("hold", run=SECOND) == "held: 1 run in flight, B/wil/1 only"
    assert campaign.take() == {FIRST: [], SECOND: ["hold"]}
    assert (campaign.controller.held, campaign.controller.state) == (False, "flying")
    with pytest.raises(RefusedLineError, match=r"^hold: B/wil/1 holds already$"):
        campaign.obey("hold", run=SECOND)
    # A retry of that run flies: what its first attempt was told is over.
    campaign.controller.begun(SECOND, FlightPlace())
    assert campaign.obey("hold", run=SECOND) == "held: 1 run in flight, B/wil/1 only"
    assert campaign.obey("resume") == "resumed: 2 runs in flight"
    with pytest.raises(RefusedLineError, match="no vehicle holds"):
        campaign.obey("resume")


async def test_a_fence_for_one_run_reaches_that_run(campaign: Campaign) -> None:
    said = campaign.obey("geofence", run=FIRST, geofence={"box": {"up_m": [0, 2]}})
    assert campaign.take() == {FIRST: ["geofence"], SECOND: []}
    assert said == "sent to 1 run; each run will report its result"


@pytest.mark.parametrize("run", [FIRST, "A/wil/9", ["A"], None, "\ud800"])
async def test_an_abort_is_for_all_whatever_run_it_names(campaign: Campaign, run: object) -> None:
    said = campaign.obey("abort", run=run)
    assert campaign.take() == {FIRST: ["abort"], SECOND: ["abort"]}
    assert said.endswith("; an abort is for all runs, not only for the one that it names")
    acknowledged = campaign.controller.acknowledged
    assert acknowledged is not None
    assert set(acknowledged.waiting) == {FIRST, SECOND}


@pytest.mark.parametrize("kind", ["hold", "resume"])
async def test_a_run_that_has_ended_is_not_commanded(campaign: Campaign, kind: str) -> None:
    campaign.controller.left(FIRST)
    with pytest.raises(RefusedCommandError, match="for a run that is not in flight"):
        campaign.obey(kind, run=FIRST)
    assert campaign.take() == {FIRST: [], SECOND: []}
