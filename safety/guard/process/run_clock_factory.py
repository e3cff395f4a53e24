"""Which run clock the guard's process leads: lockstep, or that of a simulation's own pace."""

import asyncio
from collections.abc import Callable
from typing import Any

from safety.guard.process.channel import Channel
from safety.guard.process.clock_follower import ClockFollower
from safety.guard.process.guard_config import GuardConfig
from safety.guard.process.lockstep_clock import LockstepClock
from safety.guard.process.messages import Pace
from safety.guard.process.run_clock import RunClock, Trouble
from vehicles.clocks.paced_loop import PacedLoop
from vehicles.clocks.sim_clock_controller import Segment


def run_clock_of(
    guard_config: GuardConfig,
    *,
    channel: Channel[Any],
    trouble: Callable[[str, Trouble, str], None],
    took_over: Callable[[], bool],
) -> RunClock | None:
    """Return what leads the scaled clock; None under the wall clock.

    took_over: whether the guard has latched.
    """
    loop, setup = asyncio.get_running_loop(), guard_config.pace
    if setup is None or not isinstance(loop, PacedLoop):
        return None

    def publish(segment: Segment) -> None:
        holds_s = None if setup.leader is not None else segment.holds_s
        channel.send(Pace(segment.wall_s, segment.run_s, segment.rate, holds_s))

    if setup.leader is None:
        return LockstepClock(
            setup=setup, loop=loop, publish=publish, trouble=trouble, took_over=took_over
        )
    return ClockFollower(
        setup=setup,
        leader=setup.leader,
        systems={name: one.vehicle.target.system for name, one in guard_config.vehicles.items()},
        loop=loop,
        publish=publish,
        trouble=trouble,
    )
