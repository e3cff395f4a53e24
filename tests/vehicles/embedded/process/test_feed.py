"""What a vehicle in a process of its own sends beside MAVLink, and is sent."""

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wil_campaign.foundation.processes.codec import ProcessMessageError
from wil_campaign.vehicles.embedded.process.feed import (
    FaultMessage,
    MocapMessage,
    ToVehicle,
    TruthMessage,
    WorldEventMessage,
    from_vehicle,
    is_feed_message_finite,
    to_vehicle,
)
from wil_campaign.vehicles.poses.truth import TruthSample
from wil_campaign.vehicles.readings import PoseReading
from wil_campaign.worlds.frames import Pose

number = st.floats(-1e30, 1e30)
place = st.tuples(number, number, number)
poses = st.builds(Pose, place, st.tuples(number, number, number, number))
SAMPLE = TruthSample(
    12.5,
    Pose.of(1.0, -2.0, 3.0, yaw_rad=0.5),
    (0.1, 0.2, 0.3),
    on_ground=True,
    motors_stopped=False,
    contact="wall",
    rates_frd_rad_s=(1.0, 2.0, 3.0),
    specific_force_frd_m_s2=(0.1, -0.2, -9.7),
    thrusts_n=(1.1, 1.2, 1.3, 1.4),
)
READING = PoseReading(12.5, 12.6, "twin", Pose.of(1.0, -2.0, 3.0), None)


@given(poses, place)
def test_samples_and_readings_come_back(pose: Pose, velocity: tuple[float, float, float]) -> None:
    truth = TruthMessage(3, SAMPLE._replace(pose=pose, velocity_ned_m_s=velocity))
    reading = MocapMessage(4, replace(READING, pose=pose, velocity_ned_m_s=velocity))
    for message in (truth, reading, TruthMessage(5, SAMPLE), MocapMessage(6, READING)):
        again = from_vehicle.decode(from_vehicle.encode(message))
        assert again == message
        assert is_feed_message_finite(again)


@pytest.mark.parametrize(
    "message",
    [
        WorldEventMessage(1, "start", 2.5),
        FaultMessage(2, "motor 2 0.5"),
    ],
)
def test_messages_to_a_vehicle_come_back_as_they_were_sent(message: ToVehicle) -> None:
    assert to_vehicle.decode(to_vehicle.encode(message)) == message


@pytest.mark.parametrize(
    "message",
    [
        TruthMessage(1, SAMPLE._replace(t_s=math.nan)),
        TruthMessage(1, SAMPLE._replace(pose=Pose((math.nan, 0.0, 0.0)))),
        TruthMessage(1, SAMPLE._replace(thrusts_n=(1.0, math.inf, 1.0, 1.0))),
        MocapMessage(1, replace(READING, pose=Pose((0.0, 0.0, 0.0), (math.nan, 0.0, 0.0, 1.0)))),
        MocapMessage(1, replace(READING, velocity_ned_m_s=(0.0, math.inf, 0.0))),
    ],
)
def test_a_value_that_is_not_finite_is_seen(message: TruthMessage | MocapMessage) -> None:
    assert not is_feed_message_finite(from_vehicle.decode(from_vehicle.encode(message)))


@given(st.binary(max_size=500))
def test_garbage_is_refused_and_never_crashes(data: bytes) -> None:
    for codec in (from_vehicle, to_vehicle):
        with pytest.raises(ProcessMessageError):
            codec.decode(data)


@given(st.data())
def test_damaged_datagrams_never_crash(data: st.DataObject) -> None:
    raw = bytearray(from_vehicle.encode(TruthMessage(3, SAMPLE)))
    raw[data.draw(st.integers(0, len(raw) - 1))] = data.draw(st.integers(0, 255))
    cut = data.draw(st.integers(0, len(raw)))
    for damaged in (bytes(raw), bytes(raw[:cut])):
        try:
            is_feed_message_finite(from_vehicle.decode(damaged))
        except ProcessMessageError:
            continue
