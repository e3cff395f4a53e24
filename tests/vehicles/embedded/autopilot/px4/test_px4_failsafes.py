"""PX4's failsafes and the check of its geofence, without a body."""

from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.vehicles.embedded.autopilot.bare_autopilot import BareAutopilot
from wil_campaign.vehicles.embedded.autopilot.flight.guidance import GoToBehaviour
from wil_campaign.vehicles.embedded.autopilot.flight.parameter_table import load_parameters
from wil_campaign.vehicles.embedded.autopilot.px4.px4 import Px4
from wil_campaign.vehicles.embedded.autopilot.px4.px4_failsafes import (
    Px4FailsafeAction,
    Px4FailsafeDecision,
    Px4FailsafeInputs,
    Px4Failsafes,
)
from wil_campaign.vehicles.embedded.autopilot.px4.px4_modes import Px4Mode
from wil_campaign.vehicles.embedded.autopilot.services.fence_items import EmulatedFence
from wil_campaign.vehicles.mavlink.fence_areas import FenceCircle

ARM, FORCE = 400, 21196
SOUND = Px4FailsafeInputs(
    t_s=100.0,
    offboard=False,
    landing=False,
    landed=False,
    setpoint_age_s=0.0,
    gcs_age_s=0.2,
    battery=1.0,
    outside_fence=False,
)


def failsafes(**parameters: float) -> Px4Failsafes:
    overrides = {"COM_FAIL_ACT_T": 0.0, **parameters}
    return Px4Failsafes(
        load_parameters(Px4.firmware.parameter_file, bytewise=True, overrides=overrides)
    )


def test_a_lost_link_does_not_end_a_landing_that_the_user_commanded() -> None:
    """dll_loss_ignored_land of Failsafe::checkStateAndMode."""
    lost = SOUND._replace(gcs_age_s=60.0)
    found = failsafes(NAV_DLL_ACT=2)
    assert found.check(lost._replace(landing=True)) is None
    assert found.check(lost) == Px4FailsafeDecision("link", Px4FailsafeAction.RETURN)
    assert found.check(lost._replace(landing=True)) is None
    assert found.check(lost) == Px4FailsafeDecision("link", Px4FailsafeAction.RETURN)


@pytest.mark.parametrize(
    ("cause", "change"), [("link", {"gcs_age_s": 60.0}), ("fence", {"outside_fence": True})]
)
def test_a_cause_that_exists_on_the_ground_acts_after_the_liftoff(
    cause: str, change: dict[str, Any]
) -> None:
    found, view = failsafes(NAV_DLL_ACT=3, GF_ACTION=5), SOUND._replace(**change)
    assert found.check(view._replace(landed=True)) is None
    assert found.check(view) == Px4FailsafeDecision(cause, Px4FailsafeAction.LAND)
    assert found.check(view) is None


def test_a_battery_as_low_as_at_arming_does_not_act() -> None:
    """_battery_warning_at_arming of Failsafe::checkStateAndMode."""
    found, low = failsafes(COM_LOW_BAT_ACT=2), SOUND._replace(battery=0.01)
    assert found.check(low._replace(landed=True)) is not None
    assert found.check(low) is None


def outside_fence(action: int, **parameters: float) -> BareAutopilot:
    """Return a PX4 that is ready but for a fence that excludes it; GF_ACTION: action."""
    bare = BareAutopilot("px4", parameters={"GF_ACTION": action, **parameters})
    if not parameters:
        bare.autopilot.fence = EmulatedFence((FenceCircle((0.0, 0.0), 5.0, inside=False),))
    bare.run(7.0)
    bare.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
    return bare


@pytest.mark.parametrize("action", [1, 2, 5])
def test_it_does_not_arm_outside_its_fence(action: int) -> None:
    """GeofenceChecks::checkAndReport refuses in every mode, whatever the action but none."""
    bare = outside_fence(action)
    assert bare.command(ARM, 1) == mavlink.MAV_RESULT_TEMPORARILY_REJECTED
    texts = [each.text for each in bare.run(0.5) if each.get_type() == "STATUSTEXT"]
    assert "".join(texts) == (
        "Geofence: approaching or outside geofence\t"
        "Arming denied: Resolve system health failures first\t"
    )
    # Commander::handle_command: an arm command from outside runs the checks, forced or not.
    assert bare.command(ARM, 1, FORCE) == mavlink.MAV_RESULT_TEMPORARILY_REJECTED


def test_a_fence_without_an_action_is_no_matter_of_arming() -> None:
    assert outside_fence(0).command(ARM, 1) == mavlink.MAV_RESULT_ACCEPTED


def test_it_does_not_arm_above_its_ceiling() -> None:
    bare = outside_fence(2, GF_MAX_VER_DIST=10.0)
    bare.height_m = 20.0
    bare.run(0.1)
    assert bare.command(ARM, 1) == mavlink.MAV_RESULT_TEMPORARILY_REJECTED


@pytest.mark.parametrize(
    ("action", "mode"), [(3, Px4Mode.RTL), (4, Px4Mode.LAND), (5, Px4Mode.HOLD)]
)
def test_offboard_goes_on_once_there_are_setpoints_again(action: int, mode: Px4Mode) -> None:
    """FailsafeBase: OFFBOARD stays what the user wants, until he wants something else."""
    bare = BareAutopilot("px4", parameters={"COM_OBL_RC_ACT": action})
    bare.hover()
    setpoint = mavlink.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, 1, 0b110111000111, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0
    )
    bare.send(setpoint)
    assert bare.command(176, 1, 6) == mavlink.MAV_RESULT_ACCEPTED
    bare.run(1.2)
    assert bare.autopilot.mode is mode
    bare.send(setpoint)
    bare.run(0.1)
    assert bare.autopilot.mode is Px4Mode.OFFBOARD
    assert not bare.autopilot.failsafe
    bare.run(1.2)
    assert bare.autopilot.mode is mode
    assert bare.command(176, 1, 4, 3) == mavlink.MAV_RESULT_ACCEPTED
    bare.send(setpoint)
    bare.run(0.1)
    assert bare.autopilot.mode is Px4Mode.HOLD


@pytest.mark.parametrize(("action", "goes"), [(1, True), (2, False)])
def test_a_reposition_outside_of_its_fence_holds(action: int, goes: bool) -> None:
    """Navigator::geofence_allows_position; commander has accepted it by then."""
    bare = BareAutopilot("px4", parameters={"GF_ACTION": action, "GF_MAX_HOR_DIST": 20.0})
    bare.hover()
    bare.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
    where = bare.autopilot.state.frame.to_geodetic((30.0, 0.0, -3.0))
    place = (where.latitude_deg, where.longitude_deg, where.altitude_m)
    nan = float("nan")
    assert bare.command(192, -1, 1, 0, nan, *place) == mavlink.MAV_RESULT_ACCEPTED
    texts = [each.text for each in bare.run(0.1) if each.get_type() == "STATUSTEXT"]
    assert ("Reposition is outside geofence\t" in texts) is not goes
    assert isinstance(bare.autopilot.flight.behaviour, GoToBehaviour) is goes
