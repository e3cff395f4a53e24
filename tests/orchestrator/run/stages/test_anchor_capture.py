"""A vehicle is anchored where motion capture sees it, not where the file says that it stands."""

import asyncio
import math
from collections.abc import Callable
from pathlib import Path
from typing import cast

import pytest

from tests.orchestrator.conftest import BRIEF
from tests.orchestrator.external.rigs import FakeDriver, FakeStation
from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.orchestrator.run.stages.before_arming import anchor_by_mocap
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.orchestrator.state.vehicle_context import HISTORY_S, VehicleContext
from wil_campaign.vehicles.driver.vehicle_state import LocalEstimate
from wil_campaign.vehicles.errors import AnchorError
from wil_campaign.vehicles.poses.pose_history import PoseHistory
from wil_campaign.worlds.frames import Pose

Fly = Callable[..., tuple[RunResult, Path]]


def anchored(*, sees: Callable[[float], Pose | None], estimates: bool = True) -> FakeDriver:
    """Run the anchoring beside motion capture at 100 Hz."""

    async def run() -> FakeDriver:
        loop, context = asyncio.get_running_loop(), FakeStation()
        context.poses = PoseHistory(HISTORY_S)  # type: ignore[attr-defined]  # as of a Station
        if estimates:
            here = Pose.of(10.0, 20.0, 0.0, yaw_rad=0.3)
            context.driver.state.local = LocalEstimate(0.0, here, (0.0, 0.0, 0.0))

        async def capture() -> None:
            while True:
                pose = sees(loop.time())
                if pose is not None:
                    context.poses.add(loop.time(), pose)  # type: ignore[attr-defined]  # as above
                await asyncio.sleep(0.01)

        task = asyncio.create_task(capture())
        await asyncio.sleep(0.5)
        try:
            await anchor_by_mocap(cast("VehicleContext", context))
        finally:
            task.cancel()
            await asyncio.wait([task])
        return context.driver

    return run_virtual(run())


def test_the_own_frame_is_laid_where_it_is_seen() -> None:
    anchor = anchored(sees=lambda t_s: Pose.of(1.0, -2.0, 0.1, yaw_rad=0.8, roll_rad=0.02)).anchor
    assert anchor is not None
    assert anchor.turn_rad == pytest.approx(0.5, abs=1e-6)
    seen = anchor.pose(Pose.of(10.0, 20.0, 0.0, yaw_rad=0.3))
    assert seen.position_ned_m == pytest.approx((1.0, -2.0, -0.1), abs=1e-6)
    assert seen.yaw_rad == pytest.approx(0.8, abs=1e-6)


def test_a_vehicle_that_moves_or_is_not_seen_is_not_anchored() -> None:
    with pytest.raises(
        AnchorError, match=r"real, anchored by motion capture: .* moved by .* still"
    ):
        anchored(sees=lambda t_s: Pose.of(math.sin(t_s), 0.0, 0.0))
    with pytest.raises(AnchorError, match="only 0 position estimates"):
        anchored(sees=lambda t_s: None)
    with pytest.raises(AnchorError, match="only 0 position estimates"):
        anchored(sees=lambda t_s: Pose((0, 0, 0)), estimates=False)


def test_a_flight_that_is_anchored_by_motion_capture(fly_run: Fly) -> None:
    result, _ = fly_run(sets=(*BRIEF, "vehicles.real.anchor=mocap"))
    assert (result.verdict, result.reason) == ("PASS", "")
    (anchored,) = [one for one in result.before_arming if one.step == "anchor"]
    assert (anchored.vehicle, anchored.text.split(":")[0]) == ("real", "its origin")
