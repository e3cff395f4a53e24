"""A vehicle's frames over the packet socket, to an orchestrator that reads them late."""

import asyncio
import itertools
from collections.abc import Sequence

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.safety.guard.process.channel import (
    LONGEST_PACKET_BYTES,
    GuardChannel,
    guard_channel_pair,
)
from wil_campaign.safety.guard.process.channel_link import ChannelLink
from wil_campaign.safety.guard.process.messages import (
    FrameBytes,
    ToOrchestrator,
    UnreadBytes,
    to_guard,
    to_orchestrator,
)
from wil_campaign.vehicles.autopilots.autopilot import MavlinkTarget
from wil_campaign.vehicles.driver.session.arrivals import STEP_S
from wil_campaign.vehicles.driver.session.session import MavlinkSession
from wil_campaign.vehicles.links.tapped import TappedLink
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec

PERIOD_S = 0.04
AUTOPILOT, CAMERA = (
    MavlinkCodec(system_id=1, component_id=1),
    MavlinkCodec(system_id=1, component_id=100),
)
ATTITUDE = mavlink.MAVLink_attitude_message(1000, *[0.1] * 6)
MORE_THAN_THE_SOCKET_HOLDS = 20_000


async def read_late(
    codec: MavlinkCodec, *, late_s: float
) -> tuple[MavlinkSession, list[UnreadBytes], list[float]]:
    """Return what an orchestrator heard that read nothing for a while, though frames came.

    Returns as well when the frames were written.
    """
    loop, written_s = asyncio.get_running_loop(), list[float]()
    unread: list[UnreadBytes] = []
    ours, theirs = guard_channel_pair()
    guard = GuardChannel(ours, receives=to_guard, take=lambda _: None, closed=lambda: None)
    far = ChannelLink(name="far", index=0, channel=guard, target=MavlinkTarget(1))
    near = ChannelLink(name="near", index=0)

    def take(message: ToOrchestrator) -> None:
        match message:
            case FrameBytes(_, t_s, data):
                near.arrive(data, t_s)
            case UnreadBytes(_, arrived_s):
                unread.append(message)
                near.arrived_unread(arrived_s)

    reads = GuardChannel(theirs, receives=to_orchestrator, take=take, closed=lambda: None)
    session = MavlinkSession(link=TappedLink(near), own=MavlinkTarget(245))
    session.target = MavlinkTarget(1)
    guard.open()

    def write() -> None:
        written_s.append(loop.time())
        far.write(codec.pack(ATTITUDE))

    async with near, far:
        for _ in range(MORE_THAN_THE_SOCKET_HOLDS):
            write()
        for _ in range(round(late_s / PERIOD_S)):
            write()
            await asyncio.sleep(PERIOD_S)
        assert guard.dropped > late_s / PERIOD_S
        reads.open()
        for _ in range(10):
            write()
            await asyncio.sleep(PERIOD_S)
        reads.read_rest()  # which on a busy machine is more than the loop has read by now
    guard.close()
    reads.close()
    return session, unread, written_s


def longest_step_s(times_s: Sequence[float]) -> float:
    return max(after - before for before, after in itertools.pairwise(times_s))


async def test_a_vehicle_was_not_silent_while_its_frames_were_not_read() -> None:
    session, unread, written_s = await read_late(AUTOPILOT, late_s=0.8)
    times_s = session.arrivals.take()
    assert times_s[-1] - times_s[0] > 1.0
    # The machine of the test may be late as well: then nothing came.
    assert longest_step_s(times_s) < STEP_S + 0.2 + longest_step_s(written_s)
    assert sum(one.count for one in unread) >= 20
    assert "this program did not read them in time" in str(unread[0])


async def test_frames_of_another_component_are_no_sign_of_the_vehicle() -> None:
    session, unread, _ = await read_late(CAMERA, late_s=0.2)
    assert unread
    assert session.arrivals.take() == ()
    assert session.last_received_s is None


@pytest.mark.parametrize("target", [None, MavlinkTarget(1)])
def test_arrivals_before_the_last_frame_or_without_a_vehicle_are_skipped(
    target: MavlinkTarget | None,
) -> None:
    session = MavlinkSession(
        link=TappedLink(ChannelLink(name="near", index=0)), own=MavlinkTarget(245)
    )
    session.target = target
    session.received(AUTOPILOT.pack(ATTITUDE), 5.0)
    session.received_unread((4.0, 4.9))
    assert session.last_received_s == (None if target is None else 5.0)
    assert session.arrivals.take() == (() if target is None else (5.0,))


async def test_a_burst_longer_than_a_packet_arrives_whole() -> None:
    """A TCP link that stalled hands over up to 256 KiB at once; the guard failed on them."""
    burst, arrived = AUTOPILOT.pack(ATTITUDE) * 5000, bytearray()
    ours, theirs = guard_channel_pair()
    guard = GuardChannel(ours, receives=to_guard, take=lambda _: None, closed=lambda: None)
    far = ChannelLink(name="far", index=0, channel=guard, target=MavlinkTarget(1))

    def take(message: ToOrchestrator) -> None:
        assert isinstance(message, FrameBytes)
        arrived.extend(message.data)

    reads = GuardChannel(theirs, receives=to_orchestrator, take=take, closed=lambda: None)
    guard.open()
    reads.open()
    async with far, asyncio.timeout(5.0):
        assert len(burst) > LONGEST_PACKET_BYTES
        far.write(burst)
        while len(arrived) < len(burst):  # noqa: ASYNC110 - an arrival sets no event
            await asyncio.sleep(0.001)
    assert bytes(arrived) == burst
    guard.close()
    reads.close()
