"""Connects as QGroundControl does, twice; run as a program: URL px4|ardupilot.

What it sends, and what it needs for an answer, is read off QGroundControl's source: its
InitialConnectStateMachine.cc (commit 0e18c938), RequestMetaDataTypeStateMachine.cc (0ae35b5c),
StandardModes.cc, ParameterManager.cc and APMFirmwarePlugin.cc; of the managers of files, plans,
cameras and gimbals partly from memory. QGroundControl itself is not run: it has no mode without a
screen. Between both connections a plan is uploaded, as its Plan view does.
A line for each step, and exit code 0 when all of it worked.
"""

import struct
import sys
import time
import zlib
from collections.abc import Callable
from typing import Any

from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from pymavlink.mavftp import MAVFTP

WITHIN_S = 20.0
AVAILABLE_MODES, COMPONENT_METADATA, COMPONENT_INFORMATION = 435, 397, 395
CAMERA_INFORMATION, GIMBAL_MANAGER_INFORMATION = 259, 280
STREAMS = {1: 2, 2: 2, 3: 2, 6: 3, 10: 10, 11: 10, 12: 3}
"""MAV_DATA_STREAM and rate, by QGroundControl's defaults for ArduPilot."""
OF_UPLOADS = frozenset({"MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ACK"})
OPEN, READ_BURST, TERMINATE, ACK, NAK = 4, 15, 1, 128, 129


