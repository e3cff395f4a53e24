"""Before arming it is known what the autopilot would ignore, and what to set."""

import typing

import pytest

from wil_campaign.plugins.injection.injection_support import injection_faults
from wil_campaign.plugins.injection.rules import InjectionKind
from wil_campaign.vehicles.setpoints import Setpoints

THINGS: tuple[InjectionKind, ...] = typing.get_args(InjectionKind)

ARDUPILOT_READY = {
    "PRX1_TYPE": 2,
    "AVOID_ENABLE": 7,
    "OA_TYPE": 1,
    "GUID_OPTIONS": 64,
    "RNGFND1_TYPE": 10,
    "RNGFND1_ORIENT": 25,
    "ADSB_TYPE": 1,
    "AVD_ENABLE": 1,
    "AVD_F_ACTION": 3,
    "PLND_ENABLED": 1,
    "PLND_TYPE": 1,
    "VISO_TYPE": 1,
    "EK3_SRC1_POSXY": 6,
    "GPS1_TYPE": 14,
    "FENCE_ENABLE": 1,
    "FENCE_TYPE": 7,
    "FENCE_ACTION": 1,
}
PX4_READY = {
    "CP_DIST": 2.0,
    "MPC_POS_MODE": 4,
    "EKF2_RNG_CTRL": 1,
    "NAV_TRAFF_AVOID": 4,
    "RTL_PLD_MD": 1,
    "EKF2_EV_CTRL": 15,
    "GF_ACTION": 3,
    "SYS_FAILURE_EN": 1,
}
NEVER = {
    "ardupilot": {"collision", "inject_failure"},
    "px4": {
        "obstacle_distance_3d",
        "path_planning",
        "other_global_position",
        "collision",
        "gps_input",
    },
}


def mode_for(autopilot: str, thing: InjectionKind) -> str:
    modes = {
        ("ardupilot", "landing_target"): "LAND",
        ("px4", "landing_target"): "PRECLAND",
        ("px4", "obstacle_distance"): "POSCTL",
        ("px4", "distance_sensor_sideways"): "POSCTL",
    }
    return modes.get((autopilot, thing), "GUIDED" if autopilot == "ardupilot" else "OFFBOARD")


@pytest.mark.parametrize("thing", THINGS)
@pytest.mark.parametrize(
    ("autopilot", "parameters"), [("ardupilot", ARDUPILOT_READY), ("px4", PX4_READY)]
)
def test_a_vehicle_that_is_set_up_honours_all_that_it_can(
    autopilot: str, parameters: dict[str, float], thing: InjectionKind
) -> None:
    setpoints: Setpoints = "position" if thing == "path_planning" else "velocity"
    mode = mode_for(autopilot, thing)
    reasons = injection_faults(autopilot, thing, parameters, mode, setpoints=setpoints)
    assert bool(reasons) == (thing in NEVER[autopilot])


@pytest.mark.parametrize("thing", THINGS)
@pytest.mark.parametrize(
    ("autopilot", "parameters"), [("ardupilot", ARDUPILOT_READY), ("px4", PX4_READY)]
)
def test_the_advised_settings_make_an_injection_used(
    autopilot: str, parameters: dict[str, float], thing: InjectionKind
) -> None:
    setpoints: Setpoints = "position" if thing == "path_planning" else "velocity"
    mode = mode_for(autopilot, thing)
    off = dict.fromkeys(parameters, 0.0)
    reasons = injection_faults(autopilot, thing, off, mode, setpoints=setpoints)
    for reason in reasons:
        if reason.parameter is not None and reason.value is not None:
            off[reason.parameter] = reason.value
    left = injection_faults(autopilot, thing, off, mode, setpoints=setpoints)
    assert bool(left) == (thing in NEVER[autopilot])
    # What needs no parameter is honoured by whoever flies in the right mode.
    by_mode = thing == "flight_termination" or (autopilot, thing) == ("px4", "landing_target")
    assert bool(reasons) is not by_mode


