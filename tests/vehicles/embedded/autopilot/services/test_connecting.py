"""What a client gets when it connects: the hash of parameters, missions reported, streams."""

import struct
import zlib
from collections import Counter
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from pymavlink.mavftp import MAVFTP

from tests.vehicles.embedded.autopilot.bare_autopilot import READY_S, BareAutopilot
from tests.vehicles.embedded.autopilot.services.test_missions import BOTH, item

HASH = b"_HASH_CHECK"
PROTOCOL_VERSION = 300
"""In no dialect any more that has ArduPilot's messages."""


def bits(value: float) -> int:
    (number,) = struct.unpack("<I", struct.pack("<f", value))
    return int(number)


def read(bare: BareAutopilot, name: bytes) -> Any:
    (answer,) = bare.send(mavlink.MAVLink_param_request_read_message(1, 1, name, -1))
    return answer


def listed(bare: BareAutopilot, seconds: float = 2.0) -> list[Any]:
    bare.send(mavlink.MAVLink_param_request_list_message(1, 1))
    return [each for each in bare.run(seconds) if each.get_type() == "PARAM_VALUE"]


def test_px4_gives_the_hash_by_which_clients_skip_the_list() -> None:
    bare = BareAutopilot("px4")
    first, *others = listed(bare)
    assert (first.param_id, first.param_type) == ("_HASH_CHECK", mavlink.MAV_PARAM_TYPE_UINT32)
    assert first.param_count == len(others)
    # As a ground station computes it from what it keeps: names and bytes of values, in order.
    kept = b"".join(m.param_id.encode() + struct.pack("<f", m.param_value) for m in others)
    assert bits(first.param_value) == zlib.crc32(kept, 0xFFFFFFFF) ^ 0xFFFFFFFF
    before = bits(read(bare, HASH).param_value)
    assert before == bits(first.param_value)
    bare.send(mavlink.MAVLink_param_set_message(1, 1, b"MPC_XY_CRUISE", 4.0, 9))
    assert bits(read(bare, HASH).param_value) != before


def test_a_ground_station_that_knows_the_hash_stops_the_list() -> None:
    bare = BareAutopilot("px4")
    began = listed(bare, 0.04)
    assert 1 < len(began) < 20
    assert not bare.send(mavlink.MAVLink_param_set_message(1, 1, HASH, 0.0, 5))
    assert not [each for each in bare.run(2.0) if each.get_type() == "PARAM_VALUE"]


def test_arducopter_has_no_hash() -> None:
    bare = BareAutopilot("ardupilot")
    assert not bare.send(mavlink.MAVLink_param_request_read_message(1, 1, HASH, -1))
    assert len(listed(bare)) == len(bare.autopilot.parameters)


@BOTH
def test_unknown_parameters(autopilot: str) -> None:
    bare = BareAutopilot(autopilot)
    answers = bare.send(mavlink.MAVLink_param_request_read_message(1, 1, b"NO_SUCH", -1))
    answers += bare.send(mavlink.MAVLink_param_set_message(1, 1, b"NO_SUCH", 1.0, 9))
    errors = [each.error for each in answers]
    assert errors == ([mavlink.MAV_PARAM_ERROR_DOES_NOT_EXIST] * 2 if autopilot == "px4" else [])


@BOTH
def test_mission_current_without_a_mission(autopilot: str) -> None:
    """PX4's is that of the reference trace; ArduCopter counts without its home."""
    bare = BareAutopilot(autopilot)
    answers = bare.send(mavlink.MAVLink_command_long_message(1, 1, 512, 0, 42.0, 0, 0, 0, 0, 0, 0))
    (current,) = [each for each in answers if each.get_type() == "MISSION_CURRENT"]
    said = (current.seq, current.total, current.mission_state, current.mission_mode)
    assert said == ((0, 65535, 1, 2) if autopilot == "px4" else (0, 0, 1, 0))


def test_px4_streams_by_itself_what_the_trace_has() -> None:
    bare = BareAutopilot("px4", full_streams=True)
    bare.hover()
    sent = Counter(each.get_type() for each in bare.run(4.0))
    for name, rate_hz in {
        "ATTITUDE_QUATERNION": 50.0,
        "ODOMETRY": 30.0,
        "ALTITUDE": 10.0,
        "POSITION_TARGET_GLOBAL_INT": 10.0,
        "HIGHRES_IMU": 50.0,
        "SYSTEM_TIME": 1.0,
    }.items():
        assert sent[name] == pytest.approx(4.0 * rate_hz, abs=1.0), name
    assert bare.command(mavlink.MAV_CMD_GET_MESSAGE_INTERVAL, 436.0) == 0


