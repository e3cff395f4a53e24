"""Who has to act after a fault, and how soon: that all came down in the end is not enough.

The autopilots' own failsafes land vehicles too. A guard that does nothing would go unnoticed
beside them.
"""

from collections.abc import Iterable, Mapping

from tests.faults.witness import Sight

ACTS = frozenset(
    {"abort", "bring_down", "silence", "lost", "fence", "takeover", "failsafe", "guard", "hold"}
)
"""Kinds of the guard's events that are the beginning of a takeover."""
UNDISTURBED = frozenset({"garbage", "foreign", "flood", "forged", "cutting program", "clock jump"})
"""Troubles that a flight must not even notice."""


def acted_after_s(events: Iterable[tuple[float, str]], struck_s: float | None) -> float | None:
    """Return how long after the fault the guard took over; None when it did not.

    events: time and kind of each that the guard told.
    """
    if struck_s is None:
        return None
    later = [t_s - struck_s for t_s, kind in events if kind in ACTS and t_s >= struck_s]
    return min(later, default=None)


def late(
    acted_s: float | None,
    within_s: float | None,
    struck_s: float | None,
    others: Mapping[str, Sight],
) -> list[str]:
    """Return that the guard was too late, if it was, and if anybody was in need of it.

    within_s: None where it need not act. others: vehicles that were not hit, and were armed then.
    """
    if within_s is None or struck_s is None:
        return []
    needy = [
        name
        for name, sight in others.items()
        if not (sight.down and sight.down_s <= struck_s + within_s)
    ]
    if not needy or (acted_s is not None and acted_s <= within_s):
        return []
    when = "never" if acted_s is None else f"after {acted_s:.2f} s"
    return [f"the guard took over {when}, not within {within_s:g} s; in need: {', '.join(needy)}"]
