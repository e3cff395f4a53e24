"""What is a right answer, and that every other one is refused."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wil_campaign.plugins.readings.messagepack import BadMessageError, MessageHeader, pack_header
from wil_campaign.plugins.simulator.shown_world import AskedWorld
from wil_campaign.plugins.simulator.simulator_protocol import (
    PROTOCOL,
    ImageRequest,
    LateAnswerError,
    SimulatorRefusedError,
    SimulatorWelcome,
    ask_parts,
    hello_parts,
    simulated_image_of,
    welcome_of,
)
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose

SMALL = Intrinsics(8, 6, 10.0, 11.0, 3.5, 2.5, (0.1, 0.0, 0.0, 0.0, 0.0))
ASK = ImageRequest(
    5, 12.25, Pose.of(1.0, 2.0, 3.0, yaw_rad=0.7), SMALL, want_depth=True, want_ids=True
)
IMAGE = np.arange(144, dtype=np.uint8).reshape(6, 8, 3)
DEPTH = np.full((6, 8), 2.5, np.float32)
IDS = np.ones((6, 8), np.uint8)


def right(**changed: Any) -> dict[str, Any]:
    header = {
        "protocol": PROTOCOL,
        "type": "picture",
        "seq": 5,
        "t_s": 12.25,
        "position_ned_m": list(ASK.camera_pose.position_ned_m),
        "q_wxyz": list(ASK.camera_pose.q_wxyz),
        "parts": [
            {"name": "image", "encoding": "bgr8"},
            {"name": "depth", "encoding": "f32"},
            {"name": "ids", "encoding": "u8"},
        ],
    }
    return {key: value for key, value in (header | changed).items() if value != "absent"}


def answer(header: dict[str, Any]) -> list[bytes]:
    return [pack_header(header), IMAGE.tobytes(), DEPTH.tobytes(), IDS.tobytes()]


def test_a_question_carries_all_that_a_simulator_needs() -> None:
    asked = ImageRequest(
        *(5, 12.25, ASK.camera_pose, SMALL),
        want_ids=True,
        events={"start": 3.0},
        moved={"walker": Pose.of(1.0, 2.0, 0.5)},
    )
    (data,) = ask_parts(asked)
    header = MessageHeader.unpack(data)
    assert header.text("protocol") == PROTOCOL
    assert (header.text("type"), header.whole("seq"), header.number("t_s")) == ("ask", 5, 12.25)
    assert header.numbers("position_ned_m", 3) == ASK.camera_pose.position_ned_m
    assert header.numbers("q_wxyz", 4) == ASK.camera_pose.q_wxyz
    assert header.texts("want") == ("image", "ids")
    assert header.table("events") == {"start": 3.0}
    walker = header.header("moved").header("walker")
    assert walker.numbers("position_ned_m", 3) == (1.0, 2.0, -0.5)
    assert walker.numbers("q_wxyz", 4) == (1.0, 0.0, 0.0, 0.0)
    camera = header.header("camera")
    assert (camera.whole("width_px"), camera.number("fy_px")) == (8, 11.0)
    assert camera.numbers("distortion", 5) == SMALL.distortion


def test_the_right_answer_is_taken() -> None:
    picture = simulated_image_of(answer(right()), ASK)
    assert np.array_equal(picture.image_bgr, IMAGE)
    assert picture.depth_m is not None
    assert picture.object_ids is not None
    assert np.array_equal(picture.depth_m, DEPTH)
    assert np.array_equal(picture.object_ids, IDS)


def test_depth_and_ids_that_were_not_requested_are_dropped() -> None:
    ask = ImageRequest(5, 12.25, ASK.camera_pose, SMALL)
    picture = simulated_image_of(answer(right()), ask)
    assert picture.depth_m is None
    assert picture.object_ids is None


def test_an_echo_may_have_been_through_single_precision() -> None:
    pose = ASK.camera_pose
    header = right(
        position_ned_m=[float(np.float32(x)) for x in pose.position_ned_m],
        q_wxyz=[float(np.float32(-x)) for x in pose.q_wxyz],
        t_s=float(np.float32(12.25)),
    )
    simulated_image_of(answer(header), ASK)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"protocol": "wil/pictures/2"}, "speaks 'wil/pictures/2'.*update"),
        ({"protocol": "absent"}, "`protocol` is missing"),
        ({"type": "welcome"}, "`type`"),
        ({"seq": 6}, "not sent yet"),
        ({"seq": 5.0}, "`seq`"),
        ({"seq": True}, "`seq`"),
        ({"seq": "absent"}, "`seq`"),
        ({"t_s": 12.26}, r"another time: \+0\.0100"),
        ({"position_ned_m": [1.0, 2.0, -2.99]}, "another pose: 0.0100 m"),
        ({"position_ned_m": [1.0, 2.0]}, "3 finite numbers"),
        ({"position_ned_m": [1.0, float("nan"), -3.0]}, "3 finite numbers"),
        ({"q_wxyz": [1.0, 0.0, 0.0, 0.0]}, "another pose"),
        ({"parts": []}, "lists 0 parts, 3 arrived"),
        ({"parts": 3}, "list of maps"),
        ({"parts": [{"name": "image"}] * 3}, "`encoding` is missing"),
        ({"parts": [{"name": "image", "encoding": "bgr8"}] * 3}, "a name twice"),
        ({"parts": [{"name": k, "encoding": "u8"} for k in "xyz"]}, "requested were"),
    ],
)
def test_a_wrong_answer_says_what_is_wrong(changed: dict[str, Any], words: str) -> None:
    with pytest.raises(BadMessageError, match=words):
        simulated_image_of(answer(right(**changed)), ASK)


def test_wrong_arrays_are_refused() -> None:
    header = pack_header(right())
    good = [IMAGE.tobytes(), DEPTH.tobytes(), IDS.tobytes()]
    nan = DEPTH.copy()
    nan[0, 0] = np.nan
    for k, bad in ((0, IMAGE.tobytes()[1:]), (1, nan.tobytes()), (2, DEPTH.tobytes())):
        parts = [header, *good]
        parts[k + 1] = bad
        with pytest.raises(BadMessageError, match=r"image|depth|ids"):
            simulated_image_of(parts, ASK)
    with pytest.raises(BadMessageError, match="lists 3 parts, 2 arrived"):
        simulated_image_of([header, *good[:2]], ASK)
    for count in (0, 20):
        with pytest.raises(BadMessageError, match="parts"):
            simulated_image_of([header] * count, ASK)


def test_late_answers_and_refusals_are_distinguished() -> None:
    with pytest.raises(LateAnswerError, match="request 4"):
        simulated_image_of(answer(right(seq=4, t_s=0.0)), ASK)
    refusal = pack_header(
        {"protocol": PROTOCOL, "type": "error", "seq": 5, "message": "no such map"}
    )
    with pytest.raises(SimulatorRefusedError, match="no such map"):
        simulated_image_of([refusal], ASK)


@given(st.lists(st.binary(max_size=60), max_size=5))
def test_garbage_is_refused(parts: list[bytes]) -> None:
    with pytest.raises(BadMessageError):
        simulated_image_of(parts, ASK)
    with pytest.raises(BadMessageError):
        welcome_of(parts)


KEYS = sorted(right())


@given(
    key=st.sampled_from(KEYS),
    value=st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text()
    | st.lists(st.floats()),
)
def test_no_change_of_the_header_gives_another_picture(key: str, value: object) -> None:
    try:
        data = pack_header(right(**{key: value}))
    except OverflowError:
        return
    try:
        picture = simulated_image_of([data, IMAGE.tobytes(), DEPTH.tobytes(), IDS.tobytes()], ASK)
    except BadMessageError:
        return
    assert np.array_equal(picture.image_bgr, IMAGE)


def test_greetings_name_the_world_and_its_objects() -> None:
    (data,) = hello_parts(AskedWorld("gate", "small", ids={"gate": 2}))
    header = MessageHeader.unpack(data)
    assert (header.text("type"), header.table("objects")) == ("hello", {"gate": 2.0})
    assert (header.text("world"), header.text("case")) == ("gate", "small")
    reply = {"protocol": PROTOCOL, "type": "welcome", "simulator": "unity 6", "objects": ["gate"]}
    assert welcome_of([pack_header(reply)]) == SimulatorWelcome("unity 6", ("gate",))
    with pytest.raises(BadMessageError, match="`type` is 'picture'"):
        welcome_of([pack_header({**reply, "type": "picture"})])
    with pytest.raises(SimulatorRefusedError, match="no such world"):
        welcome_of([pack_header({**reply, "type": "error", "message": "no such world"})])
