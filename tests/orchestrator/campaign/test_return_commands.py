"""A flight back to the start is in flight under one name, by which commands reach it."""

from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

import pytest

from tests.orchestrator.campaign.resuming.test_runs_to_fly import result_of
from wil_campaign.campaigns.expansion.expansion import Campaign, load_campaign
from wil_campaign.orchestrator.campaign import campaign_runner
from wil_campaign.orchestrator.campaign.campaign_runner import fly_campaign
from wil_campaign.orchestrator.campaign.flight_options import ClearedCampaign, FlightOptions
from wil_campaign.orchestrator.campaign.workers.run_workers import OrderDone
from wil_campaign.orchestrator.cli.progress_display import SilentDisplay
from wil_campaign.orchestrator.operator.campaign_controller import CampaignController
from wil_campaign.orchestrator.operator.run_messages import (
    FlightPlace,
    RunEventReport,
    RunProgressReport,
)
from wil_campaign.orchestrator.run.stages.return_flight import return_plan
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.orchestrator.state.run_setup import RunOrder
from wil_campaign.safety.guard.core.operator_command import OperatorCommand

HOP = """\
schema: wil/campaign/1
campaign: hop
vehicles: {real: {link: "udpin://127.0.0.1:14555", autopilot: px4}}
world: world.yaml
autonomy: {use: straight, with: {speed_m_s: 1.0, for_s: 2.0}}
goal: {altitude_m: 1.2}
modes: [real]
repetitions: 2
between_runs: fly_back
geofence: {box: {north_m: [-6, 8], east_m: [-6, 6], up_m: [-0.5, 4]}}
oracles: {landed: {}}
"""
WORLD = "schema: wil/world/1\norigin: {latitude_deg: 47.4, longitude_deg: 8.5}\n"
COLUMNS = "t_s,vehicle,stage,armed,est_north_m,est_east_m,est_down_m,est_yaw_rad\n"
BACK = "default-real-back/real/1"

Operate = Callable[[CampaignController, str], None]
Flown = Callable[[Operate], tuple["Flights", CampaignController]]


@dataclass
class Flights:
    """Flies orders as their processes would tell of them; operate: called in each flight."""

    operate: Callable[[str], None]
    commands: dict[str, list[str]] = field(default_factory=dict)
    reads_files_here: bool = True

    def workers(self, campaign: Campaign, folder: Path, say: Callable[[str], None]) -> "Flights":
        return self

    async def start(self) -> "OneFlight":
        return OneFlight(self)

    async def close(self) -> None:
        pass


class OneFlight:
    place = FlightPlace()

    def __init__(self, flights: Flights) -> None:
        self._flights = flights
        self._messages: list[object] = []

    async def begin(self, order: RunOrder) -> None:
        order.folder.mkdir(parents=True)
        north_m = 3.0 if order.back is None else 0.0
        stands = f"1.0,real,landed,0,{north_m},0.0,0.0,0.0\n"
        (order.folder / "trajectory.csv").write_text(COLUMNS + stands)
        (order.folder / "log.jsonl").write_text('{"event": "stage", "stage": "arm"}\n')
        self._plan = order.plan if order.back is None else return_plan(order.plan)
        plan = self._plan
        self._messages = [
            RunProgressReport(plan.case, plan.mode, plan.repetition, "goal", 1.0),
            "operate",
            OrderDone(replace(result_of(plan), duration_s=9.0)),
        ]

    async def receive(self) -> object:
        message = self._messages.pop(0)
        if message == "operate":
            self._flights.operate(self._plan.name)
        return message

    def send(self, command: OperatorCommand) -> None:
        name = self._plan.name
        self._flights.commands.setdefault(name, []).append(command.kind)
        receipt = RunEventReport(
            name, 1.0, "acknowledged", command.kind, "", "", command_id=command.command_id
        )
        self._messages.insert(0, receipt)

    def kill(self) -> None:
        pass

    async def outcome_of_lost(self, reason: str) -> RunResult:
        raise AssertionError(reason)

    async def end(self) -> str:
        return ""


@pytest.fixture
def flown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Flown:
    def fly(operate: Operate) -> tuple[Flights, CampaignController]:
        (tmp_path / "world.yaml").write_text(WORLD)
        (tmp_path / "hop.yaml").write_text(HOP)
        controllers: list[CampaignController] = []

        @asynccontextmanager
        async def channels(
            controller: CampaignController, _: Mapping[str, object]
        ) -> AsyncIterator[None]:
            controllers.append(controller)
            yield
            controller.log.close()

        monkeypatch.setattr(campaign_runner, "open_operator_channels", channels)
        flights = Flights(lambda name: operate(controllers[0], name))
        cleared = ClearedCampaign("wall", 1, real_kind="sitl", engine=flights)
        fly_campaign(
            load_campaign(tmp_path / "hop.yaml"),
            FlightOptions(out=tmp_path / "out"),
            cleared,
            SilentDisplay(),
        )
        return flights, controllers[0]

    return fly


def test_a_hold_of_the_flight_back_alone_reaches_it(flown: Flown) -> None:
    """It is named as it is shown to be in flight."""
    answers: list[str] = []

    def operate(controller: CampaignController, name: str) -> None:
        if name == BACK:
            assert name in controller.flying
            answers.append(controller.obey(OperatorCommand("hold", "anna", run=name)))
            answers.append(controller.obey(OperatorCommand("resume", "anna", run=name)))

    flights, _ = flown(operate)
    assert answers == [f"{done}: 1 run in flight, {BACK} only" for done in ("held", "resumed")]
    assert flights.commands == {BACK: ["hold", "resume"]}


def test_only_flights_in_the_air_are_awaited_to_acknowledge_a_command(flown: Flown) -> None:
    awaited: list[tuple[str, ...]] = []

    def operate(controller: CampaignController, _: str) -> None:
        controller.obey(OperatorCommand("hold", "anna"))
        assert controller.acknowledged is not None
        awaited.append(tuple(controller.acknowledged.waiting))
        controller.obey(OperatorCommand("resume", "anna"))

    _, controller = flown(operate)
    assert awaited == [("default/real/1",), (BACK,), ("default/real/2",)]
    assert controller.acknowledged is not None
    assert tuple(controller.acknowledged.waiting) == ()
