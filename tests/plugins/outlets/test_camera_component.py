"""A ground station finds the mixed picture as a MAVLink camera."""

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.plugins.outlets.camera_component import CameraComponent, VideoStream
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec
from wil_campaign.worlds.camera import Intrinsics

CAMERA = Intrinsics.from_fov(641, 480, math.radians(69.0))


def component(**more: Any) -> CameraComponent:
    stream = VideoStream(port=5604, rate_hz=15.0, name="mixed")
    return CameraComponent(system_id=2, intrinsics=CAMERA, stream=stream, **more)


def command(number: int, *parameters: float, system: int = 2, target: int = 100) -> Any:
    """Return a command as it arrives from ground station 255/190."""
    filled = (*parameters, *([0.0] * (7 - len(parameters))))
    message = mavlink.MAVLink_command_long_message(system, target, number, 0, *filled)
    return over_the_wire(message, system=255, component=190)


def over_the_wire(message: Any, *, system: int, component: int) -> Any:
    sender = MavlinkCodec(system_id=system, component_id=component)
    (received,) = MavlinkCodec(system_id=1, component_id=1).parse(sender.pack(message))
    return received


def answers(camera: CameraComponent, message: Any, t_s: float = 3.0) -> list[Any]:
    return [
        over_the_wire(answer, system=camera.system_id, component=camera.component_id)
        for answer in camera.receive(message, t_s)
    ]


def test_it_sends_a_heartbeat_once_a_second() -> None:
    camera = component(start_s=10.0)
    beats = [t for t in range(3000) if camera.tick(10.0 + t / 1000)]
    assert beats == [0, 1000, 2000]
    (beat,) = component().tick(0.0)
    heard = over_the_wire(beat, system=2, component=100)
    assert (heard.type, heard.autopilot) == (mavlink.MAV_TYPE_CAMERA, 8)
    assert (heard.get_srcSystem(), heard.get_srcComponent()) == (2, 100)


def test_after_a_pause_it_does_not_make_up_for_the_beats_missed() -> None:
    camera = component()
    camera.tick(0.0)
    assert len(camera.tick(60.0)) == 1
    assert camera.tick(60.5) == []


@pytest.mark.parametrize("ask", [(512, 259.0), (521, 1.0)])
def test_it_says_what_camera_it_is(ask: tuple[int, float]) -> None:
    ack, information = answers(component(start_s=1.0), command(*ask))
    assert (ack.get_type(), ack.command, ack.result) == ("COMMAND_ACK", ask[0], 0)
    assert (ack.target_system, ack.target_component) == (255, 190)
    assert information.get_type() == "CAMERA_INFORMATION"
    assert bytes(information.vendor_name).rstrip(b"\0") == b"wil-campaign"
    assert bytes(information.model_name).rstrip(b"\0") == b"mixed picture"
    assert (information.resolution_h, information.resolution_v) == (641, 480)
    assert information.flags == mavlink.CAMERA_CAP_FLAGS_HAS_VIDEO_STREAM
    assert information.time_boot_ms == 2000


@pytest.mark.parametrize("ask", [(512, 269.0), (512, 269.0, 1.0), (2504, 0.0), (2504, 1.0)])
def test_it_says_where_the_stream_is(ask: tuple[float, ...]) -> None:
    ack, stream = answers(component(), command(int(ask[0]), *ask[1:]))
    assert ack.result == mavlink.MAV_RESULT_ACCEPTED
    assert stream.get_type() == "VIDEO_STREAM_INFORMATION"
    assert (stream.stream_id, stream.count) == (1, 1)
    assert stream.type == mavlink.VIDEO_STREAM_TYPE_RTPUDP
    assert stream.encoding == mavlink.VIDEO_STREAM_ENCODING_H264
    # The protocol: for RTP over UDP the URI is the port alone.
    assert stream.uri == "5604"
    assert stream.name == "mixed"
    assert (stream.framerate, stream.resolution_h, stream.resolution_v) == (15.0, 640, 480)
    assert stream.hfov == 69
    assert stream.flags == mavlink.VIDEO_STREAM_STATUS_FLAGS_RUNNING


@pytest.mark.parametrize(
    ("ask", "name"),
    [
        ((2505, 1.0), "VIDEO_STREAM_STATUS"),
        ((512, 270.0), "VIDEO_STREAM_STATUS"),
        ((522, 1.0), "CAMERA_SETTINGS"),
        ((527, 1.0), "CAMERA_CAPTURE_STATUS"),
        ((512, 0.0), "HEARTBEAT"),
    ],
)
def test_further_questions_of_a_ground_station_are_answered(
    ask: tuple[int, float], name: str
) -> None:
    ack, answer = answers(component(), command(*ask))
    assert ack.result == mavlink.MAV_RESULT_ACCEPTED
    assert answer.get_type() == name


def test_an_unknown_stream_is_denied() -> None:
    (ack,) = answers(component(), command(2504, 2.0))
    assert ack.result == mavlink.MAV_RESULT_DENIED
    (ack,) = answers(component(), command(512, 269.0, 7.0))
    assert ack.result == mavlink.MAV_RESULT_DENIED


@pytest.mark.parametrize("ask", [(512, 33.0), (400, 1.0), (2000, 0.0), (512, float("nan"))])
def test_it_refuses_an_unsupported_command_only_when_it_is_addressed(
    ask: tuple[int, float],
) -> None:
    (ack,) = answers(component(), command(*ask))
    assert (ack.command, ack.result) == (ask[0], mavlink.MAV_RESULT_UNSUPPORTED)
    assert answers(component(), command(*ask, target=0)) == []


def test_others_are_left_alone() -> None:
    for target in ({"system": 3}, {"target": 1}, {"target": 101}):
        assert answers(component(), command(521, 1.0, **target)) == []
    heartbeat = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
    assert answers(component(), over_the_wire(heartbeat, system=255, component=190)) == []


def test_a_broadcast_finds_it() -> None:
    ack, information = answers(component(), command(521, 1.0, system=0, target=0))
    assert ack.result == mavlink.MAV_RESULT_ACCEPTED
    assert information.get_type() == "CAMERA_INFORMATION"


@given(
    number=st.integers(0, 65535),
    parameter=st.floats(width=32),
    system=st.integers(0, 255),
    target=st.integers(0, 255),
)
def test_any_command_is_survived(number: int, parameter: float, system: int, target: int) -> None:
    for answer in answers(component(), command(number, parameter, system=system, target=target)):
        assert answer.get_srcComponent() == 100
