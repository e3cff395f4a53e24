"""Whose a mode of a pilot is, by the vehicle's heartbeats: the pilot's, or a failsafe's."""

from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.vehicles.px4_modes import px4_custom_mode
from wil_campaign.plugins.ardupilot.strategy import ArduCopter
from wil_campaign.safety.guard.core.events import GuardedVehicle, GuardSettings
from wil_campaign.safety.guard.core.vehicle_observer import ObservedVehicle
from wil_campaign.vehicles.autopilots.autopilot import Autopilot, MavlinkTarget
from wil_campaign.vehicles.autopilots.px4 import Px4
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec

ACTIVE, CRITICAL = mavlink.MAV_STATE_ACTIVE, mavlink.MAV_STATE_CRITICAL
ALT_HOLD, GUIDED, LOITER = 2, 4, 5
OFFBOARD, POSCTL, ALTCTL, ACRO = (px4_custom_mode(main, 0) for main in (6, 3, 2, 5))


def changes(autopilot: Autopilot, *beats: tuple[int, int]) -> list[str]:
    """Return the kinds of mode changes in heartbeats, each of a custom mode and a MAV_STATE."""
    codec = MavlinkCodec(system_id=1, component_id=1)
    seen = ObservedVehicle(
        GuardedVehicle(autopilot=autopilot, target=MavlinkTarget(1)), GuardSettings()
    )
    found: list[Any] = []
    for t_s, (mode, state) in enumerate(beats, start=10):
        beat = mavlink.MAVLink_heartbeat_message(2, autopilot.mav_autopilot, 129, mode, state, 3)
        (frame,) = codec.split(codec.pack(beat))
        found.append(seen.read_state(frame, float(t_s), None))
    return [change.kind for change in found if change is not None]


@pytest.mark.parametrize(
    ("autopilot", "beats", "kinds"),
    [
        # A warning is CRITICAL for good: the pilot takes over beside it, also when the heartbeat in
        # which it began was lost.
        (ArduCopter(), [(GUIDED, ACTIVE), (GUIDED, CRITICAL), (LOITER, CRITICAL)], ["takeover"]),
        (ArduCopter(), [(GUIDED, ACTIVE), (LOITER, CRITICAL)], ["takeover"]),
        (ArduCopter(), [(GUIDED, CRITICAL), (ALT_HOLD, CRITICAL)], ["takeover"]),
        # FS_EKF_ACTION 2, and the pilot afterwards.
        (
            ArduCopter(),
            [(GUIDED, ACTIVE), (ALT_HOLD, CRITICAL), (ALT_HOLD, CRITICAL), (LOITER, CRITICAL)],
            ["failsafe", "takeover"],
        ),
        # COM_OBL_RC_ACT 0: mode and state change in one heartbeat, and the next fallback follows.
        (Px4(), [(OFFBOARD, ACTIVE), (POSCTL, CRITICAL), (POSCTL, CRITICAL)], ["failsafe"]),
        (
            Px4(),
            [(OFFBOARD, ACTIVE), (POSCTL, CRITICAL), (ALTCTL, CRITICAL), (ALTCTL, ACTIVE)],
            ["failsafe", "takeover"],
        ),
        (Px4(), [(OFFBOARD, ACTIVE), (OFFBOARD, CRITICAL), (POSCTL, CRITICAL)], ["takeover"]),
        (Px4(), [(OFFBOARD, ACTIVE), (ACRO, CRITICAL)], ["takeover"]),
        (Px4(), [(OFFBOARD, ACTIVE), (POSCTL, ACTIVE)], ["takeover"]),
    ],
)
def test_a_mode_of_a_pilot_is_a_takeover_or_a_failsafe_by_its_heartbeats(
    autopilot: Autopilot, beats: list[tuple[int, int]], kinds: list[str]
) -> None:
    assert changes(autopilot, *beats) == kinds
