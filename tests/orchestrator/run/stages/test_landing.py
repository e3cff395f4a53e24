"""A run ends when all are on the ground and disarmed, whatever a single frame says."""

from collections.abc import Callable, Collection
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tests.orchestrator.flights import all_landed
from tests.orchestrator.run.flight.test_run import at_stage
from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.foundation.tasks import start_task
from wil_campaign.orchestrator.run.flight.conduct import _finish, bring_vehicles_down
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.orchestrator.state.run_state import RunState, Stage
from wil_campaign.safety.guard.core.commands import BringDown
from wil_campaign.safety.guard.core.contingency import ContingencyPhase
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec

Fly = Callable[..., tuple[RunResult, Path]]


def says_it_is_disarmed(pair: Any) -> None:
    """Send one heartbeat in the name of each vehicle, as a replay or a second vehicle would.

    Its sequence number is not the vehicle's next one: it is a frame of another sender.
    """
    for vehicle in pair.vehicles.values():
        codec = MavlinkCodec(system_id=vehicle.config.system_id, component_id=1)
        beat = vehicle.autopilot._heartbeat()
        beat.base_mode &= 0x7F
        vehicle._link.write(codec.pack(beat))


@pytest.mark.parametrize("campaign", ["gate", "gate-ardupilot"])
def test_a_word_that_a_landing_vehicle_is_disarmed_ends_no_run_in_the_air(
    fly_run: Fly, campaign: str
) -> None:
    there: list[Any] = []

    def lie(pair: Any) -> None:
        there.extend(pair.vehicles.values())
        says_it_is_disarmed(pair)

    sets = ("oracles={landed: {}, reached: {}}",)
    result, folder = fly_run(campaign, disturb=at_stage("land", 2.2, lie), sets=sets)
    for vehicle in there:
        assert not vehicle.autopilot.flight.armed
        assert abs(vehicle.truth().pose.position_ned_m[2]) < 0.2
    assert all_landed(folder)
    assert result.verdict == "PASS"


class Guard:
    """A guard that has everything down at once, or never."""

    def __init__(self, *, downs: bool = True) -> None:
        self._downs = downs
        self.phases = {
            "real": ContingencyPhase.DOWN,
            "twin": ContingencyPhase.DOWN if downs else ContingencyPhase.DESCEND,
        }
        """twin stands for any vehicle, also an attached one."""

    def send(self, command: BringDown) -> None:
        self.reason = command.reason

    async def all_down(self, within_s: float) -> bool:
        return self._downs and within_s > 0.0

    async def at_rest(self, within_s: float) -> bool:
        return self._downs and within_s > 0.0


def flown_pair(guard: Guard, *, armed: tuple[bool, ...]) -> Any:
    drivers = [SimpleNamespace(state=SimpleNamespace(armed=one)) for one in armed]
    return SimpleNamespace(
        guard=guard, contexts=[SimpleNamespace(driver=driver) for driver in drivers]
    )


@pytest.mark.parametrize(
    ("entered", "after"),
    [
        (["ready"], []),
        (["ready", "arm"], ["land"]),
        (["ready", "arm", "takeoff", "goal"], ["land", "landed"]),
    ],
)
def test_a_vehicle_that_the_guard_brings_down_enters_the_stages_of_landing(
    entered: list[Stage], after: list[Stage]
) -> None:
    run_state = RunState(time=lambda: 0.0)
    for stage in entered:
        run_state.enter(stage)
    pair = flown_pair(Guard(), armed=(False,))
    run_virtual(bring_vehicles_down(pair, run_state))
    assert list(run_state.entered_s) == ["start", *entered, *after]
    assert pair.guard.reason == "the flight was not completed"


def test_a_pair_of_which_one_is_still_armed_has_not_landed() -> None:
    run_state = RunState(time=lambda: 0.0)
    run_state.enter("takeoff")
    run_virtual(bring_vehicles_down(flown_pair(Guard(), armed=(False, True)), run_state))
    assert not run_state.reached("landed")


def test_a_vehicle_that_the_guard_cannot_land_is_an_error() -> None:
    run_state = RunState(time=lambda: 0.0)
    run_state.enter("takeoff")
    run_virtual(
        bring_vehicles_down(flown_pair(Guard(downs=False), armed=(False, False)), run_state)
    )
    (decided,) = run_state.decisive
    assert decided.kind == "ERROR"
    assert decided.text == "not down 60 s after the guard took over: real (down), twin (descending)"
    assert not run_state.reached("landed")


@pytest.mark.parametrize(("downs", "restored"), [(True, {"real", "twin"}), (False, {"real"})])
def test_a_vehicle_that_may_still_be_in_the_air_is_not_configured(
    downs: bool, restored: set[str]
) -> None:
    """Parameters of a failsafe or return that is under way would change beneath it."""
    given: list[set[str]] = []

    async def restore(*, at_rest: Collection[str]) -> None:
        given.append(set(at_rest))

    async def nothing() -> None:
        pass

    async def scenario() -> None:
        run_state = RunState(time=lambda: 0.0)
        run_state.enter("takeoff")
        pair = flown_pair(Guard(downs=downs), armed=(False, False))
        run: Any = SimpleNamespace(
            run_state=run_state,
            pair=pair,
            watchdog=SimpleNamespace(last_signs=nothing),
            operator_handler=SimpleNamespace(fence_changes=SimpleNamespace(end=nothing)),
            before_arming=SimpleNamespace(
                restore=restore, configuration=SimpleNamespace(fetch_logs=nothing)
            ),
        )
        await _finish(run, start_task(nothing(), name="flight"))

    run_virtual(scenario())
    assert given == [restored]
