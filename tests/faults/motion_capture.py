"""Faults of motion capture, in virtual time: what it delivers of one vehicle is altered."""

import asyncio
from collections.abc import Callable, Iterable
from typing import Any

from wil_campaign.orchestrator.run.vehicles.pair import VehiclePair
from wil_campaign.orchestrator.state.run_state import RunState, Stage
from wil_campaign.vehicles.readings import PoseReading

Alter = Callable[[PoseReading], Iterable[PoseReading]]
"""Returns what is delivered in a reading's place."""


def captured(
    vehicle: str, alter: Alter, *, stage: Stage, after_s: float = 0.0
) -> Callable[[VehiclePair, RunState], None]:
    """Return a disturbance: from a stage on, a vehicle's motion capture goes on as `alter` says."""

    def disturb(pair: VehiclePair, run_state: RunState) -> None:
        source: Any = pair.vehicles[vehicle]
        callbacks = source._mocap._callbacks
        deliver = tuple(callbacks)

        def take(reading: PoseReading) -> None:
            since_s = run_state.entered_s.get(stage)
            now_s = asyncio.get_running_loop().time()
            active = since_s is not None and now_s >= since_s + after_s
            for one in alter(reading) if active else (reading,):
                for callback in deliver:
                    callback(one)

        callbacks[:] = [take]

    return disturb
