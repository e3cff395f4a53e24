"""Published counts that a campaign file quotes, to be shown beside its own; pure."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from wil_campaign.foundation.files.documents import Data


@dataclass(frozen=True, slots=True)
class PublishedCounts:
    """Published counts. source: the publication. passed: by case and mode, "1/5" or a text."""

    source: str = ""
    passed: Mapping[tuple[str, str], str] = field(default_factory=dict)


def counts_in(text: str) -> tuple[int, int] | None:
    """Return passes and flights of a text like "1/5"; None for another text, such as "7/5"."""
    passed, _, flown = (part.strip() for part in text.partition("/"))
    if not (passed.isdecimal() and flown.isdecimal()) or int(passed) > int(flown):
        return None
    return int(passed), int(flown)


def published_counts_of(document: Data) -> PublishedCounts:
    """Return the published counts in a campaign file as flown; none where it has none."""
    part = document.get("published") if isinstance(document, dict) else None
    cases = part.get("passed") if isinstance(part, dict) else None
    if not isinstance(part, dict) or not isinstance(cases, dict):
        return PublishedCounts()
    passed = {
        (str(case), str(mode)): str(text)
        for case, modes in cases.items()
        if isinstance(modes, dict)
        for mode, text in modes.items()
    }
    return PublishedCounts(str(part.get("source", "")), passed)
