"""Drawn images end with the goal: when every autonomy has ended, and nothing else with them."""

import asyncio
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from tests.orchestrator.conftest import BRIEF
from tests.orchestrator.flights import log_of
from tests.recipes.samples import beam
from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.orchestrator.run.perception.mixing_budget import MixingBudgetWatch
from wil_campaign.orchestrator.run.perception.perception import PerceivedSensor, Perception
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.orchestrator.state.run_state import RunState, Stage
from wil_campaign.plugins.python.mcap_reader import RecordedReading, Recording
from wil_campaign.vehicles.readings import CameraReading, Reading

Fly = Callable[..., tuple[RunResult, Path]]


class Ticks:
    """A stream of ten readings a second."""

    async def run(self, deliver: Callable[[Reading], None]) -> None:
        while True:
            deliver(beam(1.0))
            await asyncio.sleep(0.1)


def last_s(stages: dict[Stage, float]) -> tuple[dict[str, float], list[Any]]:
    """Return when the last reading of each sensor came in a run with these stages, and the end."""
    seen: dict[str, float] = {}
    ended: list[Any] = []

    def take(name: str, _: Reading) -> None:
        seen[name] = asyncio.get_running_loop().time()

    async def perceive() -> None:
        loop = asyncio.get_running_loop()
        run_state = RunState(time=loop.time)
        budgets = MixingBudgetWatch(run_state=run_state, is_any_silent=lambda _: False)
        perception = Perception({}, run_state, budgets)
        perception.images_ended = lambda topics: ended.append((topics, loop.time()))
        for vehicle, sensor in (("real", "camera"), ("real", "live"), ("twin", "camera")):
            source = PerceivedSensor(vehicle, sensor, Ticks(), is_drawn=sensor == "camera")
            source.takers.append(partial(take, f"{vehicle} {sensor}"))
            perception.sources.append(source)
        for stage, t_s in stages.items():
            loop.call_at(t_s, run_state.enter, stage)
        await asyncio.wait_for(perception.run(lambda: None), 30.0)

    with pytest.raises(TimeoutError):
        run_virtual(perceive())
    return seen, ended


def test_drawn_images_end_soon_after_the_goal_and_live_ones_go_on() -> None:
    seen, ended = last_s({"takeoff": 1.0, "goal": 5.0, "done": 10.0, "land": 12.0})
    assert 12.3 < seen["real camera"] <= 12.51  # the twin's autonomy may fly until `land`
    assert seen["twin camera"] == seen["real camera"]
    assert seen["real live"] > 29.8
    assert ended == [(("/real/camera", "/twin/camera"), pytest.approx(12.5))]


def test_a_flight_that_is_ended_early_shows_what_came_of_it() -> None:
    seen, ended = last_s({"takeoff": 1.0, "goal": 5.0, "land": 7.0})
    assert 9.3 < seen["real camera"] <= 9.51
    assert ended == [(("/real/camera", "/twin/camera"), pytest.approx(9.5))]


def test_images_that_are_never_landed_with_go_on() -> None:
    seen, ended = last_s({"takeoff": 1.0, "goal": 5.0, "done": 10.0})
    assert seen["real camera"] > 29.8
    assert ended == []


def images_of(folder: Path) -> dict[str, float]:
    """Return when the last image of each source was delivered."""
    found: dict[str, float] = {}
    for item in Recording(folder / "run.mcap"):
        if isinstance(item, RecordedReading) and isinstance(item.reading, CameraReading):
            found[item.reading.source] = item.reading.arrived_s
    return found


def test_a_recording_says_where_its_images_end(fly_run: Fly) -> None:
    result, folder = fly_run(sets=BRIEF)
    assert result.verdict == "PASS", result.reason
    log = log_of(folder)
    (ended,) = [one for one in log if one["event"] == "images_ended"]
    (land_s,) = [one["t_s"] for one in log if one.get("stage") == "land"]
    assert ended["topics"] == "/mixed/camera /real/camera /twin/camera"
    assert ended["t_s"] == pytest.approx(land_s + 0.5, abs=1e-3)
    last = images_of(folder)
    assert set(last) == {"real", "twin", "mixed"}
    # Five images a second.
    assert all(ended["t_s"] - 0.41 < t_s <= ended["t_s"] for t_s in last.values())
    assert log[-1]["t_s"] > ended["t_s"] + 1.0
