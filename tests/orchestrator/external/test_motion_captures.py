"""Motion capture from outside reaches its vehicles, and what does not come is said."""

import asyncio
import json
import socket
from collections.abc import Mapping
from contextlib import AsyncExitStack, nullcontext
from dataclasses import replace
from typing import Any

import pytest

from tests.orchestrator.external.rigs import until
from tests.ports import free_port
from wil_campaign.campaigns.values.external_setups import MocapSetup
from wil_campaign.orchestrator.external.motion_captures import MotionCaptures
from wil_campaign.vehicles.readings import PoseReading, Source
from wil_campaign.vehicles.sources.camera_source import SourceError

HOST = "127.0.0.1"


@pytest.fixture
def port() -> int:
    return free_port()


def wanted(port: int, *, stall_s: float = 0.5) -> Mapping[Source, MocapSetup]:
    return {
        "real": MocapSetup(kind="udp", host=HOST, port=port, body="drone", stall_s=stall_s),
        "twin": MocapSetup(kind="udp", host=HOST, port=port, body="other", stall_s=stall_s),
    }


def send(port: int, seq: int, *names: str, end: socket.socket | None = None, **more: Any) -> None:
    pose = {"position_m": [1.0, 2.0, -3.0], "q_wxyz": [1.0, 0.0, 0.0, 0.0]}
    frame = {
        "protocol": "wil/mocap/1",
        "seq": seq,
        "t_s": 100.0 + seq / 100,
        "frame": "ned",
        "bodies": [{"name": name, **pose} for name in names],
        **more,
    }
    with nullcontext(end) if end else socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        out.sendto(json.dumps(frame).encode(), (HOST, port))


async def test_two_vehicles_share_one_port(port: int) -> None:
    captures, poses = MotionCaptures(wanted(port)), list[PoseReading]()
    assert captures.listen("real", poses.append)
    assert captures.listen("twin", poses.append)
    async with AsyncExitStack() as stack:
        await captures.open(stack)
        send(port, 0, "drone", "other", "wand")
        await captures.ready()
        await until(lambda: len(poses) == 2)
    assert {pose.source for pose in poses} == {"real", "twin"}
    assert [result.feed.samples for result in captures.results] == [1, 1]
    assert captures.results[0].address == f"udp://127.0.0.1:{port}"


def test_a_vehicle_without_motion_capture_from_outside_is_reported(port: int) -> None:
    assert not MotionCaptures({}).listen("real", print)


async def test_a_port_where_nothing_comes_is_reported_before_anything_flies(port: int) -> None:
    async with AsyncExitStack() as stack:
        captures = MotionCaptures(wanted(port))
        await captures.open(stack)
        with pytest.raises(SourceError, match=r"did not show 'drone' \(real\).*no message arrived"):
            await captures.ready(0.2)


async def test_a_body_that_is_not_among_those_that_come_is_reported(port: int) -> None:
    async with AsyncExitStack() as stack:
        captures = MotionCaptures(wanted(port))
        await captures.open(stack)
        send(port, 0, "wand")
        await until(lambda: captures.results[0].feed.invalid == 1)
        with pytest.raises(SourceError, match="1 frames did not contain it; check its name"):
            await captures.ready(0.2)


async def test_motion_capture_messages_that_cannot_be_read_are_reported(port: int) -> None:
    async with AsyncExitStack() as stack:
        captures = MotionCaptures(wanted(port))
        await captures.open(stack)
        send(port, 0, "drone", protocol="vicon")
        await until(lambda: captures.results[0].garbage == 1)
        with pytest.raises(SourceError, match=r"1 messages cannot be read.*speaks"):
            await captures.ready(0.2)


async def test_a_feed_that_falls_silent_is_named_with_its_limit(port: int) -> None:
    captures = MotionCaptures(wanted(port, stall_s=0.5))
    async with AsyncExitStack() as stack:
        await captures.open(stack)
        send(port, 0, "drone", "other")
        await captures.ready()
        seen_s = asyncio.get_running_loop().time()
        assert captures.silent(seen_s) == ""
        said = captures.silent(seen_s + 0.6)
    assert "has not seen 'drone' (real) for more than 0.5 s" in said


async def test_a_second_sender_is_refused_before_arming_unless_one_is_named(port: int) -> None:
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as system,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger,
    ):
        for name in ("", HOST):
            captures = MotionCaptures(
                {one: replace(setup, sender=name) for one, setup in wanted(port).items()}
            )
            async with AsyncExitStack() as stack:
                await captures.open(stack)
                send(port, 0, "drone", "other", end=system)
                await captures.ready()
                captures.refuse_rivals()
                send(port, 9, "drone", end=stranger)
                await until(lambda: len(captures.others) == 1)  # noqa: B023 - at once
                assert "is sent to by 127.0.0.1:" in captures.results[0].trouble
                assert [result.feed.samples for result in captures.results] == [1, 1]
                if name:
                    captures.refuse_rivals()
                else:
                    with pytest.raises(SourceError, match=r"end the other.*mocap\.sender"):
                        captures.refuse_rivals()
