"""Which run clock the guard's process leads: lockstep, or that of a simulation's own pace."""

import asyncio
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

from wil_campaign.safety.guard.core.events import GuardedVehicle
from wil_campaign.safety.guard.process.channel import Channel
from wil_campaign.safety.guard.process.clock_follower import ClockFollower, PaceFrame
from wil_campaign.safety.guard.process.guard_config import GuardConfig
from wil_campaign.safety.guard.process.lockstep_clock import LockstepClock
from wil_campaign.safety.guard.process.messages import Pace
from wil_campaign.safety.guard.process.run_clock import RunClock, Trouble
from wil_campaign.vehicles.clocks.paced_loop import PacedLoop
from wil_campaign.vehicles.clocks.sim_clock_controller import Segment
from wil_campaign.vehicles.mavlink.codec import Codec


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
        pace_frames=_pace_frames(guard_config, setup.launched),
        loop=loop,
        publish=publish,
        trouble=trouble,
    )


def _pace_frames(guard_config: GuardConfig, launched: Iterable[str]) -> dict[str, PaceFrame]:
    """Return by name the frames that tell a launched simulation its pace, where it heeds one."""
    settings, frames = guard_config.settings, dict[str, PaceFrame]()
    for name in launched:
        vehicle = guard_config.vehicles[name].vehicle
        if vehicle.autopilot.heeds_pace:
            codec = Codec(system_id=settings.system_id, component_id=settings.component_id)
            frames[name] = partial(_pace_frame, vehicle, codec)
    return frames


def _pace_frame(vehicle: GuardedVehicle, codec: Codec, times_real_time: float) -> bytes:
    return codec.pack(vehicle.autopilot.set_simulation_pace(vehicle.target, times_real_time))