class Station:
    """A ground station that asks one thing at a time, and gives up as QGroundControl does."""

    def __init__(self, url: str, autopilot: str) -> None:
        self.is_px4 = autopilot == "px4"
        self.link: Any = mavutil.mavlink_connection(url, source_system=255, source_component=190)
        self.seen: set[str] = set()
        self._beat_s = -1.0
        self.wait(lambda m: m.get_type() == "HEARTBEAT" and m.get_srcComponent() == 1)

    @property
    def mav(self) -> Any:
        """Return what packs its messages: of MAVLink 2 once the vehicle speaks it."""
        return self.link.mav

    def wait(self, wanted: Callable[[Any], bool], within_s: float = WITHIN_S) -> Any:
        """Return the next message that is wanted; beat meanwhile. Raises TimeoutError."""
        end_s = time.monotonic() + within_s
        while (now_s := time.monotonic()) < end_s:
            if now_s > self._beat_s + 1.0:
                self._beat_s = now_s
                self.mav.heartbeat_send(6, 8, mavlink.MAV_MODE_MANUAL_ARMED, 0, 4)
            message = self.link.recv_match(blocking=True, timeout=0.2)
            if message is not None:
                self.seen.add(message.get_type())
                if wanted(message):
                    return message
        raise TimeoutError(f"not in {within_s:g} s; seen: {sorted(self.seen)}")

    def command(self, number: int, *params: float) -> int:
        """Send a COMMAND_LONG; return the result."""
        values = [*params, *(0.0,) * (7 - len(params))]
        self.mav.command_long_send(1, 1, number, 0, *values)
        ack = self.wait(lambda m: m.get_type() == "COMMAND_ACK" and m.command == number)
        return int(ack.result)

    def request(self, number: int, param: float = 0.0) -> Any | None:
        """Return a requested message; None where the vehicle refuses it, which it says at once.

        It needs the acknowledgement and the message, in any order.
        """
        self.mav.command_long_send(
            1, 1, mavlink.MAV_CMD_REQUEST_MESSAGE, 0, number, param, *[0] * 5
        )
        found: Any = None
        acked = False
        while found is None or not acked:
            each = self.wait(
                lambda m: (
                    m.get_msgId() == number
                    or (
                        m.get_type() == "COMMAND_ACK"
                        and m.command == mavlink.MAV_CMD_REQUEST_MESSAGE
                    )
                )
            )
            if each.get_msgId() == number:
                found = each
            elif each.result == mavlink.MAV_RESULT_ACCEPTED:
                acked = True
            else:
                return None
        return found

    def parameters_by_list(self) -> tuple[dict[str, bytes], int]:
        """Return names and bytes of all parameters, and the hash that PX4 sends first."""
        self.mav.param_request_list_send(1, 0)
        values: dict[int, Any] = {}
        hashed = 0
        while True:
            each = self.wait(lambda m: m.get_type() == "PARAM_VALUE")
            if each.param_id == "_HASH_CHECK":
                hashed = struct.unpack("<I", struct.pack("<f", each.param_value))[0]
                continue
            values[each.param_index] = each
            if len(values) == each.param_count:
                listed = [values[k] for k in sorted(values)]
                return {m.param_id: struct.pack("<f", m.param_value) for m in listed}, hashed

    def file(self, name: str) -> bytes:
        """Return a file by MAVLink FTP: open, read in bursts, terminate. Raises OSError."""
        reply = self._file_operation(1, OPEN, data=name.encode())
        if reply[3] != ACK:
            raise OSError(f"{name}: error {reply[12]}")
        size, session = int.from_bytes(reply[12:16], "little"), reply[2]
        content, seq = b"", 2
        while len(content) < size:
            reply = self._file_operation(seq, READ_BURST, session=session, offset=len(content))
            while reply[3] == ACK:
                assert int.from_bytes(reply[8:12], "little") == len(content)
                content += reply[12 : 12 + reply[4]]
                if reply[6]:  # the burst is complete
                    break
                reply = self._file_reply(READ_BURST)
            seq += 1
        self._file_operation(seq, TERMINATE, session=session)
        return content

    def _file_operation(
        self, seq: int, opcode: int, *, session: int = 0, data: bytes = b"", offset: int = 0
    ) -> bytes:
        size = len(data) or 239
        head = struct.pack("<HBBBBBBI", seq, session, opcode, size, 0, 0, 0, offset)
        payload = list((head + data).ljust(251, b"\0"))
        self.mav.file_transfer_protocol_send(0, 1, 1, payload)
        return self._file_reply(opcode)

    def _file_reply(self, opcode: int) -> bytes:
        reply = self.wait(
            lambda m: m.get_type() == "FILE_TRANSFER_PROTOCOL" and m.payload[5] == opcode
        )
        return bytes(reply.payload)

    def download(self, kind: int) -> list[Any]:
        """Return the items of a plan: 0 mission, 1 fence, 2 rally points."""
        self.mav.mission_request_list_send(1, 1, kind)
        count = self.wait(lambda m: m.get_type() == "MISSION_COUNT" and m.mission_type == kind)
        items = []
        for seq in range(count.count):
            self.mav.mission_request_int_send(1, 1, seq, kind)
            items.append(self._item(seq))
        self.mav.mission_ack_send(1, 1, mavlink.MAV_MISSION_ACCEPTED, kind)
        return items

    def _item(self, seq: int) -> Any:
        return self.wait(lambda m: m.get_type() == "MISSION_ITEM_INT" and m.seq == seq)

    def upload(self, kind: int, items: list[tuple[int, int, tuple[float, ...]]]) -> None:
        """Upload a plan; items: command, frame, four parameters, latitude, longitude, height."""
        self.mav.mission_count_send(1, 1, len(items), kind)
        while True:
            asked = self.wait(lambda m: m.get_type() in OF_UPLOADS and m.mission_type == kind)
            if asked.get_type() == "MISSION_ACK":
                assert asked.type == mavlink.MAV_MISSION_ACCEPTED, asked
                return
            command, frame, (a, b, c, d, latitude, longitude, up) = items[asked.seq]
            x, y = round(latitude * 1e7), round(longitude * 1e7)
            values = (command, int(asked.seq == 0 and kind == 0), 1, a, b, c, d, x, y, up, kind)
            self.mav.mission_item_int_send(1, 1, asked.seq, frame, *values)


