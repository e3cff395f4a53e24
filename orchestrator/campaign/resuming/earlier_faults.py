"""Internal exceptions beside the runs of a campaign, before it was resumed: they stay with it."""

from pathlib import Path

from wil_campaign.orchestrator.model.results_reader import ResultError, read_summary
from wil_campaign.worlds.files.limited_json import loads_limited


def earlier_fault(folder: Path) -> str:
    """Return the first internal exception beside a campaign's runs so far, in words; "" for none.

    A killed campaign may have it in its log alone, and one with a full disk in summary.json alone.
    Raises OSError.
    """
    log = folder / "log.jsonl"
    if log.is_file():
        with log.open("rb") as lines:
            if text := next(filter(None, map(_fault_text, lines)), ""):
                return f"{text}; see {log}"
    try:
        is_broken = read_summary(folder / "summary.json").broken
    except ResultError:
        return ""  # the campaign was killed before it had one: then the log has them all
    return f"stated in {folder / 'summary.json'}" if is_broken else ""


def _fault_text(line: bytes) -> str:
    """Return the internal exception in a line of a campaign's log, in words; "" for another event.

    A line that was cut off counts as one: the log of a campaign has nothing else.
    """
    try:
        event = loads_limited(line)
        if event["event"] != "error":
            return ""
        return f"{event['where']}: {event['type']}: {event['message']}"
    except (ValueError, KeyError, TypeError):
        return "a line of its log that is damaged"
