from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicles.embedded.physics.states import TruthSample
from vehicles.embedded.process.feed import (
    Datagram,
    FeedError,
    Flag,
    ImuTruth,
    Kind,
    Motion,
    Notice,
    decode,
    encode,
    mocap_datagram,
    mocap_reading,
    truth_datagram,
    truth_sample,
)
from vehicles.embedded.process.injected_faults import Fault, FaultError, parse_fault
from vehicles.readings import PoseReading
from worlds.frames import Pose

number = st.floats(allow_nan=False, allow_infinity=False)
text = st.text(max_size=60).filter(lambda value: len(value.encode()) <= 256)
head = {"seq": st.integers(0, 2**32 - 1), "t_us": st.integers(0, 2**63)}
felts = st.builds(
    ImuTruth,
    st.tuples(number, number, number),
    st.tuples(number, number, number),
    st.tuples(number, number, number, number),
)


def felt(motion: Motion, what: ImuTruth) -> Motion:
    return replace(motion, flags=motion.flags | Flag.HAS_FELT, felt=what)


unfelt = st.builds(
    Motion,
    kind=st.sampled_from([Kind.TRUTH, Kind.MOCAP]),
    flags=st.integers(0, 7).map(Flag),
    position_ned_m=st.tuples(number, number, number),
    q_wxyz=st.tuples(number, number, number, number),
    velocity_ned_m_s=st.tuples(number, number, number),
    text=text,
    **head,
)
motions = unfelt | st.builds(felt, unfelt, felts)
notices = st.builds(Notice, kind=st.sampled_from([Kind.EVENT, Kind.FAULT]), text=text, **head)


@given(motions | notices)
def test_datagrams_survive_the_wire(datagram: Datagram) -> None:
    assert decode(encode(datagram)) == datagram


@given(st.binary(max_size=500))
def test_garbage_is_refused_and_never_crashes(data: bytes) -> None:
    with pytest.raises(FeedError):
        decode(data)


@given(motions | notices, st.data())
def test_damaged_datagrams_never_crash(datagram: Datagram, data: st.DataObject) -> None:
    raw = bytearray(encode(datagram))
    raw[data.draw(st.integers(0, len(raw) - 1))] = data.draw(st.integers(0, 255))
    cut = data.draw(st.integers(0, len(raw)))
    for damaged in (bytes(raw), bytes(raw[:cut])):
        try:
            decode(damaged)
        except FeedError:
            continue


def test_too_long_a_text_is_refused() -> None:
    with pytest.raises(FeedError, match="257 bytes"):
        encode(Notice(Kind.EVENT, 0, 0, "x" * 257))


def test_what_is_felt_and_its_flag_go_together() -> None:
    motion = Motion(Kind.TRUTH, 7, 1, Flag(0), (1, 2, 3), (1, 0, 0, 0), (4, 5, 6))
    with pytest.raises(FeedError, match="go together"):
        encode(replace(motion, flags=Flag.HAS_FELT))
    with pytest.raises(FeedError, match="too short for what is felt"):
        decode(encode(motion)[:6] + b"\x08\0" + encode(motion)[8:])


def test_the_layout_is_the_documented_one() -> None:
    motion = Motion(
        Kind.TRUTH, 7, 1_500_000, Flag.ON_GROUND, (1, 2, 3), (1, 0, 0, 0), (4, 5, 6), "a"
    )
    raw = encode(motion)
    assert raw[:8] == b"WILF\x01\x01\x01\x00"
    assert raw[8:20] == b"\x07\0\0\0" + (1_500_000).to_bytes(8, "little")
    assert len(raw) == 101
    assert raw[100:] == b"a"


def test_samples_and_readings_come_back() -> None:
    pose = Pose.of(1.0, -2.0, 3.0, yaw_rad=0.5)
    sample = TruthSample(
        12.5,
        pose,
        (0.1, 0.2, 0.3),
        on_ground=True,
        motors_stopped=False,
        contact="wall",
        rates_frd_rad_s=(1.0, 2.0, 3.0),
        specific_force_frd_m_s2=(0.1, -0.2, -9.7),
        thrusts_n=(1.1, 1.2, 1.3, 1.4),
    )
    again = decode(encode(truth_datagram(sample, 3)))
    assert isinstance(again, Motion)
    assert truth_sample(again) == sample
    reading = PoseReading(12.5, 12.6, "twin", pose, None)
    again = decode(encode(mocap_datagram(reading, 3)))
    assert isinstance(again, Motion)
    assert mocap_reading(again, arrived_s=12.6, source="twin") == reading


@given(
    st.sampled_from(["kill", "mute", "unmute"]).map(Fault)
    | st.builds(Fault, st.just("motor"), st.integers(0, 3), st.floats(0.0, 2.0))
)
def test_faults_survive_as_texts(fault: Fault) -> None:
    assert parse_fault(str(fault)) == fault


@pytest.mark.parametrize("text", ["", "explode", "motor", "motor 9 1", "motor x 1", "kill now"])
def test_unknown_faults_are_refused(text: str) -> None:
    with pytest.raises(FaultError, match="is no fault"):
        parse_fault(text)