def test_position_targets_are_places_and_landings_have_no_altitude() -> None:
    bare = BareAutopilot("px4", full_streams=True)
    bare.hover()
    sent = [each for each in bare.run(0.5) if each.get_type() == "POSITION_TARGET_GLOBAL_INT"]
    assert sent[-1].alt == pytest.approx(bare.altitude_m + 3.0, abs=0.5)
    assert sent[-1].coordinate_frame == mavlink.MAV_FRAME_GLOBAL_INT
    assert bare.command(21) == 0
    sent = [each for each in bare.run(0.5) if each.get_type() == "POSITION_TARGET_GLOBAL_INT"]
    assert sent[-1].alt == 0.0


def file_request(
    bare: BareAutopilot, opcode: int, *, data: bytes = b"", offset: int = 0, size: int = 0
) -> list[bytes]:
    """Send a file operation; return the payloads of its replies."""
    head = bytes([7, 0, 0, opcode, size or len(data), 0, 0, 0]) + offset.to_bytes(4, "little")
    payload = list((head + data).ljust(251, b"\0"))
    answers = bare.send(mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, payload))
    assert [each.get_type() for each in answers] == ["FILE_TRANSFER_PROTOCOL"] * len(answers)
    return [bytes(each.payload) for each in answers]


@pytest.mark.parametrize("opcode", [5, 15], ids=["read", "burst"])
def test_arducopter_has_its_parameters_as_a_file(opcode: int) -> None:
    bare = BareAutopilot("ardupilot")
    (opened,) = file_request(bare, 4, data=b"@PARAM/param.pck?withdefaults=1")
    assert opened[3] == 128
    size, content, replies = int.from_bytes(opened[12:16], "little"), b"", 0
    while True:
        answers = file_request(bare, opcode, offset=len(content), size=80)
        for answer in answers:
            replies += 1
            if answer[3] == 128:
                assert int.from_bytes(answer[8:12], "little") == len(content)
                content += answer[12 : 12 + answer[4]]
        if answers[-1][3] == 129:
            assert answers[-1][12] == 6  # the end of the file
            break
    assert len(content) == size
    decoded = MAVFTP.ftp_param_decode(content)
    parameters = bare.autopilot.parameters
    assert [name.decode() for name, _, _ in decoded.params] == list(parameters)
    for name, value, _ in decoded.params:
        assert value == pytest.approx(parameters[name.decode()], rel=1e-6)
    assert file_request(bare, 1)[0][3] == 128
    assert file_request(bare, 5, size=80)[0][3] == 129


@BOTH
def test_other_files_are_not_there(autopilot: str) -> None:
    bare = BareAutopilot(autopilot)
    for opcode, error in {4: 10, 3: 6, 5: 4, 15: 4, 6: 1, 99: 7}.items():
        (answer,) = file_request(bare, opcode, data=b"/etc/extras.txt")
        assert (answer[3], answer[5], answer[12]) == (129, opcode, error)
        assert int.from_bytes(answer[:2], "little") == 8


@BOTH
def test_the_time_of_day_is_that_of_gps_once_it_has_it(autopilot: str) -> None:
    boot_us = 1_795_253_560_000_000
    bare = BareAutopilot(autopilot, boot_unix_us=boot_us)

    def time_us() -> int:
        asked = mavlink.MAVLink_command_long_message(1, 1, 512, 0, 2.0, 0, 0, 0, 0, 0, 0)
        (answer,) = [each for each in bare.send(asked) if each.get_type() == "SYSTEM_TIME"]
        return int(answer.time_unix_usec)

    bare.run(9.0)
    assert time_us() == (boot_us + 9_000_000 if autopilot == "px4" else 0)
    bare.run(1.0)
    assert time_us() == boot_us + 10_000_000
    bare.send(mavlink.MAVLink_system_time_message(boot_us - 5_000_000, 0))
    bare.run(1.0)
    assert time_us() == boot_us + 11_000_000


@BOTH
def test_an_interval_longer_than_the_answer_can_carry_is_answered_as_the_longest(
    autopilot: str,
) -> None:
    bare = BareAutopilot(autopilot)
    assert bare.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 30.0, 3.4e38) == 0
    request = (mavlink.MAV_CMD_GET_MESSAGE_INTERVAL, 0, 30.0, *(0.0,) * 6)
    told, ack = bare.send(mavlink.MAVLink_command_long_message(1, 1, *request))
    assert (told.message_id, told.interval_us) == (30, 2**31 - 1)
    assert ack.result == mavlink.MAV_RESULT_ACCEPTED


def old(message: Any) -> Any:
    """A message as dronekit's v1.0 dialect fills it: the vehicle's system, component 0."""
    message.target_component = 0
    return message


