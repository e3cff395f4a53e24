"""The motion capture of a vehicle that flies alone: a campaign reads its true pose."""

import asyncio
import math
import socket
from collections.abc import Iterator
from contextlib import suppress

import pytest

from tests.vehicles.embedded.conftest import Rig
from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.plugins.mocap.motion_capture import CaptureDecoder
from wil_campaign.plugins.standalone.vehicle_mocap import BODY, VehicleMocap
from wil_campaign.vehicles.embedded.process.vehicle_faults import VehicleFaults
from wil_campaign.vehicles.faults import parse_fault
from wil_campaign.vehicles.links.link_strings import parse_link
from wil_campaign.vehicles.readings import PoseReading

RATE_HZ = 100


@pytest.fixture
def captures() -> Iterator[socket.socket]:
    """Yield the socket of a campaign that takes motion capture."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        taken.setblocking(False)
        yield taken


async def read_for(
    seconds: float, taken: socket.socket, decoder: CaptureDecoder
) -> list[PoseReading]:
    """Return the readings of all messages that arrive in some seconds."""
    loop, found = asyncio.get_running_loop(), list[PoseReading]()
    end_s = loop.time() + seconds
    while loop.time() < end_s:
        await asyncio.sleep(0.004)
        with suppress(BlockingIOError):
            while True:
                found += decoder.receive(taken.recv(65536), loop.time())
    return found


def test_a_campaign_reads_the_true_poses_of_its_body(captures: socket.socket) -> None:
    decoder = CaptureDecoder(bodies={BODY: "real"})

    async def scenario() -> None:
        async with Rig(autopilot="px4") as r:
            faults = VehicleFaults(r.vehicle, kill=lambda: None, report=lambda _: None)
            mocap = VehicleMocap(parse_link(f"udpout://127.0.0.1:{captures.getsockname()[1]}"))
            await r.hover(1.0)
            async with mocap.attach(r.vehicle, faults):
                readings = await read_for(1.0, captures, decoder)
                assert len(readings) == pytest.approx(RATE_HZ, abs=2)
                assert decoder.statistics(BODY).missing == 0
                true, last = r.vehicle.truth().pose, readings[-1]
                assert math.dist(last.pose.position_ned_m, true.position_ned_m) < 0.02
                assert last.pose.yaw_rad == pytest.approx(true.yaw_rad, abs=0.02)
                assert last.velocity_ned_m_s is None

                faults.inject(parse_fault("pose_source freeze"))
                frozen = await read_for(0.5, captures, decoder)
                assert len({reading.pose for reading in frozen[1:]}) == 1

                faults.inject(parse_fault("pose_source stop"))
                await read_for(0.1, captures, decoder)
                assert await read_for(0.5, captures, decoder) == []
        assert decoder.garbage == 0

    run_virtual(scenario())
