"""Summary lines of external inputs, outlets and injections, over all runs of a campaign."""

from collections.abc import Callable, Iterable, Sequence
from typing import TypeVar

from wil_campaign.orchestrator.run_results.result_parts import (
    CaptureResult,
    ExternalResult,
    InjectedResult,
    OutletResult,
    SourceResult,
)
from wil_campaign.orchestrator.run_results.run_result import RunResult

R = TypeVar("R")


def external_lines(runs: Iterable[RunResult]) -> list[str]:
    """Return a line for each external source, motion capture, outlet and injection.

    Counts are summed over the runs; rates, latencies and gaps are those of the worst run.
    """
    given = [run.outside for run in runs if run.outside is not None]
    return [
        *_lines(given, lambda one: one.sources, lambda one: (one.vehicle, one.sensor), _source),
        *_lines(given, lambda one: one.captures, lambda one: (one.vehicle, one.address), _capture),
        *_lines(given, lambda one: one.outlets, lambda one: (one.name,), _outlet),
        *_lines(
            given, lambda one: one.injected, lambda one: (one.vehicle, one.thing), _injection_text
        ),
    ]


def _source(all_: Sequence[SourceResult]) -> str:
    """Return the line of an external image source, summed over runs."""
    one = all_[0]
    parts = (f"{sum(getattr(each, name) for each in all_)} {name}" for name in _SOURCE_COUNTS)
    text = f"{one.vehicle} {one.sensor} ({one.source}): {', '.join(parts)}"
    text = f"{text}, {_count_text(sum(each.stalls for each in all_), 'stall')}"
    return text + _restarts_text(sum(each.restarts for each in all_))


_SOURCE_COUNTS = ("delivered", "dropped", "missed", "damaged")


def _capture(all_: Sequence[CaptureResult]) -> str:
    """Return the line of an external motion capture, summed over runs."""
    one, feeds = all_[0], [each.feed for each in all_]
    rates = [feed.rate_hz for feed in feeds if feed.rate_hz is not None]
    late = [
        (feed.latency_ms_p99 or 0.0, feed.latency_ms_p50)
        for feed in feeds
        if feed.latency_ms_p50 is not None
    ]
    text = f"{one.vehicle} at {one.address}: "
    text += f"{min(rates):.1f} Hz, " if rates else "no rate, "
    if late:
        p99, p50 = max(late)
        text += f"latency {p50:.1f} ms (p99 {p99:.1f}), "
    missing = sum(feed.missing + feed.invalid for feed in feeds)
    dropouts = sum(feed.dropouts for feed in feeds)
    gap_s = max(feed.longest_gap_s for feed in feeds)
    text += f"{missing} missing, {_count_text(dropouts, 'dropout')}, "
    text += f"longest gap {1000 * gap_s:.0f} ms"
    return text + _restarts_text(sum(feed.restarts for feed in feeds))


def _restarts_text(count: int) -> str:
    """Return in words how often a sender restarted; "" for never."""
    return f"; its sender restarted {_count_text(count, 'time')}" if count else ""


def _outlet(all_: Sequence[OutletResult]) -> str:
    """Return the line of an external image outlet, summed over runs."""
    delivered, offered = (
        sum(outlet_result.delivered for outlet_result in all_),
        sum(outlet_result.offered for outlet_result in all_),
    )
    text = f"{all_[0].name}: {delivered} of {offered} images delivered"
    trouble = next((outlet_result.trouble for outlet_result in all_ if outlet_result.trouble), "")
    return f"{text} ({trouble})" if trouble else text


def _injection_text(all_: Sequence[InjectedResult]) -> str:
    """Return the line of an injection, summed over runs."""
    sent, stale = sum(result.sent for result in all_), sum(result.stale for result in all_)
    text = f"{all_[0].vehicle} was sent {all_[0].thing} {sent} times"
    return f"{text}; {stale} were too old to send" if stale else text


def _lines(
    given: Iterable[ExternalResult],
    of: Callable[[ExternalResult], Iterable[R]],
    key: Callable[[R], tuple[str, ...]],
    line: Callable[[Sequence[R]], str],
) -> list[str]:
    groups: dict[tuple[str, ...], list[R]] = {}
    for result in given:
        for each in of(result):
            groups.setdefault(key(each), []).append(each)
    return [line(each) for each in groups.values()]


def _count_text(count: int, name: str) -> str:
    return f"{count} {name}{'' if count == 1 else 's'}"
