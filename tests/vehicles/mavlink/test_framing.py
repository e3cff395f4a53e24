"""Frames in a stream: found whole, garbage skipped."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.mavlink.codec import MavlinkCodec
from wil_campaign.vehicles.mavlink.framing import FrameSplitter, frame_header
from wil_campaign.vehicles.mavlink.names import command_name, message_name, result_name


def _messages(count: int) -> list[Any]:
    kinds = [
        lambda n: mavlink.MAVLink_local_position_ned_message(n, 1.0, 2.0, 3.0, 0.0, 0.0, n),
        lambda n: mavlink.MAVLink_heartbeat_message(2, 12, 81, n, 3, 3),
        lambda n: mavlink.MAVLink_statustext_message(6, f"text {n}".encode()),
    ]
    return [kinds[number % 3](number) for number in range(count)]


def _stream(count: int) -> list[bytes]:
    codec = MavlinkCodec(system_id=7, component_id=1)
    return [codec.pack(message) for message in _messages(count)]


def test_pack_counts_its_sequence() -> None:
    raws = _stream(300)
    assert [raw[4] for raw in raws] == [number % 256 for number in range(300)]


@given(
    x=st.floats(-1e6, 1e6, width=32), mask=st.integers(0, 65535), frame=st.sampled_from([0, 1, 9])
)
def test_packs_as_pymavlink_does(x: float, mask: int, frame: int) -> None:
    messages = [
        mavlink.MAVLink_set_position_target_local_ned_message(
            0, 1, 1, frame, mask, x, *[0.0] * 9, x
        ),
        mavlink.MAVLink_command_long_message(1, 1, 400, 0, x, *[0.0] * 6),
        mavlink.MAVLink_heartbeat_message(0, 0, 0, mask, 0, 0),
        mavlink.MAVLink_timesync_message(0, mask),
        mavlink.MAVLink_command_ack_message(mask, 0, 0, mask, frame, 0),
        mavlink.MAVLink_param_set_message(1, 1, b"NAME", x, 9),
        mavlink.MAVLink_attitude_quaternion_message(mask, x, *[0.0] * 6),
        mavlink.MAVLink_statustext_message(frame, b"text"),
        mavlink.MAVLink_mission_count_message(1, 1, mask),
    ]
    codec = MavlinkCodec(system_id=245, component_id=190)
    reference = mavlink.MAVLink(None, srcSystem=245, srcComponent=190)
    for number, message in enumerate(messages):
        packed = codec.pack(message)
        reference.seq = number
        assert packed == bytes(message.pack(reference))


@pytest.mark.parametrize("zeros", [0.0, 0.5, 0.9])
def test_every_message_packs_and_decodes_as_by_pymavlink(zeros: float) -> None:
    rng = np.random.default_rng(5)
    reference = mavlink.MAVLink(None, srcSystem=7, srcComponent=3)
    for kind in mavlink.mavlink_map.values():
        message = kind(*(_value(rng, kind, name, zeros) for name in kind.fieldnames))
        packed = MavlinkCodec(system_id=7, component_id=3).pack(message)
        assert packed == bytes(message.pack(reference))
        (decoded,) = MavlinkCodec(system_id=1, component_id=1).parse(packed)
        assert decoded.to_dict() == reference.decode(bytearray(packed)).to_dict()
        assert (decoded.get_srcSystem(), decoded.get_srcComponent()) == (7, 3)
        assert decoded.get_type() == kind.msgname


def _value(rng: np.random.Generator, kind: Any, name: str, zeros: float) -> Any:
    """Return a value of a field: small whole numbers fit every type, zeros at the end are cut."""
    length = kind.array_lengths[kind.ordered_fieldnames.index(name)]
    if kind.fieldtypes[kind.fieldnames.index(name)] == "char":
        return b"text"[: length or 1]
    values = [int(rng.integers(1, 100)) if rng.random() >= zeros else 0 for _ in range(length or 1)]
    return values if length else values[0]


def test_header_is_read_without_decoding() -> None:
    raw = _stream(3)[2]
    header = frame_header(raw + b"more")
    assert header is not None
    assert (header.message_id, header.system, header.component, header.seq) == (253, 7, 1, 2)
    assert (header.version, header.signed, header.raw) == (2, False, raw)
    assert frame_header(raw[:-1]) is None
    assert frame_header(b"no frame at all") is None
    assert frame_header(b"") is None


def test_mavlink_1_frames_are_found() -> None:
    sender = mavlink.MAVLink(None, srcSystem=9, srcComponent=1)
    raw = bytes(_messages(2)[1].pack(sender, force_mavlink1=True))
    frames = FrameSplitter().feed(b"\xfe\x01" + raw)
    assert [(each.version, each.system, each.message_id) for each in frames] == [(1, 9, 0)]


def test_signed_frames_are_found_and_decoded() -> None:
    sender = mavlink.MAVLink(None, srcSystem=9, srcComponent=1)
    sender.signing.secret_key = b"k" * 32
    sender.signing.sign_outgoing = True
    sender.signing.timestamp = 1
    raw = bytes(_messages(2)[1].pack(sender))
    codec = MavlinkCodec(system_id=1, component_id=1)
    frames = codec.split(raw + raw)
    assert [each.signed for each in frames] == [True, True]
    message = codec.decode(frames[0])
    assert message is not None
    assert message.get_type() == "HEARTBEAT"


@given(
    cuts=st.lists(st.integers(1, 80), max_size=60),
    garbage=st.lists(
        st.one_of(st.binary(max_size=20), st.sampled_from([b"\xfd", b"\xfe", b"\xfd\x05\x00"])),
        min_size=12,
        max_size=12,
    ),
)
def test_every_frame_is_found_whatever_the_pieces_and_garbage(
    cuts: list[int], garbage: list[bytes]
) -> None:
    raws = _stream(12)
    # What a fake start waits for must come: the longest frame's worth of something else.
    stream = b"".join(noise + raw for noise, raw in zip(garbage, raws, strict=True)) + bytes(300)
    splitter = FrameSplitter()
    found: list[bytes] = []
    at = 0
    for cut in [*cuts, len(stream)]:
        found += [frame.raw for frame in splitter.feed(stream[at : at + cut])]
        at += cut
    assert found == raws
    assert splitter.bytes_seen == len(stream)
    assert splitter.garbage_bytes >= sum(map(len, garbage))


@given(st.binary(max_size=600))
def test_parsing_never_raises(data: bytes) -> None:
    codec = MavlinkCodec(system_id=1, component_id=1)
    assert codec.parse(data) == []


def test_broken_frames_are_skipped_and_counted() -> None:
    raws = _stream(3)
    broken = bytearray(raws[1])
    broken[12] ^= 0xFF
    codec = MavlinkCodec(system_id=1, component_id=1)
    messages = codec.parse(raws[0] + bytes(broken) + raws[2])
    assert [message.get_type() for message in messages] == ["LOCAL_POSITION_NED", "STATUSTEXT"]
    assert codec.garbage_bytes == len(broken)


def _unknown_frame(system: int) -> bytes:
    payload = b"\x01\x02\x03"
    return bytes([0xFD, len(payload), 0, 0, 0, system, 1, 0xF0, 0xF0, 0x01]) + payload + b"\xaa\xbb"


def test_unknown_messages_pass_the_splitter_from_known_senders_only() -> None:
    raw = _stream(1)[0]
    splitter = FrameSplitter()
    assert splitter.feed(_unknown_frame(7)) == []
    assert [each.raw for each in splitter.feed(raw + _unknown_frame(7))] == [raw, _unknown_frame(7)]
    codec = MavlinkCodec(system_id=1, component_id=1)
    assert len(codec.parse(raw + _unknown_frame(7) + raw)) == 2
    assert codec.undecodable_frames == 1


def test_commands_results_and_messages_have_names() -> None:
    assert command_name(400) == "MAV_CMD_COMPONENT_ARM_DISARM"
    assert result_name(2) == "MAV_RESULT_DENIED"
    assert result_name(99) == "MAV_RESULT 99"
    assert message_name(32) == "LOCAL_POSITION_NED"
    assert message_name(60001) == "message 60001"


def test_a_stray_header_of_an_unknown_message_swallows_no_frame() -> None:
    raw = _stream(1)[0]
    splitter = FrameSplitter()
    (known,) = splitter.feed(raw)
    stray = bytes((0xFD, 255, 0, 0, 0, known.system, known.component, 0x45, 0x23, 0x01))
    frames = [frame.raw for _ in range(20) for frame in splitter.feed(stray + raw * 20)]
    assert frames == [raw] * 400
