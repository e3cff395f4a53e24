"""The camera of a vehicle that flies alone: found by a client, and what it shows is the world."""

import asyncio
import math
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, Self

import av
import numpy as np
import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.ports import free_port
from tests.vehicles.embedded.conftest import Rig
from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.foundation.files.documents import load_document
from wil_campaign.plugins.outlets.image_delivery import DeliveryCounts
from wil_campaign.plugins.standalone.vehicle_camera import INTRINSICS, RATE_HZ, VehicleCamera
from wil_campaign.vehicles.cameras.camera_effects import CameraQuality
from wil_campaign.vehicles.cameras.rendered_cameras import compute_inline
from wil_campaign.vehicles.embedded.process.vehicle_faults import VehicleFaults
from wil_campaign.vehicles.faults import parse_fault
from wil_campaign.vehicles.poses.pose_history import PoseHistory
from wil_campaign.vehicles.poses.truth import TruthSample
from wil_campaign.vehicles.readings import BgrImage, CameraReading
from wil_campaign.vehicles.sensors.world_views import WorldImages
from wil_campaign.worlds.frames import Pose
from wil_campaign.worlds.scene.scene import Scene
from wil_campaign.worlds.world_file.world import World

WITHIN_S = 120.0
CAMERA_ID = 100
WORLD = """\
schema: wil/world/1
origin: {latitude_deg: 46.5, longitude_deg: 7.5, altitude_m: 500}
objects:
  box:
    shape: {box: {size_m: [1, 1, 1]}}
    pose: {north_m: 4, east_m: 0.6, up_m: 0.5}
    color: [250, 40, 30]
"""
EMPTY = "schema: wil/world/1\norigin: {latitude_deg: 46.5, longitude_deg: 7.5, altitude_m: 500}\n"


def scene_of(text: str, folder: Path) -> Scene:
    file = folder / "world.yaml"
    file.write_text(text)
    return World.parse(load_document(file)).scene("real", "W")


def view(scene: Scene, body: Pose) -> BgrImage:
    """Return what the renderer shows from a body's pose."""
    return WorldImages(scene=scene, events={}).picture(body, INTRINSICS, 0.0).image_bgr


def difference(a: BgrImage, b: BgrImage) -> float:
    """Return the mean difference of two images, grey levels."""
    return float(np.mean(np.abs(a.astype(np.float64) - b.astype(np.float64))))


class KeptImages:
    """A delivery that keeps what it is given."""

    name = "kept"
    trouble = ""
    counts = DeliveryCounts(0, 0, 0, 0)

    def __init__(self) -> None:
        self.readings: list[CameraReading] = []

    def deliver(self, reading: CameraReading) -> None:
        self.readings.append(reading)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        pass


class Outside:
    """What a test of a camera in virtual time looks at."""

    def __init__(self, rig: Rig, scene: Scene) -> None:
        self.kept = KeptImages()
        quality = replace(CameraQuality(), latency_s=0.02)
        self.camera = VehicleCamera(
            scene=scene, quality=quality, delivery=self.kept, port=5600, compute=compute_inline
        )
        self.faults = VehicleFaults(rig.vehicle, kill=lambda: None, report=lambda _: None)
        self.truths = PoseHistory(60.0)

        def add(sample: TruthSample) -> None:
            self.truths.add(sample.t_s, sample.pose)

        rig.vehicle.on_truth(add, 250.0)


def test_its_pictures_are_those_of_the_renderer_from_its_true_pose(
    tmp_path: Path,
) -> None:
    scene = scene_of(WORLD, tmp_path)

    async def scenario() -> None:
        async with Rig(autopilot="px4") as r:
            outside = Outside(r, scene)
            await r.hover(1.0)
            async with outside.camera.attach(r.vehicle, outside.faults):
                await asyncio.sleep(1.0)
                assert await r.command(mavlink.MAV_CMD_NAV_LAND) == 0
                await asyncio.sleep(2.0)
            readings = outside.kept.readings
            assert len(readings) == pytest.approx(3 * RATE_HZ, abs=2)
            for reading in (readings[2], readings[30], readings[-1]):
                pose = outside.truths.at(reading.t_s).pose
                assert pose is not None
                assert difference(reading.image_bgr, view(scene, pose)) < 0.5
            heights = [view(scene, Pose.of(0.0, 0.0, up)) for up in (0.2, 1.0)]
            assert difference(*heights) > 5.0

    run_virtual(scenario())


