"""A vehicle that lands alone: what happens to it brings it down, and nothing else."""

from typing import Any

import pytest

from tests.safety.guard.guard_rigs import FENCE, abort, setpoint
from wil_campaign.safety.guard.core.commands import BringDown, ClocksApart
from wil_campaign.safety.guard.core.contingency import ContingencyPhase
from wil_campaign.safety.guard.core.events import GuardedVehicle, ToVehicle, decisive_guard_event
from wil_campaign.safety.guard.core.guard_core import GuardCore
from wil_campaign.vehicles.autopilots.autopilot import FlightMode, MavlinkTarget
from wil_campaign.vehicles.autopilots.px4 import Px4


@pytest.fixture
def pair(fake_vehicle: Any, rig: Any) -> Any:
    vehicles = {name: fake_vehicle(name, Px4(), system=i) for i, name in ((1, "real"), (2, "twin"))}
    core = GuardCore(
        vehicles={
            "real": GuardedVehicle(autopilot=Px4(), target=MavlinkTarget(1), fence=FENCE),
            "twin": GuardedVehicle(
                autopilot=Px4(),
                target=MavlinkTarget(2),
                fence=FENCE,
                lands_alone=True,
                abandoned_when_lost=True,
            ),
        }
    )
    made = rig(core, vehicles)
    made.fly(1.0)
    return made


def passes(pair: Any, name: str, system: int) -> bool:
    outputs = pair.core.from_orchestrator(name, setpoint(system=system), pair.t_s)
    return any(isinstance(out, ToVehicle) for out in outputs)


def leave_fence(pair: Any) -> None:
    pair.vehicles["twin"].north_m_s = 2.0


def fail_over(pair: Any) -> None:
    pair.vehicles["twin"].mode = FlightMode.RTL


def take_over(pair: Any) -> None:
    pair.vehicles["twin"].mode = FlightMode.PILOT


def fall_silent(pair: Any) -> None:
    pair.vehicles["twin"].mute = True


@pytest.mark.parametrize("trouble", [leave_fence, fail_over, take_over, fall_silent])
def test_the_other_stays_in_command_of_the_orchestrator(pair: Any, trouble: Any) -> None:
    trouble(pair)
    pair.fly(6.0)
    assert pair.core.latched is None
    assert pair.kinds() == ["alone"]
    assert (
        decisive_guard_event(next(event for event in pair.events if event.kind == "alone")) is None
    )
    assert passes(pair, "real", 1)
    assert not passes(pair, "twin", 2)
    assert pair.core.phases["real"] is ContingencyPhase.IDLE
    assert "LAND" not in pair.vehicles["real"].words()


def test_it_lands_and_then_nothing_of_it_may_be_armed(pair: Any) -> None:
    leave_fence(pair)
    pair.fly(15.0)
    assert pair.core.phases["twin"] is ContingencyPhase.DOWN
    assert not pair.vehicles["twin"].armed
    assert pair.core.may_be_armed(pair.t_s) == ("real",)


def test_a_silent_vehicle_is_not_waited_for(pair: Any) -> None:
    fall_silent(pair)
    pair.fly(5.0)
    assert pair.core.may_be_armed(pair.t_s) == ("real",)
    pair.apply(pair.core.apply(BringDown("enough"), pair.t_s))
    pair.fly(15.0)
    assert pair.core.all_down


def test_a_silent_vehicle_that_may_be_in_the_air_is_waited_for(fake_vehicle: Any, rig: Any) -> None:
    actor = GuardedVehicle(
        autopilot=Px4(), target=MavlinkTarget(2), fence=FENCE, lands_alone=True, attached=True
    )
    real = GuardedVehicle(autopilot=Px4(), target=MavlinkTarget(1), fence=FENCE)
    vehicles = {name: fake_vehicle(name, Px4(), system=i) for i, name in ((1, "real"), (2, "twin"))}
    pair = rig(GuardCore(vehicles={"real": real, "twin": actor}), vehicles)
    pair.fly(1.0)
    fall_silent(pair)
    pair.fly(5.0)
    assert pair.kinds() == ["alone"]
    assert set(pair.core.may_be_armed(pair.t_s)) == {"real", "twin"}
    pair.apply(pair.core.apply(BringDown("enough"), pair.t_s))
    pair.fly(15.0)
    assert pair.core.phases["real"] is ContingencyPhase.DOWN
    assert not pair.core.all_down


def test_a_breach_by_one_vehicle_brings_down_both(pair: Any) -> None:
    pair.vehicles["real"].north_m_s = 2.0
    pair.fly(15.0)
    assert pair.kinds() == ["fence"]
    assert pair.core.all_down
    assert not any(vehicle.armed for vehicle in pair.vehicles.values())


def test_a_cause_of_its_own_is_never_decisive_after_the_latch_either(pair: Any) -> None:
    abort(pair)
    fall_silent(pair)
    pair.fly(5.0)
    assert pair.kinds() == ["abort", "alone"]


def test_clocks_that_came_apart_are_of_both(pair: Any) -> None:
    pair.apply(pair.core.apply(ClocksApart("twin", "its clock left the run clock"), pair.t_s))
    assert pair.core.latched == "clock"
