"""The order in which a run's vehicles start: all processes are begun before one is waited for."""

from contextlib import AsyncExitStack, nullcontext
from pathlib import Path
from typing import Any, cast

import pytest

from tests.orchestrator.conftest import ROOT
from wil_campaign.campaigns.expansion.expansion import ExpansionOptions, load_campaign
from wil_campaign.campaigns.setup.vehicle_setups import FlownSetup
from wil_campaign.orchestrator.external.motion_captures import MotionCaptures
from wil_campaign.orchestrator.run.vehicles import pair
from wil_campaign.orchestrator.state.run_setup import RunOrder, RunSetup
from wil_campaign.vehicles.links.link import LinkError
from wil_campaign.vehicles.links.memory import memory_pair


class Backend:
    """Starts nothing, and says what it was asked for."""

    def __init__(self) -> None:
        self.asked: list[tuple[str, str]] = []

    async def begin(self, _: AsyncExitStack, vehicle: FlownSetup) -> None:
        self.asked.append(("begin", vehicle.name))

    async def start(self, _: AsyncExitStack, vehicle: FlownSetup) -> Any:
        self.asked.append(("start", vehicle.name))
        raise LinkError("enough")


async def test_all_vehicles_are_begun_before_one_is_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    options = ExpansionOptions(cases=("large",), modes=("wil",))
    plan = load_campaign(ROOT / "campaigns" / "gate.yaml", options).runs[0]
    setup = RunSetup.of(RunOrder(plan=plan, folder=tmp_path, clock="wall"))
    backend = Backend()
    links = {one.name: memory_pair(latency_s=0.0, name=one.name)[1] for one in setup.guarded}
    monkeypatch.setattr(pair, "guard_of", lambda *_, **__: (nullcontext(), backend, links))
    with pytest.raises(LinkError, match="enough"):
        async with pair.open_pair(
            setup, record=lambda *_: None, captures=cast("MotionCaptures", None), tracks={}
        ):
            pass
    assert backend.asked == [("begin", "real"), ("begin", "twin"), ("start", "real")]
