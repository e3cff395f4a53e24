"""Strategies: modes, commands and setpoints of PX4 and ArduCopter, and when they are ready.

Numbers are those of the reference flights (PX4 1.18, ArduCopter 4.7).
"""

import math
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.vehicles.px4_modes import px4_custom_mode
from wil_campaign.plugins.ardupilot.strategy import ArduCopter
from wil_campaign.vehicles.autopilots.autopilot import (
    Autopilot,
    FlightMode,
    MavlinkTarget,
    MessageRate,
    TelemetryRates,
)
from wil_campaign.vehicles.autopilots.px4 import Px4
from wil_campaign.vehicles.autopilots.readiness import Readiness
from wil_campaign.vehicles.autopilots.registry import autopilot_named, autopilot_of
from wil_campaign.vehicles.errors import VehicleError
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec

TARGET = MavlinkTarget(3, 1)
BOTH = [Px4(), ArduCopter()]


def _parameters(message: Any) -> list[float]:
    return [getattr(message, f"param{number}") for number in range(1, 8)]


@pytest.mark.parametrize(
    ("autopilot", "custom_mode", "name", "mode"),
    [
        (Px4(), 50593792, "HOLD", FlightMode.HOLD),
        (Px4(), 33816576, "TAKEOFF", FlightMode.TAKEOFF),
        (Px4(), 393216, "OFFBOARD", FlightMode.GUIDED),
        (Px4(), 84148224, "RTL", FlightMode.RTL),
        (Px4(), 100925440, "LAND", FlightMode.LAND),
        (Px4(), px4_custom_mode(3), "POSCTL", FlightMode.PILOT),
        (Px4(), px4_custom_mode(3, 1), "ORBIT", FlightMode.OTHER),
        (Px4(), px4_custom_mode(77, 5), "mode 77/5", FlightMode.OTHER),
        (Px4(), px4_custom_mode(4, 15), "AUTO 15", FlightMode.OTHER),
        (ArduCopter(), 0, "STABILIZE", FlightMode.PILOT),
        (ArduCopter(), 4, "GUIDED", FlightMode.GUIDED),
        (ArduCopter(), 6, "RTL", FlightMode.RTL),
        (ArduCopter(), 9, "LAND", FlightMode.LAND),
        (ArduCopter(), 17, "BRAKE", FlightMode.HOLD),
        (ArduCopter(), 99, "mode 99", FlightMode.OTHER),
    ],
)
def test_modes_are_named_and_understood(
    autopilot: Autopilot, custom_mode: int, name: str, mode: FlightMode
) -> None:
    assert autopilot.mode_name(custom_mode) == name
    assert autopilot.mode_of(custom_mode) is mode


@pytest.mark.parametrize("autopilot", BOTH)
@pytest.mark.parametrize(
    "mode", [FlightMode.HOLD, FlightMode.GUIDED, FlightMode.LAND, FlightMode.RTL]
)
def test_a_requested_mode_reads_back_as_itself(autopilot: Autopilot, mode: FlightMode) -> None:
    message = autopilot.set_mode(TARGET, mode)
    assert (message.target_system, message.command) == (3, 176)
    enabled, main, sub = _parameters(message)[:3]
    assert enabled == 1.0
    custom = px4_custom_mode(int(main), int(sub)) if autopilot.name == "px4" else int(main)
    assert autopilot.mode_of(custom) is mode


@pytest.mark.parametrize("autopilot", BOTH)
def test_other_modes_are_not_asked_for(autopilot: Autopilot) -> None:
    with pytest.raises(ValueError, match="not a mode to set"):
        autopilot.set_mode(TARGET, FlightMode.PILOT)


def test_takeoff_heights() -> None:
    px4 = _parameters(Px4().takeoff(TARGET, altitude_m=1.2, ground_amsl_m=488.0))
    assert all(math.isnan(value) for value in px4[:6])
    assert px4[6] == pytest.approx(489.2)
    with pytest.raises(VehicleError, match="above sea level"):
        Px4().takeoff(TARGET, altitude_m=1.2, ground_amsl_m=None)
    ardupilot = _parameters(ArduCopter().takeoff(TARGET, altitude_m=1.2, ground_amsl_m=None))
    assert ardupilot == [0.0] * 6 + [1.2]


@pytest.mark.parametrize("autopilot", BOTH)
def test_common_commands(autopilot: Autopilot) -> None:
    arm, disarm = autopilot.arm(TARGET), autopilot.disarm(TARGET)
    assert (arm.command, *_parameters(arm)[:2]) == (400, 1.0, 0.0)
    assert (disarm.command, *_parameters(disarm)[:2]) == (400, 0.0, 0.0)
    terminate = autopilot.terminate(TARGET)
    assert (terminate.command, terminate.param1) == (185, 1.0)
    interval = autopilot.request_interval(TARGET, MessageRate(32, 50.0))
    assert (interval.command, *_parameters(interval)[:2]) == (511, 32.0, 20000.0)
    assert autopilot.request_interval(TARGET, MessageRate(32, 0.0)).param2 == -1.0
    assert autopilot.request_message(TARGET, 148).command == 512
    MavlinkCodec(system_id=1, component_id=1).pack(terminate)


