"""What a driver and its mavsdk process say to each other; no process here."""

import json
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.foundation.processes.codec import FrameReader, ProcessMessageError, framed_packet
from wil_campaign.plugins.mavsdk.message_fields import message_fields_json
from wil_campaign.plugins.mavsdk.messages import (
    CallAction,
    ChooseSystem,
    DownloadItems,
    FetchLog,
    FromProcess,
    ListLogs,
    LogProgress,
    MavsdkAlive,
    MavsdkReady,
    MessageNotSent,
    OrderExecuted,
    OrderRefused,
    SendMessage,
    ToProcess,
    UploadItems,
    from_process,
    to_process,
)
from wil_campaign.vehicles.autopilots.autopilot import MavlinkTarget, command_long
from wil_campaign.vehicles.driver.onboard.mission_protocol import ItemList, MissionItem
from wil_campaign.vehicles.driver.onboard.vehicle_logs import LogEntry

ITEM = MissionItem(command=16, params=(1.0, 0.5, 0.0, 2.0), x=473_977_419, y=-85_455_939, z=2.5)
LOG = LogEntry(3, 6978, None)


@pytest.mark.parametrize(
    "message",
    [
        ChooseSystem(1, 7, 5.0),
        SendMessage("HEARTBEAT", '{"type": 6}', 12.5),
        CallAction(2, "return_to_launch"),
        UploadItems(3, ItemList.FENCE, (ITEM, ITEM)),
        DownloadItems(4, ItemList.MISSION),
        ListLogs(5),
        FetchLog(6, LOG, "results/log.part", 60.0),
    ],
)
def test_orders_arrive_as_they_were_given(message: ToProcess) -> None:
    assert to_process.decode(to_process.encode(message)) == message


@pytest.mark.parametrize(
    "message",
    [
        MavsdkReady(),
        MavsdkAlive(2),
        MessageNotSent("HEARTBEAT", "INVALID_FIELD"),
        OrderExecuted(1, items=(ITEM,), logs=(LOG,)),
        OrderRefused(2, "TIMEOUT"),
        LogProgress(3, 0.5),
    ],
)
def test_answers_arrive_as_they_were_given(message: FromProcess) -> None:
    assert from_process.decode(from_process.encode(message)) == message


def test_a_mission_item_may_hold_nan() -> None:
    sent = UploadItems(
        1, ItemList.MISSION, (MissionItem(command=16, params=(0.0, 0.0, 0.0, math.nan)),)
    )
    (item,) = to_process.decode(to_process.encode(sent)).items  # type: ignore[union-attr]  # an Upload
    assert math.isnan(item.params[3])


@pytest.mark.parametrize("packet", [b"", b"{", b"\x90", b"\x91\xa3Say", b"\x91\xa4Sing", b"\xff"])
def test_noise_is_no_message(packet: bytes) -> None:
    for codec in (to_process, from_process):
        with pytest.raises(ProcessMessageError, match="cannot be read"):
            codec.decode(packet)


@given(st.binary(max_size=80))
def test_any_bytes_are_a_message_or_a_message_error(packet: bytes) -> None:
    try:
        from_process.decode(packet)
    except ProcessMessageError:
        return


@given(st.lists(st.binary(max_size=40)), st.integers(1, 9))
def test_frames_cut_anywhere_come_whole(packets: list[bytes], step: int) -> None:
    stream, reader = b"".join(map(framed_packet, packets)), FrameReader()
    cuts = [stream[at : at + step] for at in range(0, len(stream), step)]
    assert [packet for cut in cuts for packet in reader.feed(cut)] == packets
    with pytest.raises(ProcessMessageError, match="too long"):
        list(reader.feed(b"\xff" * 4))


def test_fields_are_json_with_null_for_nan() -> None:
    message = command_long(MavlinkTarget(7), 22, math.nan, 2.5)
    fields = json.loads(message_fields_json(message))
    assert (fields["target_system"], fields["param1"], fields["param2"]) == (7, None, 2.5)


def test_fields_keep_large_integers_texts_and_arrays() -> None:
    stamp = 2**62 + 1
    assert (
        json.loads(message_fields_json(mavlink.MAVLink_timesync_message(0, stamp)))["ts1"] == stamp
    )
    name = mavlink.MAVLink_param_set_message(1, 1, b"COM_OF_LOSS_T", 2.5, 9)
    assert json.loads(message_fields_json(name))["param_id"] == "COM_OF_LOSS_T"
    near = mavlink.MAVLink_obstacle_distance_message(5, 0, list(range(72)), 5, 20, 1000)
    assert json.loads(message_fields_json(near))["distances"] == list(range(72))


def test_an_infinite_field_is_refused() -> None:
    with pytest.raises(ValueError, match="JSON"):
        message_fields_json(command_long(MavlinkTarget(7), 22, math.inf))
