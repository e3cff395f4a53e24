"""What a vehicle last said: for the reason of a run that it ended."""

from orchestrator.run.vehicles.pair import Pair
from safety.guard.core.events import GuardEvent

_LAST_TEXTS = 4


def last_statustext(pair: Pair, event: GuardEvent) -> str:
    """Return the last statustext of a vehicle that was lost or went into a failsafe."""
    context = next(
        (one for one in (*pair.contexts, *pair.actors) if one.name == event.vehicle), None
    )
    if context is None or event.kind not in {"lost", "failsafe", "alone"}:
        return ""
    texts = [said.text.strip() for said in context.driver.state.texts[-_LAST_TEXTS:]]
    return f"; its last STATUSTEXT: {' | '.join(texts)}" if texts else ""