@BOTH
def test_all_that_dronekit_sends_from_connect_to_takeoff_is_answered(autopilot: str) -> None:
    """By the source of dronekit 2.9.2 (commit 243ce0ac): Vehicle.initialize, armed, simple_takeoff.

    dronekit itself flies in tests/vehicles/clients, where it is installed.
    """
    bare = BareAutopilot(autopilot)
    bare.run(READY_S[autopilot])
    gcs = mavlink.MAV_TYPE_GCS
    bare.send(mavlink.MAVLink_heartbeat_message(gcs, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 0, 3))
    bare.send(old(mavlink.MAVLink_request_data_stream_message(1, 0, 0, 4, 1)))
    (version, ack) = bare.send(old(mavlink.MAVLink_command_long_message(1, 0, 520, 0, 1, *[0] * 6)))
    assert version.get_type() == "AUTOPILOT_VERSION"
    assert version.capabilities
    assert ack.result == mavlink.MAV_RESULT_ACCEPTED
    bare.send(old(mavlink.MAVLink_param_request_list_message(1, 0)))
    sent = bare.run(4.0)
    listed = {m.param_index: m for m in sent if m.get_type() == "PARAM_VALUE"}
    count = next(iter(listed.values())).param_count
    assert set(range(count)) <= set(listed), "each by its index, else it asks for those again"
    needed = {"GPS_RAW_INT", "HEARTBEAT", "ATTITUDE", "SYS_STATUS", "GLOBAL_POSITION_INT"}
    needed |= {"VFR_HUD"}
    assert needed <= {m.get_type() for m in sent}, "what wait_ready(True) waits for"
    if autopilot == "ardupilot":
        bare.send(mavlink.MAVLink_set_mode_message(1, 1, 4))
        beats = [m for m in bare.run(1.5) if m.get_type() == "HEARTBEAT"]
        assert beats[-1].custom_mode == 4
    answers = bare.send(old(mavlink.MAVLink_command_long_message(1, 0, 400, 0, 1, *[0] * 6)))
    assert [m.result for m in answers if m.get_type() == "COMMAND_ACK"] == [0]
    takeoff = mavlink.MAVLink_command_long_message(1, 0, 22, 0, *[0] * 6, 3.0)
    answers = bare.send(old(takeoff))
    assert [m.result for m in answers if m.get_type() == "COMMAND_ACK"] == [0]
    assert bare.autopilot.flight.armed


@BOTH
def test_an_upload_is_asked_for_by_each_firmware_s_message_and_a_doubled_item_is_acknowledged(
    autopilot: str,
) -> None:
    bare = BareAutopilot(autopilot)
    bare.run(1.0)
    asked = bare.send(mavlink.MAVLink_mission_count_message(1, 1, 1, 2)) + bare.run(0.1)
    form = "MISSION_REQUEST_INT" if autopilot == "px4" else "MISSION_REQUEST"
    assert [m.get_type() for m in asked if "MISSION_REQUEST" in m.get_type()] == [form]
    rally = item(0, 5100, 2, x=473977400, y=85455900, z=2.0)
    for _ in range(2):
        answers = [m for m in bare.send(rally) + bare.run(0.1) if m.get_type() == "MISSION_ACK"]
        assert [m.type for m in answers] == [mavlink.MAV_MISSION_ACCEPTED]


@BOTH
def test_what_neither_embedded_vehicle_has_is_refused_or_ignored(autopilot: str) -> None:
    bare = BareAutopilot(autopilot)
    bare.hover()
    assert bare.command(mavlink.MAV_CMD_REQUEST_MESSAGE, PROTOCOL_VERSION) != 0
    # Orbit, height, servo, gripper, calibration, storage, arming check, standard mode, banner.
    for number in (34, 186, 183, 211, 241, 245, 401, 262, 42428):
        assert bare.command(number, 1) == mavlink.MAV_RESULT_UNSUPPORTED, number
    upright = [1.0, 0.0, 0.0, 0.0]
    attitude = mavlink.MAVLink_set_attitude_target_message(0, 1, 1, 0, upright, 0, 0, 0, 0.9)
    assert not bare.send(attitude)
    before = bare.autopilot.flight.behaviour
    for _ in range(10):
        bare.send(attitude)
        bare.run(0.1)
    assert bare.autopilot.flight.behaviour is before
    if autopilot == "px4":  # which takes no stream of those for one of offboard's
        refused = {mavlink.MAV_RESULT_TEMPORARILY_REJECTED, mavlink.MAV_RESULT_DENIED}
        assert bare.command(176, 1, 6) in refused
