"""What a stream of velocity setpoints amounts to for the prediction of a stop."""

import pytest

from wil_campaign.safety.fence.stopping import VehicleMotion
from wil_campaign.safety.guard.core.velocity_command import VelocityCommand
from wil_campaign.vehicles.setpoints import PositionSetpoint, VelocitySetpoint
from wil_campaign.worlds.frames import Vec3

EAST: Vec3 = (0.0, 3.0, 0.0)
FLYING = VehicleMotion((0.0, 0.0, -1.0), (1.0, 0.0, 0.0))


def after(*given: Vec3, step_s: float = 0.05) -> tuple[VelocityCommand, float]:
    command, t_s = VelocityCommand(), 10.0
    for velocity in given:
        t_s += step_s
        command.note(VelocitySetpoint(velocity), FLYING, t_s)
    return command, t_s


def test_a_held_command_is_reached_and_a_single_one_is_not() -> None:
    command, t_s = after(*[EAST] * 30)
    assert command.velocity(t_s) == pytest.approx(EAST, abs=0.1)
    command, t_s = after(*[(1.0, 0.0, 0.0)] * 20, EAST)
    assert command.velocity(t_s) == pytest.approx((1.0, 0.0, 0.0), abs=0.01)
    velocity = command.velocity(t_s + 0.05)
    assert velocity is not None
    assert velocity[1] == pytest.approx(0.66, abs=0.01)


def test_a_setpoint_holds_until_the_next() -> None:
    command, t_s = after(EAST)
    assert command.velocity(t_s + 0.8) == pytest.approx(EAST, abs=0.06)


def test_slow_streams_count_too() -> None:
    command, t_s = after(EAST, EAST, EAST, step_s=0.4)
    assert command.velocity(t_s) == pytest.approx(EAST, abs=0.1)


def test_a_command_begins_from_the_velocity_of_the_vehicle() -> None:
    command, t_s = after(EAST)
    assert command.velocity(t_s) == FLYING.velocity_ned_m_s


def test_it_ends_with_silence_and_with_another_kind_of_setpoint() -> None:
    command, t_s = after(*[EAST] * 20)
    assert command.velocity(t_s + 0.9) is not None
    assert command.velocity(t_s + 1.1) is None
    command.note(PositionSetpoint((0.0, 0.0, -1.0)), FLYING, t_s + 0.1)
    assert command.velocity(t_s + 0.1) is None
    command, t_s = after(*[EAST] * 20)
    command.note(None, FLYING, t_s)
    assert command.velocity(t_s) is None
