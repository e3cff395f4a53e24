"""What a ground station is sent of a contact."""

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.plugins.outlets.ground_station import collision_message
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec


def test_a_contact_becomes_a_collision_message() -> None:
    sent = collision_message(
        thing_id=2, threat="high", time_to_closest_s=0.0, horizontal_m=0.0, vertical_m=0.0
    )
    packed = MavlinkCodec(system_id=255, component_id=190).pack(sent)
    (message,) = MavlinkCodec(system_id=1, component_id=1).parse(packed)
    assert (message.id, message.threat_level) == (2, mavlink.MAV_COLLISION_THREAT_LEVEL_HIGH)
    assert message.action == mavlink.MAV_COLLISION_ACTION_REPORT
