"""Faults of motion capture, in virtual time: what it delivers of one vehicle is altered."""

import asyncio
from collections.abc import Callable, Iterable
from typing import Any

from orchestrator.run.course import Course, Stage
from orchestrator.run.opening import Pair
from vehicles.readings import PoseReading

Alter = Callable[[PoseReading], Iterable[PoseReading]]
"""Returns what is delivered in a reading's place."""


def captured(
    vehicle: str, alter: Alter, *, stage: Stage, after_s: float = 0.0
) -> Callable[[Pair, Course], None]:
    """Return a disturbance: from a stage on, a vehicle's motion capture goes on as `alter` says."""

    def disturb(pair: Pair, course: Course) -> None:
        source: Any = pair.vehicles[vehicle]
        callbacks = source._mocap._callbacks
        deliver = tuple(callbacks)

        def take(reading: PoseReading) -> None:
            since_s = course.entered_s.get(stage)
            now_s = asyncio.get_running_loop().time()
            active = since_s is not None and now_s >= since_s + after_s
            for one in alter(reading) if active else (reading,):
                for callback in deliver:
                    callback(one)

        callbacks[:] = [take]

    return disturb
