"""The last STATUSTEXT messages of a vehicle, for the reason of a run that it ended."""

from wil_campaign.orchestrator.run.vehicles.pair import Pair
from wil_campaign.safety.guard.core.events import GuardEvent
from wil_campaign.vehicles.driver.vehicle_state import StatusText

_LAST_TEXTS = 4
_FRESH_S = 2.0
"""An older text may have another cause: its age is shown."""


def last_statustext(pair: Pair, event: GuardEvent, *, armed_s: float | None) -> str:
    """Return the last texts of the vehicle of a guard event: lost, failsafe, landed alone.

    armed_s: when the vehicles were to arm; texts of the preflight ended no flight.
    """
    context = next(
        (one for one in (*pair.contexts, *pair.actors) if one.name == event.vehicle), None
    )
    if context is None or event.kind not in {"lost", "failsafe", "alone"}:
        return ""
    recent = [text for text in context.driver.state.texts if armed_s is None or text.t_s >= armed_s]
    texts = [_with_age(statustext, event.t_s) for statustext in recent[-_LAST_TEXTS:]]
    return f"; its last STATUSTEXT: {' | '.join(texts)}" if texts else ""


def _with_age(statustext: StatusText, t_s: float) -> str:
    """Return a text; with its age if it was sent long before the event."""
    since_s = t_s - statustext.t_s
    text = statustext.text.strip()
    return f"{text} ({since_s:.0f} s before)" if since_s >= _FRESH_S else text
