"""Has everything on the ground and disarmed before a run ends."""

from orchestrator.run.course import Course
from orchestrator.run.opening import Pair

_ALL_DOWN_S = 60.0
"""How long the guard is given to bring all down; its own retries and escalation fit in."""
_AGREED_S = 3.0
"""Three heartbeats: after the driver's, the guard has as many to see the same."""


async def bring_down(pair: Pair, course: Course) -> None:
    """Have the guard land everything that is in the air or armed, and wait for it."""
    guard = pair.guard
    first = course.decisive[0].text if course.decisive else "the flight was not completed"
    if course.reached("arm"):
        course.enter("land")
    guard.bring_down(first)
    if not await guard.all_down(_ALL_DOWN_S):
        still = ", ".join(f"{name} ({phase.value})" for name, phase in guard.phases.items())
        course.decide("ERROR", f"not down {_ALL_DOWN_S:g} s after the guard took over: {still}")
        return
    if course.reached("takeoff") and not any(one.driver.state.armed for one in pair.stations):
        course.enter("landed")


async def see_at_rest(pair: Pair, course: Course) -> None:
    """Have the guard agree that all have landed; where it does not, it brings them down.

    A heartbeat that was replayed, or is another vehicle's of the same number, says that a vehicle
    is disarmed that is not: who believed it would leave it alone in the air.
    """
    if await pair.guard.at_rest(_AGREED_S):
        return
    course.decide("ERROR", "a vehicle said that it was disarmed, and was heard armed after that")
    await bring_down(pair, course)