@pytest.mark.parametrize("autopilot", BOTH)
def test_velocity_setpoints_have_the_masks_of_the_field(autopilot: Autopilot) -> None:
    def mask(**fields: float) -> int:
        message = autopilot.velocity_setpoint(
            TARGET, t_boot_ms=5, velocity_ned_m_s=(1.0, 2.0, 3.0), **fields
        )
        assert (message.vx, message.vy, message.vz) == (1.0, 2.0, 3.0)
        assert (message.coordinate_frame, message.target_system) == (1, 3)
        return int(message.type_mask)

    ignore_yaw, ignore_rate, rest = 1 << 10, 1 << 11, 0b111000111
    # ArduCopter turns into its course when both are ignored: it gets a rate of 0.
    keep = ignore_yaw | ignore_rate if autopilot.name == "px4" else ignore_yaw
    assert mask() == rest | keep
    assert mask(yaw_rad=0.5) == rest | ignore_rate
    assert mask(yaw_rate_rad_s=0.5) == rest | ignore_yaw
    with pytest.raises(ValueError, match="not both"):
        mask(yaw_rad=0.5, yaw_rate_rad_s=0.5)


@pytest.mark.parametrize("autopilot", BOTH)
def test_position_setpoints_have_the_masks_of_the_field(autopilot: Autopilot) -> None:
    message = autopilot.position_setpoint(
        TARGET, t_boot_ms=2**32 + 7, position_ned_m=(1.0, 2.0, -3.0), yaw_rad=0.25
    )
    assert (message.x, message.y, message.z, message.yaw) == (1.0, 2.0, -3.0, 0.25)
    assert message.time_boot_ms == 7
    assert message.type_mask == 0b100111111000
    without = autopilot.position_setpoint(TARGET, t_boot_ms=0, position_ned_m=(0.0, 0.0, 0.0))
    assert without.type_mask & 1 << 10


@pytest.mark.parametrize("autopilot", BOTH)
def test_plans_carry_what_the_driver_needs(autopilot: Autopilot) -> None:
    plan = {line.message_id: line for line in autopilot.telemetry_plan(TelemetryRates())}
    assert plan[32].rate_hz == 50.0
    assert plan[31].rate_hz == 50.0
    assert {1, 245} <= {number for number, line in plan.items() if line.required}


def test_refusals_are_reported_once_without_their_prefix() -> None:
    texts = ["PreArm: GPS 1: Bad fix", "Arm: Throttle too high", "EKF3 active"]
    assert ArduCopter().refusal_reasons([*texts, *texts]) == (
        "GPS 1: Bad fix",
        "Throttle too high",
    )
    assert Px4().refusal_reasons(["Preflight Fail: no heading reference", "[logger] x"]) == (
        "no heading reference",
    )


def test_strategies_are_found_by_name_and_heartbeat() -> None:
    assert autopilot_named("px4").label == "PX4"
    assert autopilot_of(3) is autopilot_named("ardupilot")
    assert autopilot_of(12) is autopilot_named("px4")
    assert autopilot_of(8) is None


def _heartbeat(system_status: int) -> Any:
    return mavlink.MAVLink_heartbeat_message(2, 3, 81, 0, system_status, 3)


def _health(*, prearm: bool) -> Any:
    health = 0x10000000 if prearm else 0
    return mavlink.MAVLink_sys_status_message(0, 0, health, 0, 0, -1, 80, *[0] * 6)


def _ekf(flags: int) -> Any:
    return mavlink.MAVLink_ekf_status_report_message(flags, *[0.0] * 5)


def _estimator(flags: int) -> Any:
    return mavlink.MAVLink_estimator_status_message(0, flags, *[0.0] * 8)


def _landed(state: int) -> Any:
    return mavlink.MAVLink_extended_sys_state_message(0, state)


def _feed(readiness: Readiness, *messages: Any) -> tuple[str, ...]:
    for message in messages:
        readiness.feed(message)
    return readiness.reasons()


def test_arducopter_is_not_ready_by_its_prearm_bit_alone() -> None:
    readiness = ArduCopter().readiness()
    assert not readiness.ready
    _feed(readiness, _heartbeat(1), _landed(1), _health(prearm=False), _ekf(1024))
    assert "the estimator is not initialised" in readiness.reasons()
    assert any("boot" in reason for reason in readiness.reasons())
    assert len(_feed(readiness, _heartbeat(3), _ekf(0))) == 5
    # 23 s into its boot: the bit is set, the EKF does not use GPS yet.
    reasons = _feed(readiness, _health(prearm=True), _ekf(167))
    assert len(reasons) == 1
    assert "horizontal position" in reasons[0]
    # 41 s: "EKF3 IMU0 is using GPS".
    assert _feed(readiness, _ekf(831)) == ()
    assert readiness.ready
    assert readiness.estimator_faults() == ()


def test_arducopter_position_that_is_only_assumed_does_not_count() -> None:
    readiness = ArduCopter().readiness()
    _feed(readiness, _heartbeat(3), _landed(1), _health(prearm=True), _ekf(831 | 128))
    assert "horizontal position" in readiness.reasons()[0]


def test_px4_waits_for_bit_estimator_and_home() -> None:
    readiness = Px4().readiness()
    _feed(readiness, _heartbeat(0), _landed(1), _health(prearm=False), _estimator(164))
    assert "horizontal position" in " ".join(readiness.reasons())
    reasons = _feed(readiness, _estimator(1023), _heartbeat(3))
    assert reasons == ("pre-arm checks have not passed", "no home position")
    assert readiness.prearm_failed
    home = mavlink.MAVLink_home_position_message(
        1, 1, 488000, *[0.0] * 3, [1.0, 0.0, 0.0, 0.0], *[0.0] * 3
    )
    assert _feed(readiness, home) == ("pre-arm checks have not passed",)
    assert _feed(readiness, _health(prearm=True)) == ()
    assert _feed(readiness, _landed(2)) == ("it is not on the ground",)
    assert _feed(readiness, _landed(0)) == ("landed state unknown",)
    assert "critical" in _feed(readiness, _landed(1), _heartbeat(5))[0]