def test_its_faults_stop_and_freeze_the_pictures(
    tmp_path: Path,
) -> None:
    scene = scene_of(WORLD, tmp_path)

    async def scenario() -> None:
        async with Rig(autopilot="px4") as r:
            outside = Outside(r, scene)
            kept = outside.kept.readings
            async with outside.camera.attach(r.vehicle, outside.faults):
                outside.faults.inject(parse_fault("camera stop@1+1"))
                outside.faults.inject(parse_fault("camera freeze@3"))
                began_s = asyncio.get_running_loop().time()
                await r.hover(1.0)
            after = [(one.arrived_s - began_s, one) for one in kept]
            assert [t_s for t_s, _ in after if t_s < 1.0]
            assert not [t_s for t_s, _ in after if 1.0 < t_s < 2.0]
            assert [t_s for t_s, _ in after if 2.0 < t_s < 3.0]
            frozen = [one for t_s, one in after if t_s > 3.0]
            assert len(frozen) > 30
            assert all(one.image_bgr is frozen[0].image_bgr for one in frozen)
            assert len({one.t_s for one in frozen}) == len(frozen)

    run_virtual(scenario())


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_a_client_finds_the_camera_beside_the_autopilot(tmp_path: Path, autopilot: str) -> None:
    scene = scene_of(EMPTY, tmp_path)

    async def scenario() -> None:
        async with Rig(autopilot=autopilot, system_id=1) as r:
            outside = Outside(r, scene)
            async with outside.camera.attach(r.vehicle, outside.faults):
                await asyncio.sleep(2.5)
                beats = [m for m in r.of("HEARTBEAT") if m.get_srcComponent() == CAMERA_ID]
                assert [m.type for m in beats] == [mavlink.MAV_TYPE_CAMERA] * 3
                for wanted in (259, 260, 269):
                    r.send(
                        mavlink.MAVLink_command_long_message(
                            1, CAMERA_ID, 512, 0, wanted, *(0.0,) * 6
                        )
                    )
                await asyncio.sleep(0.1)
                acks = [m for m in r.of("COMMAND_ACK") if m.command == 512]
                assert [(m.get_srcComponent(), m.result) for m in acks] == [(CAMERA_ID, 0)] * 3
                assert r.last["CAMERA_INFORMATION"].resolution_h == 640
                assert r.last["VIDEO_STREAM_INFORMATION"].uri == "5600"
                assert r.last["CAMERA_SETTINGS"].mode_id == mavlink.CAMERA_MODE_VIDEO
                r.vehicle.mute(muted=True)
                await asyncio.sleep(0.05)  # what is under way
                since = len(r.heard)
                await asyncio.sleep(2.0)
                assert len(r.heard) == since

    run_virtual(scenario())


@pytest.fixture
def client_and_video(tmp_path: Path) -> Iterator[tuple[Any, int]]:
    """Start the command in a world, and connect; the program ends with the test."""
    file = tmp_path / "world.yaml"
    file.write_text(WORLD)
    port, video = free_port(), free_port()
    with subprocess.Popen(  # noqa: S603 - our own interpreter
        [
            *(sys.executable, "-m", "wil_campaign", "vehicle", "px4", "--camera"),
            *("--world", str(file), "--video", f"127.0.0.1:{video}", "--profile", "px4-sih"),
            *("--link", f"udpout://127.0.0.1:{port}"),
        ],
        stderr=subprocess.PIPE,
        text=True,
    ) as program:
        try:
            link = mavutil.mavlink_connection(f"udpin:127.0.0.1:{port}")
            yield link, video
            link.close()
        finally:
            program.terminate()
            said = program.communicate()[1]
    assert program.returncode == 0, said
    assert f"camera at 127.0.0.1:{video}" in said


def ask(link: Any, command: int, *params: float) -> None:
    values = [*params, *(0.0,) * (7 - len(params))]
    link.mav.command_long_send(1, CAMERA_ID, command, 0, *values)


def received(link: Any, kind: str) -> Any:
    message = link.recv_match(type=kind, blocking=True, timeout=WITHIN_S)
    assert message is not None, kind
    return message


def decoded(uri: str, folder: Path) -> BgrImage:
    """Return a picture of the stream of which nothing but its URI (a port) is known."""
    sdp = folder / "announced.sdp"
    sdp.write_text(
        "v=0\r\nc=IN IP4 127.0.0.1\r\nt=0 0\r\n"
        f"m=video {uri} RTP/AVP 96\r\na=rtpmap:96 H264/90000\r\n"
    )
    options = {"protocol_whitelist": "file,udp,rtp"}
    with av.open(str(sdp), format="sdp", options=options, timeout=(60.0, 30.0)) as container:
        for number, frame in enumerate(container.decode(video=0)):
            if number == 5:
                image: BgrImage = frame.to_ndarray(format="bgr24")
                return image
    raise AssertionError("the stream ended")


def test_a_ground_station_s_connect_sequence_ends_at_pictures_of_the_world(
    client_and_video: tuple[Any, int], tmp_path: Path
) -> None:
    link, video = client_and_video
    deadline_s = time.monotonic() + WITHIN_S
    while received(link, "HEARTBEAT").get_srcComponent() != CAMERA_ID:
        assert time.monotonic() < deadline_s
    ask(link, mavlink.MAV_CMD_REQUEST_CAMERA_INFORMATION, 1)
    told = received(link, "CAMERA_INFORMATION")
    assert told.flags & mavlink.CAMERA_CAP_FLAGS_HAS_VIDEO_STREAM
    ask(link, mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_VIDEO_STREAM_INFORMATION)
    stream = received(link, "VIDEO_STREAM_INFORMATION")
    assert (stream.uri, stream.encoding) == (str(video), mavlink.VIDEO_STREAM_ENCODING_H264)
    assert (stream.get_srcSystem(), stream.get_srcComponent()) == (1, CAMERA_ID)

    image = decoded(stream.uri, tmp_path)
    scene, empty = scene_of(WORLD, tmp_path), scene_of(EMPTY, tmp_path)
    # What came while the video was decoded has filled the socket: an answer may be dropped.
    deadline_s, truth = time.monotonic() + WITHIN_S, None
    while truth is None:
        assert time.monotonic() < deadline_s
        link.mav.command_long_send(1, 1, 512, 0, 115, *(0.0,) * 6)
        truth = link.recv_match(type="HIL_STATE_QUATERNION", blocking=True, timeout=1.0)
    w, x, y, z = truth.attitude_quaternion
    on_ground = Pose((0.0, 0.0, 0.0), (w, x, y, z))
    assert math.hypot(w, x, y, z) == pytest.approx(1.0, abs=1e-3)
    assert difference(image, view(scene, on_ground)) < 4.0
    assert difference(image, view(empty, on_ground)) > 8.0
