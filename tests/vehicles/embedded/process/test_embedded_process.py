"""Vehicles in processes of their own; the wall clock runs, so these tests are few and short."""

import asyncio
import os
import signal
import subprocess
import sys
from collections.abc import Callable

import numpy as np
import pytest

from tests.ports import free_port
from tests.vehicles.embedded.embedded_process import EmbeddedProcess
from wil_campaign.foundation.processes.feed_socket import feed_pair
from wil_campaign.vehicles.embedded.process.embedded_launch import FeedClient
from wil_campaign.vehicles.embedded.process.embedded_process import main
from wil_campaign.vehicles.embedded.process.process_settings import ProcessSettings, Start
from wil_campaign.vehicles.faults import InjectedFault
from wil_campaign.vehicles.links.link import LinkError
from wil_campaign.vehicles.links.link_strings import parse_link
from wil_campaign.vehicles.links.udp import UdpLink
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec
from wil_campaign.vehicles.poses.truth import TruthSample


def alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


async def until(condition: Callable[[], bool]) -> None:
    async with asyncio.timeout(60.0):
        while not condition():  # noqa: ASYNC110 - another process has no event
            await asyncio.sleep(0.02)


async def gone(pid: int) -> bool:
    for _ in range(1200):
        if not alive(pid):
            return True
        await asyncio.sleep(0.05)
    return False


async def test_lives_beside_us_and_ends_with_the_context() -> None:
    port = free_port()
    link = UdpLink(address=parse_link(f"udpin://127.0.0.1:{port}"))
    codec = MavlinkCodec(system_id=255, component_id=190)
    heard: list[str] = []
    link.receive(lambda data, _: heard.extend(m.get_type() for m in codec.parse(data)))
    settings = ProcessSettings(
        autopilot="px4",
        link=f"udpout://127.0.0.1:{port}",
        seed=1,
        profile="cage",
        source="twin",
        start=Start(north_m=1.5, up_m=0.2, yaw_deg=90.0),
    )
    async with link, EmbeddedProcess(settings=settings) as process:
        now_s = asyncio.get_running_loop().time
        truths: list[float] = []
        late_s: list[float] = []
        sources: set[str] = set()

        def take(sample: TruthSample) -> None:
            truths.append(sample.t_s)
            late_s.append(now_s() - sample.t_s)

        process.feed.on_truth(take, 10)
        process.feed.on_mocap(lambda reading: sources.add(reading.source))
        await until(lambda: len(truths) >= 10 and "HEARTBEAT" in heard and bool(sources))
        assert sources == {"twin"}
        # By its stamps: how often they come is the machine's matter, too.
        assert float(np.median(np.diff(truths))) == pytest.approx(0.1, abs=0.01)
        # Its clock is the clock of this machine; it may be a step ahead.
        assert -0.1 < min(late_s) < 1.0
        truth = process.feed.truth()
        assert truth is not None
        assert truth.pose.position_ned_m == pytest.approx((1.5, 0.0, -0.2), abs=0.01)
        assert process.pid is not None
        pid = process.pid
        process.feed.notify("start", 1.0)
        process.feed.fault(InjectedFault("mute"))
        for _ in range(2):  # what was sent before it was mute may come until the first time
            heard.clear()
            truths.clear()
            await until(lambda: len(truths) >= 5)
        assert heard == []
    assert process.exit_code == 0
    assert not alive(pid)


async def test_a_kill_fault_ends_it() -> None:
    settings = ProcessSettings(
        autopilot="ardupilot", link=f"udpout://127.0.0.1:{free_port()}", seed=1
    )
    async with EmbeddedProcess(settings=settings) as process:
        assert process.pid is not None
        process.feed.fault(InjectedFault("kill"))
        async with asyncio.timeout(60.0):
            while process.exit_code is None:  # noqa: ASYNC110 - another process has no event
                await asyncio.sleep(0.02)
    assert process.exit_code == 0


async def test_a_fault_of_its_settings_begins_at_its_moment() -> None:
    settings = ProcessSettings(
        autopilot="px4",
        link=f"udpout://127.0.0.1:{free_port()}",
        seed=1,
        faults=("mute", "kill@3"),
    )
    async with EmbeddedProcess(settings=settings) as process:
        async with asyncio.timeout(60.0):
            while process.exit_code is None:  # noqa: ASYNC110 - another process has no event
                await asyncio.sleep(0.02)
        assert process.stderr_tail.split("\n")[-2:] == [
            "fault begun: mute",
            "fault begun: kill@3",
        ]
    assert process.exit_code == 0


async def test_an_unknown_profile_or_link_is_reported() -> None:
    settings = ProcessSettings(
        autopilot="px4", link="udpout://127.0.0.1:14999", seed=1, profile="cafe"
    )
    with pytest.raises(LinkError, match="no profile 'cafe'"):
        async with EmbeddedProcess(settings=settings):
            pytest.fail("it started")
    settings = settings.model_copy(update={"profile": "cage", "link": "memory://"})
    with pytest.raises(LinkError, match="did not start"):
        async with EmbeddedProcess(settings=settings):
            pytest.fail("it started")


PARENT = """
import asyncio, sys
from tests.vehicles.embedded.embedded_process import EmbeddedProcess
from wil_campaign.vehicles.embedded.process.process_settings import ProcessSettings

async def main():
    link = "udpout://127.0.0.1:" + sys.argv[1]
    settings = ProcessSettings(autopilot="px4", link=link, seed=1)
    async with EmbeddedProcess(settings=settings) as process:
        print(process.pid, flush=True)
        await asyncio.sleep(60)

asyncio.run(main())
"""


async def test_it_does_not_outlive_a_parent_that_is_killed() -> None:
    parent = await asyncio.create_subprocess_exec(
        sys.executable, "-c", PARENT, str(free_port()), stdout=subprocess.PIPE
    )
    assert parent.stdout is not None
    pid = int(await asyncio.wait_for(parent.stdout.readline(), 120.0))
    assert alive(pid)
    parent.send_signal(signal.SIGKILL)
    await parent.wait()
    assert await gone(pid)


async def test_garbage_on_the_feed_is_counted() -> None:
    ours, theirs = feed_pair()
    async with FeedClient(source="real", end=ours) as client:
        with theirs:
            theirs.send(b"hello")
        async with asyncio.timeout(60.0):
            while client.garbage == 0:  # noqa: ASYNC110 - a counter has no event
                await asyncio.sleep(0.01)
        assert client.truth() is None


def test_settings_that_cannot_be_read_are_exit_2(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 2
    assert main(["{"]) == 2
    assert main(['{"autopilot": "betaflight", "link": "x", "seed": 1}']) == 2
    assert "betaflight" in capsys.readouterr().err
