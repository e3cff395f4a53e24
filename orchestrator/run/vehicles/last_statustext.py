"""What a vehicle last said: for the reason of a run that it ended."""

from orchestrator.run.vehicles.pair import Pair
from safety.guard.core.events import GuardEvent
from vehicles.driver.vehicle_state import StatusText

_LAST_TEXTS = 4
_FRESH_S = 2.0
"""A text that is older may be of another matter, as one of the preflight."""


def last_statustext(pair: Pair, event: GuardEvent) -> str:
    """Return the last statustext of a vehicle that was lost or went into a failsafe."""
    context = next(
        (one for one in (*pair.contexts, *pair.actors) if one.name == event.vehicle), None
    )
    if context is None or event.kind not in {"lost", "failsafe", "alone"}:
        return ""
    texts = [_aged(said, event.t_s) for said in context.driver.state.texts[-_LAST_TEXTS:]]
    return f"; its last STATUSTEXT: {' | '.join(texts)}" if texts else ""


def _aged(said: StatusText, t_s: float) -> str:
    """Return a text with how long ago it was sent, where that is no answer to what happened."""
    since_s = t_s - said.t_s
    text = said.text.strip()
    return f"{text} ({since_s:.0f} s before)" if since_s >= _FRESH_S else text
