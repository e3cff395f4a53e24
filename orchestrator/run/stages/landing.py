"""Has everything on the ground and disarmed before a run ends."""

from orchestrator.run.vehicles.pair import Pair
from orchestrator.state.run_state import RunState

_ALL_DOWN_S = 60.0
"""How long the guard is given to bring all down; its own retries and escalation fit in."""
_AGREED_S = 3.0
"""Three heartbeats: after the driver's, the guard has as many to see the same."""


async def bring_down(pair: Pair, run_state: RunState) -> None:
    """Have the guard land everything that is in the air or armed, and wait for it."""
    guard = pair.guard
    first = run_state.decisive[0].text if run_state.decisive else "the flight was not completed"
    if run_state.reached("arm"):
        run_state.enter("land")
    guard.bring_down(first)
    if not await guard.all_down(_ALL_DOWN_S):
        still = ", ".join(f"{name} ({phase.value})" for name, phase in guard.phases.items())
        run_state.decide("ERROR", f"not down {_ALL_DOWN_S:g} s after the guard took over: {still}")
        return
    if run_state.reached("takeoff") and not any(one.driver.state.armed for one in pair.contexts):
        run_state.enter("landed")


async def see_at_rest(pair: Pair, run_state: RunState) -> None:
    """Check with the guard that all have landed; else it brings them down.

    A heartbeat that was replayed, or is another vehicle's of the same number, says that a vehicle
    is disarmed that is not: who believed it would leave it alone in the air.
    """
    if await pair.guard.at_rest(_AGREED_S):
        return
    run_state.decide("ERROR", "a vehicle reported disarmed, and armed after that")
    await bring_down(pair, run_state)
