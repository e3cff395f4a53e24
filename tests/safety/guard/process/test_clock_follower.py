"""The guard's clock follows a vehicle's: what it hears, what it says."""

import asyncio
import math
import struct
from collections.abc import Callable
from functools import partial

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.foundation.clocks.sim_clock_controller import STEP_S, ClockSegment
from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.safety.guard.core.commands import ClocksApart, Trouble, VehicleGone
from wil_campaign.safety.guard.process.run_clock import PaceSetup
from wil_campaign.safety.guard.process.run_clock_factory import ClockFollower, boot_s_of
from wil_campaign.vehicles.links.memory import memory_pair
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec
from wil_campaign.vehicles.mavlink.framing import frame_header

CODEC = {
    "real": MavlinkCodec(system_id=1, component_id=1),
    "twin": MavlinkCodec(system_id=2, component_id=1),
}


def attitude(boot_ms: int) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_attitude_message(boot_ms, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0)


class Wall:
    """A wall clock that is moved by hand, and what a paced loop would be."""

    def __init__(self) -> None:
        self.now_s = 1000.0
        self.segment = ClockSegment(1000.0, 1000.0, 1.0)
        self.due: list[tuple[float, Callable[[], object]]] = []

    def follow(self, segment: ClockSegment) -> None:
        self.segment = segment

    def call_wall_later(self, delay_s: float, callback: Callable[[], object]) -> asyncio.Handle:
        self.due.append((self.now_s + delay_s, callback))
        return asyncio.Handle(callback, (), asyncio.get_running_loop())

    def pass_to(self, wall_s: float) -> None:
        while self.due and self.due[0][0] <= wall_s:
            self.now_s, callback = self.due.pop(0)
            callback()
        self.now_s = wall_s


async def flown(
    rates: dict[str, Callable[[float], float]],
    *,
    for_s: float,
    lead: str = "real",
    told: dict[str, list[float]] | None = None,
) -> tuple[Wall, list[Trouble], ClockFollower]:
    """Fly simulators whose rates at each second of the wall's are given.

    told: takes the paces that simulations are told, by those that heed them.
    """
    wall, said = Wall(), list[Trouble]()
    following = ClockFollower(
        setup=PaceSetup(nominal=5.0, leader=lead, launched=("real", "twin")),
        leader=lead,
        systems={"real": 1, "twin": 2},
        loop=wall,
        publish=lambda _: None,
        trouble=said.append,
        pace_frames={name: lambda pace: struct.pack("<d", pace) for name in told or ()},
        wall=lambda: wall.now_s,
    )
    ends = {}
    for name in rates:
        near, far = memory_pair(name=name)
        if told is not None and name in told:
            far.receive(partial(_take_pace, told[name]))
        tapped = following.tap(name, near)
        tapped.receive(lambda *_: None)
        await tapped.__aenter__()
        await far.__aenter__()
        ends[name] = far
    boot_s = dict.fromkeys(rates, 20.0)
    following.begin()
    for step in range(round(for_s / 0.02)):
        for name, rate in rates.items():
            grown_s = rate(step * 0.02) * 0.02
            boot_s[name] += grown_s
            if grown_s:
                ends[name].write(CODEC[name].pack(attitude(round(boot_s[name] * 1000))))
        await asyncio.sleep(0.001)
        wall.pass_to(1000.0 + step * 0.02)
    return wall, said, following


def _take_pace(paces: list[float], data: bytes, _: float) -> None:
    paces.append(struct.unpack("<d", data)[0])


def test_the_clock_goes_as_fast_as_the_leader_and_says_how_fast() -> None:
    wall, said, following = run_virtual(
        flown({"real": lambda _: 3.7, "twin": lambda _: 3.7}, for_s=12.0)
    )
    assert said == []
    assert wall.segment.rate == pytest.approx(3.7, rel=0.02)
    assert following.pace == pytest.approx(3.7, rel=0.1)


def test_a_leader_that_hangs_ends_the_run_and_time_goes_on() -> None:
    wall, said, _ = run_virtual(flown({"real": lambda s: 5.0 if s < 4.0 else 0.0}, for_s=12.0))
    (trouble,) = said
    assert (type(trouble), trouble.vehicle) == (VehicleGone, "real")
    assert "the simulation of real hangs: its time has not advanced for 5 s" in trouble.text
    assert wall.segment.rate == pytest.approx(5.0, rel=0.05)


