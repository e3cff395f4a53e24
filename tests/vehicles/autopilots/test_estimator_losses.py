"""What an estimator had at arming and has lost since, by flags and fixes of both firmwares."""

from collections.abc import Iterable
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.autopilots.estimator_losses import EstimatorLosses
from wil_campaign.vehicles.autopilots.registry import autopilot_named

BOTH = pytest.mark.parametrize("name", ["px4", "ardupilot"])
FLOWN = {"px4": 895, "ardupilot": 831}
"""Flags in flight of PX4 1.18 and ArduCopter 4.7 (the reference traces)."""


def report(name: str, flags: int) -> Any:
    if name == "px4":
        return mavlink.MAVLink_estimator_status_message(0, flags, *[0.0] * 8)
    return mavlink.MAVLink_ekf_status_report_message(flags, *[0.0] * 5)


def gps(fix: int) -> Any:
    return mavlink.MAVLink_gps_raw_int_message(0, fix, 1, 1, 0, 0, 0, 0, 0, 10)


def second_gps(fix: int) -> Any:
    return mavlink.MAVLink_gps2_raw_message(0, fix, 1, 1, 0, 0, 0, 0, 0, 10, 0, 0)


def armed(name: str, before: Iterable[Any]) -> EstimatorLosses:
    losses = autopilot_named(name).estimator_losses()
    for message in before:
        losses.feed(message)
    losses.arm(armed=True)
    return losses


def lost(losses: EstimatorLosses, *after: Any) -> tuple[tuple[str, ...], tuple[str, ...]]:
    for message in after:
        losses.feed(message)
    return losses.lost.others, losses.lost.position


@BOTH
def test_nothing_is_lost_in_a_sound_flight(name: str) -> None:
    losses = armed(name, [report(name, FLOWN[name]), gps(3)])
    assert lost(losses, report(name, FLOWN[name]), gps(6)) == ((), ())


@BOTH
def test_absolute_position_and_fix_are_named_with_their_flags(name: str) -> None:
    losses = armed(name, [report(name, FLOWN[name]), gps(3)])
    assert lost(losses, report(name, FLOWN[name] & ~16))[1] == (
        "the estimator has lost its absolute position (POS_HORIZ_ABS)",
    )
    assert lost(losses, report(name, FLOWN[name]), gps(1))[1] == (
        "its GPS has lost its fix (GPS_RAW_INT fix_type 1)",
    )
    assert lost(losses, gps(4)) == ((), ())


@pytest.mark.parametrize(
    ("name", "glitch", "flag"), [("px4", 1024, "GPS_GLITCH"), ("ardupilot", 1 << 15, "EKF_GPS_G")]
)
def test_gps_that_is_rejected(name: str, glitch: int, flag: str) -> None:
    losses = armed(name, [report(name, FLOWN[name])])
    (text,) = lost(losses, report(name, FLOWN[name] | glitch))[1]
    assert flag in text
    rejected = armed(name, [report(name, FLOWN[name] | glitch)])
    assert lost(rejected, report(name, FLOWN[name] | glitch)) == ((), ())


@BOTH
def test_height_velocity_and_attitude_are_no_dead_reckoning(name: str) -> None:
    losses = armed(name, [report(name, FLOWN[name])])
    others, position = lost(losses, report(name, FLOWN[name] & ~(1 | 2 | 4 | 32)))
    assert others == (
        (
            "the estimator has lost its attitude, its horizontal velocity, its vertical velocity, "
            "its absolute height (ATTITUDE, VELOCITY_HORIZ, VELOCITY_VERT, POS_VERT_ABS)"
        ),
    )
    assert position == ()


def test_height_above_ground_comes_and_goes() -> None:
    # PX4 1.18 in the reference trace: 1023 on the ground, 895 armed, 831 landed.
    losses = armed("px4", [report("px4", 1023)])
    assert lost(losses, report("px4", 895), report("px4", 831)) == ((), ())


@BOTH
def test_a_vehicle_that_had_no_absolute_position_needs_no_fix(name: str) -> None:
    losses = armed(name, [report(name, FLOWN[name] & ~16), gps(3)])
    assert lost(losses, gps(1), report(name, FLOWN[name] & ~16)) == ((), ())


@BOTH
def test_second_receiver_holds_the_position(name: str) -> None:
    losses = armed(name, [report(name, FLOWN[name]), gps(3), second_gps(3)])
    assert lost(losses, gps(0)) == ((), ())
    assert "GPS2_RAW fix_type 1" in lost(losses, second_gps(1))[1][0]


@BOTH
def test_nothing_is_lost_on_the_ground_or_before_any_report(name: str) -> None:
    losses = armed(name, [])
    assert lost(losses, report(name, 0), gps(0)) == ((), ())
    losses = armed(name, [report(name, FLOWN[name])])
    losses.arm(armed=False)
    assert lost(losses, report(name, 0)) == ((), ())
    losses.arm(armed=True)
    assert lost(losses, report(name, 0)) == ((), ())
