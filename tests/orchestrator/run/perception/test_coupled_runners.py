"""What flies a coupled twin: setpoints of its vehicle's autonomy, and none that are old."""

import asyncio
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.orchestrator.run.perception.runner_factory import ShadowRunner
from wil_campaign.vehicles.setpoints import Setpoint, VelocitySetpoint

AHEAD = VelocitySetpoint((1.0, 0.0, 0.0))
ASIDE = VelocitySetpoint((0.0, 1.0, 0.0))


class Leader:
    """An autonomy runner whose setpoints are given by hand."""

    def __init__(self) -> None:
        self.give: Callable[[Setpoint, float], None] = lambda *_: None

    def on_setpoint(self, listener: Callable[[Setpoint, float], None]) -> None:
        self.give = listener


async def shadowed(waits_s: float) -> list[Setpoint]:
    """Return what a twin is sent that begins so long after its vehicle's first setpoint."""
    leader, sent = Leader(), list[Setpoint]()
    context: Any = SimpleNamespace(name="twin", driver=SimpleNamespace(send=sent.append))
    runner = ShadowRunner(context=context, leader=leader)  # type: ignore[arg-type]  # a fake
    loop = asyncio.get_running_loop()
    leader.give(AHEAD, loop.time())
    await asyncio.sleep(waits_s)
    flying = asyncio.create_task(runner.fly())
    await asyncio.sleep(0.01)
    leader.give(ASIDE, loop.time())
    flying.cancel()
    await asyncio.wait([flying])
    return sent


@pytest.mark.parametrize(
    ("waits_s", "sent"), [(0.0, [AHEAD, ASIDE]), (0.4, [AHEAD, ASIDE]), (0.6, [ASIDE])]
)
def test_a_shadow_flies_no_setpoint_of_long_before_it_begins(
    waits_s: float, sent: list[Setpoint]
) -> None:
    assert run_virtual(shadowed(waits_s)) == sent