def test_a_pair_that_attains_different_rates_is_reported() -> None:
    _, said, _ = run_virtual(flown({"real": lambda _: 5.0, "twin": lambda _: 4.5}, for_s=12.0))
    (trouble,) = said
    assert (type(trouble), trouble.vehicle) == (ClocksApart, "twin")
    assert (
        "behind that of real: asked for 5 times real time they attain 4.5 and 5.0" in trouble.text
    )


@pytest.mark.parametrize("heeds", ["real", "twin"])
def test_a_simulation_that_heeds_a_pace_keeps_the_time_of_one_that_does_not(heeds: str) -> None:
    told: dict[str, list[float]] = {heeds: []}
    (fixed,) = {"real", "twin"} - {heeds}
    rates = {
        heeds: lambda _: told[heeds][-1] if told[heeds] else 5.0,
        # What PX4 attains when it is asked for 5, and at times less.
        fixed: lambda s: 4.2 if 20.0 < s < 25.0 else 4.8,
    }
    _, said, _ = run_virtual(flown(rates, for_s=40.0, told=told))
    assert said == []
    assert told[heeds][-1] == pytest.approx(4.8, rel=0.02)


def test_a_twin_that_heeds_a_pace_keeps_the_time_of_the_leader() -> None:
    told: dict[str, list[float]] = {"real": [], "twin": []}
    rates = {
        "real": lambda _: 4.5,  # the machine gives it no more
        "twin": lambda _: told["twin"][-1] if told["twin"] else 5.0,
    }
    _, said, _ = run_virtual(flown(rates, for_s=30.0, told=told))
    assert said == []
    assert told["real"] == []


def test_a_leader_that_waits_leaves_a_twin_that_does_not() -> None:
    hesitates = {"real": lambda s: 0.0 if 5.0 < s < 7.0 else 5.0, "twin": lambda _: 5.0}
    _, said, _ = run_virtual(flown(hesitates, for_s=12.0))
    (trouble,) = said
    assert (type(trouble), trouble.vehicle) == (ClocksApart, "twin")
    assert "ahead of" in trouble.text


def test_a_vehicle_that_is_not_ours_sets_no_clock() -> None:
    async def await_piece() -> bool:
        wall = Wall()
        following = ClockFollower(
            setup=PaceSetup(nominal=5.0, leader="real"),
            leader="real",
            systems={"real": 1},
            loop=wall,
            publish=lambda _: None,
            trouble=lambda *_: None,
            wall=lambda: wall.now_s,
        )
        near, far = memory_pair(name="real")
        tapped = following.tap("real", near)
        tapped.receive(lambda *_: None)
        async with tapped, far:
            following.begin()
            for step in range(100):
                far.write(CODEC["twin"].pack(attitude(step * 100)))
                await asyncio.sleep(0.001)
                wall.pass_to(1000.0 + step * STEP_S)
        return wall.segment.rate == 1.0

    assert run_virtual(await_piece())


@pytest.mark.parametrize(
    "message",
    [
        attitude(123_456),
        mavlink.MAVLink_attitude_message(123_456, *[0.0] * 6),
        mavlink.MAVLink_local_position_ned_message(123_456, *[0.0] * 6),
        mavlink.MAVLink_global_position_int_message(123_456, *[0] * 8),
        mavlink.MAVLink_system_time_message(0, 123_456),
        mavlink.MAVLink_system_time_message(1_700_000_000_000_000, 123_456),
    ],
    ids=lambda message: message.get_type(),
)
def test_the_stamp_of_a_message(message: mavlink.MAVLink_message) -> None:
    frame = frame_header(CODEC["real"].pack(message))
    assert frame is not None
    assert math.isclose(boot_s_of(frame), 123.456)


def test_a_stamp_of_zero_is_left_out_of_a_frame() -> None:
    frame = frame_header(CODEC["real"].pack(mavlink.MAVLink_system_time_message(0, 0)))
    assert frame is not None
    assert boot_s_of(frame) == 0.0
