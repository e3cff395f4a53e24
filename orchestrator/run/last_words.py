"""What a vehicle last said: for the reason of a run that it ended."""

from orchestrator.run.opening import Pair
from safety.guard.events import GuardEvent

_LAST_TEXTS = 4


def last_words(pair: Pair, event: GuardEvent) -> str:
    """Return what a vehicle that was lost, or went into a failsafe, last said."""
    station = next((one for one in pair.stations if one.name == event.vehicle), None)
    if station is None or event.kind not in {"lost", "failsafe"}:
        return ""
    texts = [said.text.strip() for said in station.driver.state.texts[-_LAST_TEXTS:]]
    return f"; it last said: {' | '.join(texts)}" if texts else ""
