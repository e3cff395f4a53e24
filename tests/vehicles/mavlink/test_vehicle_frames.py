"""The state of a second vehicle with the same ids is left out, and nothing else is."""

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.mavlink.framing import MavlinkFrame
from wil_campaign.vehicles.mavlink.vehicle_frames import VehicleFrames

POSITION: int = mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED
ATTITUDE: int = mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION
TEXT: int = mavlink.MAVLINK_MSG_ID_STATUSTEXT
LOG_ENTRY: int = mavlink.MAVLINK_MSG_ID_LOG_ENTRY


def frame(who: str, seq: int, message_id: int) -> MavlinkFrame:
    return MavlinkFrame(
        f"{who}{seq}-{message_id}".encode(), message_id, 1, 1, seq % 256, 2, signed=False
    )


def passed(*sent: tuple[str, int, int], frames: VehicleFrames | None = None) -> list[str]:
    """Return which senders' frames pass on, in order; a frame comes each 5 ms."""
    frames = frames or VehicleFrames()
    found = []
    for tick, one in enumerate(sent):
        own, _ = frames.split(frame(*one), tick * 0.005)
        found += [f"{each.raw.decode()}" for each in own]
    return found


def test_texts_and_answers_of_another_sender_pass_at_once() -> None:
    frames = VehicleFrames()
    for tick in range(100):
        frames.split(frame("a", tick, POSITION), tick * 0.01)
    for number, message_id in enumerate((TEXT, LOG_ENTRY, TEXT)):
        other = frame("b", number, message_id)
        assert frames.split(other, 1.0) == ([other], [])
    doubled = frame("c", 99, LOG_ENTRY)  # with the number of the last one, as a relay may do it
    assert frames.split(doubled, 1.0) == ([doubled], [])
    assert not frames.are_two


def test_state_of_a_second_vehicle_is_left_out() -> None:
    sent = []
    for tick in range(200):
        sent += [("a", 2 * tick, POSITION), ("a", 2 * tick + 1, ATTITUDE)]
        sent += [("b", 2 * tick + 100, POSITION), ("b", 2 * tick + 101, ATTITUDE)]
    frames = VehicleFrames()
    assert {one[0] for one in passed(*sent, frames=frames)} == {"a"}
    assert frames.are_two


def test_a_relay_that_renumbers_the_frames_it_changes_is_no_second_vehicle() -> None:
    """As long as its numbers do not pass those of the vehicle."""
    sent = []
    for tick in range(80):
        sent += [("a", 2 * tick, POSITION), ("r", tick + 120, ATTITUDE)]
    found = passed(*sent)
    assert sum(one[0] == "a" for one in found) == 80
    assert sum(one[0] == "r" for one in found) >= 79  # the last may still be held
