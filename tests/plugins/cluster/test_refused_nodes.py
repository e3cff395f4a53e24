"""Nodes that are lost or unfit, and the campaign that flies on the others."""

import asyncio
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from wil_campaign.orchestrator.campaign.workers.run_engine import EngineError
from wil_campaign.orchestrator.operator.run_messages import FlightPlace
from wil_campaign.plugins.cluster import ray_engine
from wil_campaign.plugins.cluster.node_messages import CampaignAnswer, CampaignBrought
from wil_campaign.plugins.cluster.ray_agents import NodeRefusedError
from wil_campaign.plugins.cluster.ray_engine import RayEngine, RayWorkers
from wil_campaign.plugins.cluster.returned_results import FetchedResults
from wil_campaign.plugins.cluster.store import open_store
from wil_campaign.plugins.cluster.travelling_files import TravellingFiles

UNFIT = "it does not see in memory://a what was written there"


class Agent:
    """An agent whose node answers with a problem, or none. problem: None for a node that dies."""

    def __init__(self, node: str, problem: str | None = "") -> None:
        self.node = node
        self.place = FlightPlace(node)
        self.has_campaign = self.is_dead = False
        self._problem = problem

    async def send(self, _: object) -> None:
        await asyncio.sleep(0)

    async def receive(self) -> Sequence[CampaignAnswer]:
        await asyncio.sleep(0)
        if self._problem is None:
            raise EOFError("the actor has died")
        return [CampaignAnswer(self._problem)]

    def kill(self) -> None:
        self.is_dead = True


class Workers(RayWorkers):
    """Workers on some agents. hired: those that the cluster has besides, the next at the end."""

    def __init__(self, *idle: Agent, hired: Sequence[Agent] = ()) -> None:
        self.said: list[str] = []
        self.agents: Any = list(idle)
        self.hired: Any = list(hired)
        self.hires = 0
        store = open_store("memory://a")
        super().__init__(
            engine=RayEngine(None, 1, store, idle=self.agents),
            brought=CampaignBrought(Path("/out"), "session", TravellingFiles(()), store.url, "a"),
            ledger=None,  # type: ignore[arg-type]
            results=FetchedResults(store, Path("/out"), "a"),
            say=self.said.append,
        )

    async def _hire_another(self) -> Any:
        self.hires += 1
        await asyncio.sleep(0)
        if not self.hired:
            raise NodeRefusedError("node third would not fly the same", 2)
        return self.hired.pop()


@pytest.fixture(autouse=True)
def no_pauses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ray_engine, "_PAUSE_S", 0.001)


@pytest.mark.parametrize(
    ("problem", "said"),
    [(None, "node bad is lost: the actor has died"), (UNFIT, f"node bad: {UNFIT}")],
)
@pytest.mark.parametrize("good_is_idle", [True, False])
async def test_the_next_node_takes_the_place_of_one_that_is_refused(
    problem: str | None, said: str, *, good_is_idle: bool
) -> None:
    good, bad = Agent("good"), Agent("bad", problem)
    workers = Workers(good, bad) if good_is_idle else Workers(bad, hired=[good])
    workers._engine.flown.add("good")  # an earlier run
    worker = await workers.start()
    assert worker.place == FlightPlace("good")
    assert workers.said == [said]
    assert (bad.is_dead, good.is_dead) == (True, False)


async def test_an_unfit_node_ends_a_campaign_of_which_nothing_has_flown() -> None:
    workers = Workers(Agent("bad", UNFIT))
    with pytest.raises(EngineError, match=f"node bad: {UNFIT}") as raised:
        await workers.start()
    assert (raised.value.code, workers.hires) == (2, 0)


async def test_a_lost_node_is_replaced_also_before_anything_has_flown() -> None:
    workers = Workers(Agent("bad", None), hired=[Agent("good")])
    assert (await workers.start()).place == FlightPlace("good")


async def test_unfit_nodes_end_no_flight_of_others_and_a_place_that_becomes_free_is_taken() -> None:
    workers = Workers(Agent("good"))
    flying = await workers.start()
    waiting = asyncio.create_task(workers.start())
    while workers.hires < 6 and not waiting.done():  # noqa: ASYNC110 - sets no event
        await asyncio.sleep(0.001)
    assert not waiting.done()
    assert workers.said == ["node third would not fly the same"]
    await flying.end()
    assert (await waiting).place == FlightPlace("good")


async def test_a_campaign_that_no_node_can_continue_ends_with_exit_code_3() -> None:
    """The same node is hired a few times, not for ever."""
    good = Agent("good")
    workers = Workers(good)
    flown = await workers.start()
    good.kill()
    await flown.end()
    with pytest.raises(EngineError, match="node third would not fly the same") as raised:
        await workers.start()
    assert (raised.value.code, workers.hires) == (3, 3)