def texts(*arguments: typing.Any, **more: typing.Any) -> str:
    return "\n".join(str(reason) for reason in injection_faults(*arguments, **more))


def test_obstacles_on_arducopter() -> None:
    said = injection_faults(
        "ardupilot", "obstacle_distance", {"PRX1_TYPE": 0, "AVOID_ENABLE": 1}, "GUIDED"
    )
    assert str(said[0]) == (
        "PRX1_TYPE is 0: obstacles over MAVLink are ignored; set PRX1_TYPE to 2 and "
        "reboot the autopilot"
    )
    assert str(said[1]) == (
        "AVOID_ENABLE is 1: the proximity sensor does not stop it (bit 1); set AVOID_ENABLE to 3"
    )
    assert len(said) == 2
    assert said[0].reboot
    assert (said[1].parameter, said[1].value) == ("AVOID_ENABLE", 3.0)


def test_obstacles_on_arducopter_in_the_wrong_mode_or_by_positions() -> None:
    assert (
        "in mode RTL: simple avoidance is not used; fly in ALT_HOLD or GUIDED or LOITER"
        in texts("ardupilot", "obstacle_distance", ARDUPILOT_READY, "RTL")
    )
    by_position = texts(
        "ardupilot", "obstacle_distance", ARDUPILOT_READY, "GUIDED", setpoints="position"
    )
    assert "position setpoints in GUIDED are not adjusted" in by_position


def test_path_planning_on_arducopter_wants_waypoint_navigation() -> None:
    parameters = ARDUPILOT_READY | {"GUID_OPTIONS": 1}
    said = injection_faults(
        "ardupilot", "path_planning", parameters, "GUIDED", setpoints="position"
    )
    assert [(reason.parameter, reason.value) for reason in said] == [("GUID_OPTIONS", 65.0)]
    assert injection_faults("ardupilot", "path_planning", parameters, "AUTO") == ()


def test_offboard_px4_flies_into_obstacles_that_it_knows_of() -> None:
    said = texts("px4", "obstacle_distance", PX4_READY, "OFFBOARD")
    assert "in mode OFFBOARD" in said
    assert "fly in POSCTL" in said


def test_a_report_is_no_avoidance() -> None:
    parameters = ARDUPILOT_READY | {"AVD_F_ACTION": 1}
    assert (
        "AVD_F_ACTION is 1: an imminent collision is reported at most; set AVD_F_ACTION to 3"
        in (texts("ardupilot", "adsb_vehicle", parameters, "GUIDED"))
    )
    assert "NAV_TRAFF_AVOID is 1" in texts(
        "px4", "adsb_vehicle", {"NAV_TRAFF_AVOID": 1}, "OFFBOARD"
    )


def test_a_parameter_that_is_not_there_is_a_reason() -> None:
    (said,) = injection_faults("ardupilot", "gps_input", {}, "GUIDED")
    assert "GPS1_TYPE does not exist on this autopilot" in str(said)
    assert injection_faults("ardupilot", "gps_input", {"GPS_TYPE": 14}, "GUIDED") == ()


def test_a_landing_that_is_not_guided_yet() -> None:
    assert "in mode GUIDED" in texts("ardupilot", "landing_target", ARDUPILOT_READY, "GUIDED")
    assert "RTL_PLD_MD is 0" in texts("px4", "landing_target", {"RTL_PLD_MD": 0}, "RTL")
    assert injection_faults("px4", "landing_target", {}, "PRECLAND") == ()


def test_a_value_that_waits_for_a_boot_is_distinguished_from_one_that_counts() -> None:
    just_set = frozenset({"PRX1_TYPE", "AVOID_ENABLE"})
    (said,) = injection_faults(
        "ardupilot", "obstacle_distance", ARDUPILOT_READY, "GUIDED", unbooted=just_set
    )
    assert said.reboot
    assert str(said) == (
        "PRX1_TYPE was set to 2 since the autopilot booted, and takes effect at the next boot: "
        "until then obstacles over MAVLink are ignored; set PRX1_TYPE to 2 in the vehicle "
        "itself, reboot it, and then fly"
    )