def report(text: str) -> None:
    """Tell that something worked."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def connect(station: Station) -> tuple[dict[str, bytes], list[list[Any]]]:
    """Go through the states of InitialConnectStateMachine; return parameters and plans."""
    version = station.request(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
    assert version is not None
    assert version.flight_sw_version >> 24
    needed = mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2 | mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_INT
    assert version.capabilities & needed == needed
    modes, number = [], 1
    while True:
        mode = station.request(AVAILABLE_MODES, number)
        assert mode is not None
        entry = bytes(mode.get_msgbuf()[10:-2])
        modes.append(entry)
        if entry[8] <= number:
            break
        number += 1
    report(f"modes {len(modes)}")
    # The metadata of components comes by FTP, where a vehicle has any: it must refuse at once.
    assert station.request(COMPONENT_METADATA) is None
    assert station.request(COMPONENT_INFORMATION) is None
    parameters = _parameters(station)
    report(f"parameters {len(parameters)}")
    plans = [station.download(kind) for kind in range(3)]
    report(f"plans {[len(plan) for plan in plans]}")
    return parameters, plans


def _parameters(station: Station) -> dict[str, bytes]:
    """Return the parameters: of an ArduPilot by its file, of a PX4 by the list, with its hash."""
    if not station.is_px4:
        decoded = MAVFTP.ftp_param_decode(station.file("@PARAM/param.pck?withdefaults=1"))
        return {name.decode(): struct.pack("<f", value) for name, value, _ in decoded.params}
    values, hashed = station.parameters_by_list()
    kept = b"".join(name.encode() + value for name, value in values.items())
    assert zlib.crc32(kept, 0xFFFFFFFF) ^ 0xFFFFFFFF == hashed
    return values


def stop_the_list(station: Station) -> None:
    """Have a PX4 stop its list, as a station does that has the parameters of this hash."""
    station.mav.param_request_list_send(1, 0)
    first = station.wait(lambda m: m.get_type() == "PARAM_VALUE")
    assert first.param_id == "_HASH_CHECK"
    station.mav.param_set_send(1, 1, b"_HASH_CHECK", first.param_value, 5)
    end_s = time.monotonic() + 3.0
    last_s = time.monotonic()
    while time.monotonic() < end_s and time.monotonic() < last_s + 0.7:
        if station.link.recv_match(type="PARAM_VALUE", blocking=True, timeout=0.1) is not None:
            last_s = time.monotonic()
    assert time.monotonic() >= last_s + 0.7, "the list goes on"


def after_connecting(station: Station) -> None:
    """Ask for what its views and managers ask for once a vehicle is there."""
    for number in (GIMBAL_MANAGER_INFORMATION, CAMERA_INFORMATION):
        assert station.request(number) is None
    assert station.command(mavlink.MAV_CMD_REQUEST_CAMERA_INFORMATION, 1) != 0
    if not station.is_px4:
        for stream, rate_hz in STREAMS.items():
            station.mav.request_data_stream_send(1, 1, stream, rate_hz, 1)
    for number in (mavlink.MAVLINK_MSG_ID_HOME_POSITION, mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE):
        assert station.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, number, 1_000_000) == 0
    home = station.request(mavlink.MAVLINK_MSG_ID_HOME_POSITION)
    assert home is not None
    assert abs(home.latitude) > 0
    missing = {"GLOBAL_POSITION_INT", "ATTITUDE", "VFR_HUD", "SYS_STATUS", "GPS_RAW_INT"}
    missing |= {"HOME_POSITION", "EXTENDED_SYS_STATE"}
    station.seen.clear()
    station.wait(lambda _: missing <= station.seen)
    report("views")


def plan(station: Station) -> None:
    """Upload a mission, a fence and a rally point."""
    home = station.request(mavlink.MAVLINK_MSG_ID_HOME_POSITION)
    assert home is not None
    latitude, longitude = home.latitude * 1e-7, home.longitude * 1e-7
    north = (0.0, 0.0, 0.0, 0.0, latitude + 1e-4, longitude, 5.0)
    here = (0.0, 0.0, 0.0, 0.0, latitude, longitude, 5.0)
    home_item = [] if station.is_px4 else [(16, 0, (*here[:6], 488.0))]
    station.upload(0, [*home_item, (22, 3, here), (16, 3, north)])
    station.upload(1, [(mavlink.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION, 0, (80.0, *here[1:6], 0.0))])
    station.upload(2, [(mavlink.MAV_CMD_NAV_RALLY_POINT, 3, north)])
    report("uploaded")


def main(url: str, autopilot: str) -> None:
    """Connect, use, plan, and connect again."""
    station = Station(url, autopilot)
    first, empty = connect(station)
    assert [len(one) for one in empty] == [0, 0, 0]
    after_connecting(station)
    plan(station)
    second, plans = connect(station)
    assert set(second) >= set(first)
    assert [[one.command for one in kind] for kind in plans] == [
        [22, 16] if station.is_px4 else [16, 22, 16],
        [mavlink.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION],
        [mavlink.MAV_CMD_NAV_RALLY_POINT],
    ]
    if station.is_px4:
        stop_the_list(station)
    report("connected again")
    station.link.close()


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2])
