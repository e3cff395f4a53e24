"""Lands all vehicles and checks that they are disarmed before a run ends."""

from wil_campaign.orchestrator.run.vehicles.pair import Pair
from wil_campaign.orchestrator.state.run_state import RunState
from wil_campaign.safety.guard.core.commands import BringDown
from wil_campaign.safety.guard.core.contingency import Phase

_ALL_DOWN_S = 60.0
"""How long the guard may take to land all, with its own retries and escalation."""
_AGREED_S = 3.0
"""Three heartbeats: the guard has so long to confirm what the driver reported."""


async def bring_down(pair: Pair, run_state: RunState) -> None:
    """Have the guard land every vehicle that is in the air or armed, and wait for it."""
    guard = pair.guard
    first = run_state.decisive[0].text if run_state.decisive else "the flight was not completed"
    if run_state.reached("arm"):
        run_state.enter("land")
    guard.send(BringDown(first))
    if not await guard.all_down(_ALL_DOWN_S):
        still = ", ".join(f"{name} ({phase.value})" for name, phase in guard.phases.items())
        run_state.decide("ERROR", f"not down {_ALL_DOWN_S:g} s after the guard took over: {still}")
        return
    if run_state.reached("takeoff") and not any(
        context.driver.state.armed for context in pair.contexts
    ):
        run_state.enter("landed")


async def verify_landed(pair: Pair, run_state: RunState) -> None:
    """Check with the guard that all vehicles have landed; else have it land them.

    A heartbeat that was replayed, or comes from another vehicle with the same system ID, may report
    an armed vehicle as disarmed: it must not be left alone in the air.
    """
    if await pair.guard.at_rest(_AGREED_S):
        return
    text = f"the guard did not confirm within {_AGREED_S:g} s that all vehicles are disarmed"
    run_state.decide("ERROR", text)
    await bring_down(pair, run_state)


async def confirmed_at_rest(pair: Pair) -> frozenset[str]:
    """Return the vehicles of a run that the guard confirms to be disarmed."""
    if await pair.guard.at_rest(_AGREED_S):
        return frozenset(pair.guard.phases)
    return frozenset(name for name, phase in pair.guard.phases.items() if phase is Phase.DOWN)
