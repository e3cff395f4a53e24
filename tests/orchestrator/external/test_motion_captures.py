"""Motion capture from outside reaches its vehicles, and what does not come is said."""

import asyncio
import json
import socket
import sys
import threading
from collections.abc import Mapping
from contextlib import AsyncExitStack
from types import ModuleType
from typing import Any

import pytest

from campaigns.values.external_setups import MocapSetup
from orchestrator.external.motion_captures import MotionCaptures
from tests.orchestrator.external.rigs import until
from tests.ports import free_port
from vehicles.readings import PoseReading, Source
from vehicles.sources.camera_source import SourceError

HOST = "127.0.0.1"


@pytest.fixture
def port() -> int:
    return free_port()


def wanted(port: int, *, stall_s: float = 0.5) -> Mapping[Source, MocapSetup]:
    return {
        "real": MocapSetup(kind="udp", host=HOST, port=port, body="drone", stall_s=stall_s),
        "twin": MocapSetup(kind="udp", host=HOST, port=port, body="other", stall_s=stall_s),
    }


def send(port: int, seq: int, *names: str, **more: Any) -> None:
    pose = {"position_m": [1.0, 2.0, -3.0], "q_wxyz": [1.0, 0.0, 0.0, 0.0]}
    frame = {
        "protocol": "wil/mocap/1",
        "seq": seq,
        "t_s": 100.0 + seq / 100,
        "frame": "ned",
        "bodies": [{"name": name, **pose} for name in names],
        **more,
    }
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
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


async def test_what_cannot_be_read_is_reported(port: int) -> None:
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


class LostTracker:
    """A tracker of a VRPN library that reports two poses, then raises once `lost` is set."""

    lost = threading.Event()

    def __init__(self, address: str) -> None:
        self._count = 0

    def register_change_handler(self, userdata: object, handler: Any, kind: str) -> None:
        self._handler = handler

    def mainloop(self) -> None:
        self._count += 1
        if self._count <= 2:
            pose = {"position": (2.0, 1.0, 3.0), "quaternion": (0.0, 0.0, 0.0, 1.0)}
            self._handler(None, {"sensor": 0, "time": 100.0 + self._count / 100, **pose})
        if self.lost.is_set():
            raise RuntimeError("connection reset")


@pytest.fixture
def vrpn(monkeypatch: pytest.MonkeyPatch) -> MotionCaptures:
    receiver, module = ModuleType("receiver"), ModuleType("vrpn")
    receiver.Tracker = LostTracker  # type: ignore[attr-defined]
    module.receiver = receiver  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "vrpn", module)
    monkeypatch.setattr(LostTracker, "lost", threading.Event())
    setup = MocapSetup(kind="vrpn", host=HOST, port=3883, body="drone", stall_s=60.0)
    return MotionCaptures({"real": setup})


LOST = (
    "VRPN tracker drone@127.0.0.1:3883: the VRPN library failed: RuntimeError: connection reset; "
    "check the VRPN server and the network to it"
)


async def test_a_vrpn_library_that_fails_in_flight_is_named_with_its_error(
    vrpn: MotionCaptures,
) -> None:
    async with AsyncExitStack() as stack:
        await vrpn.open(stack)
        await vrpn.ready()
        vrpn.check()
        assert vrpn.silent(asyncio.get_running_loop().time()) == ""
        LostTracker.lost.set()
        await until(lambda: vrpn.silent(asyncio.get_running_loop().time()) != "")
        assert vrpn.silent(asyncio.get_running_loop().time()) == LOST
        with pytest.raises(SourceError) as failure:
            vrpn.check()
    assert str(failure.value) == LOST
    assert isinstance(failure.value.__cause__, RuntimeError)


async def test_a_vrpn_library_that_fails_at_once_is_named_before_anything_flies(
    vrpn: MotionCaptures, monkeypatch: pytest.MonkeyPatch
) -> None:
    LostTracker.lost.set()
    monkeypatch.setattr(LostTracker, "register_change_handler", lambda *_: None)
    monkeypatch.setattr(LostTracker, "_handler", lambda *_: None, raising=False)
    async with AsyncExitStack() as stack:
        await vrpn.open(stack)
        with pytest.raises(SourceError) as failure:
            await vrpn.ready(20.0)
    assert str(failure.value) == LOST
