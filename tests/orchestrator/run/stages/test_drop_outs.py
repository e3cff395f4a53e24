"""What of a vehicle's own ends its flight alone, and what ends the run."""

from collections.abc import Awaitable, Callable

import pytest

from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.orchestrator.run.stages.drop_outs import unless_dropped_out
from wil_campaign.orchestrator.state.run_state import RunState
from wil_campaign.vehicles.errors import VehicleError

Do = Callable[[RunState], Awaitable[None]]


async def refused(run_state: RunState) -> None:
    del run_state
    raise VehicleError("twin: refused")


async def held_and_refused(run_state: RunState) -> None:
    run_state.hold()
    raise VehicleError("twin: refused")


async def timed_out(run_state: RunState) -> None:
    del run_state
    raise TimeoutError("nobody's deadline")


def do_with_twin(do: Do, *, repeated: bool) -> RunState:
    run_state = RunState(time=lambda: 0.0)
    run_virtual(unless_dropped_out("twin", run_state, lambda: do(run_state), repeated=repeated))
    return run_state


@pytest.mark.parametrize(
    ("do", "repeated"), [(refused, False), (refused, True), (held_and_refused, False)]
)
def test_an_error_of_its_own_drops_a_vehicle_out(do: Do, repeated: bool) -> None:
    left = do_with_twin(do, repeated=repeated).dropped_out
    assert left["twin"].reason == "twin: refused"


def test_an_error_after_a_hold_is_raised_where_the_step_is_repeated() -> None:
    with pytest.raises(VehicleError, match="refused"):
        do_with_twin(held_and_refused, repeated=True)


def test_a_timeout_that_is_no_drop_out_is_not_swallowed() -> None:
    """Taken for the vehicle's drop-out it would end a stage that was not done, without a word."""
    with pytest.raises(TimeoutError, match="nobody's deadline"):
        do_with_twin(timed_out, repeated=False)
