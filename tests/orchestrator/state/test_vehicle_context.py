"""What the context of a vehicle makes of what its driver reports."""

from types import SimpleNamespace
from typing import Any

import pytest

from wil_campaign.orchestrator.state.vehicle_context import VehicleContext
from wil_campaign.vehicles.driver.vehicle_state import EstimateSample
from wil_campaign.worlds.frames import Pose


@pytest.mark.parametrize("doubts_s", [(0.01, 0.3, 0.02), (None, 0.3, None)])
def test_a_liftoff_is_as_much_in_doubt_as_the_clock_was_at_most(
    doubts_s: tuple[float | None, ...],
) -> None:
    clock = SimpleNamespace(uncertainty_s=None)
    driver: Any = SimpleNamespace(clock=clock, state=SimpleNamespace(armed=True))
    context = VehicleContext("real", driver, Pose((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)), "mavlink")
    for t_s, doubt_s in enumerate(doubts_s):
        clock.uncertainty_s = doubt_s
        pose = Pose((0.0, 0.0, -0.01 * t_s), (1.0, 0.0, 0.0, 0.0))
        context.receive_estimate(EstimateSample(t_s, t_s, t_s, pose, (0.0, 0.0, -0.01)))
    assert context.liftoff.doubt_s == 0.3
