"""People see at the end what came in from outside and what went out."""

from dataclasses import replace

from wil_campaign.orchestrator.cli.external_lines import external_lines
from wil_campaign.orchestrator.run_results.result_parts import (
    CaptureResult,
    ExternalResult,
    InjectedResult,
    OutletResult,
    SourceResult,
)
from wil_campaign.orchestrator.run_results.run_result import RunResult, SyncResult
from wil_campaign.vehicles.sources.feed_statistics import FeedStatistics

FEED = FeedStatistics(2000, 100.0, 4.0, 6.0, 2, 1, 0, 1, 0.05)
OUTSIDE = ExternalResult(
    sources=(SourceResult("real", "camera", "live", 300, 2, 1, 0, 1, ""),),
    captures=(CaptureResult("real", "udp://0.0.0.0:5570", FEED, 0, ""),),
    outlets=(OutletResult("rtp 127.0.0.1:5600", 300, 290, 10, 0, ""),),
    injected=(InjectedResult("real", "obstacle_distance", 150, 3, 0),),
)


def run(outside: ExternalResult | None) -> RunResult:
    return RunResult(
        case="large",
        mode="wil",
        rep=1,
        seed=1,
        verdict="PASS",
        reason="",
        also=(),
        required=True,
        duration_s=20.0,
        wall_s=20.0,
        oracles=(),
        sync=SyncResult(),
        mixing=None,
        outside=outside,
    )


def test_each_external_source_and_outlet_has_a_line() -> None:
    assert external_lines([run(OUTSIDE)]) == [
        "real camera (live): 300 delivered, 2 dropped, 1 missed, 0 damaged, 1 stall",
        (
            "real at udp://0.0.0.0:5570: 100.0 Hz, latency 4.0 ms (p99 6.0), 3 missing, 1 dropout, "
            "longest gap 50 ms"
        ),
        "rtp 127.0.0.1:5600: 290 of 300 images delivered",
        "real was sent obstacle_distance 150 times",
    ]
    assert external_lines([run(None)]) == []


def test_counts_are_summed_and_the_worst_figures_shown() -> None:
    slow = replace(FEED, rate_hz=80.0, latency_ms_p50=9.0, latency_ms_p99=30.0, longest_gap_s=0.4)
    dead = replace(FEED, rate_hz=None, latency_ms_p50=None, latency_ms_p99=None)
    worse = replace(
        OUTSIDE,
        captures=tuple(replace(OUTSIDE.captures[0], feed=feed) for feed in (slow, dead)),
        outlets=(replace(OUTSIDE.outlets[0], trouble="no route"),),
        injected=(InjectedResult("real", "obstacle_distance", 10, 0, 5),),
        sources=(replace(OUTSIDE.sources[0], restarts=1),),
    )
    lines = external_lines([run(OUTSIDE), run(worse)])
    assert lines[0] == (
        "real camera (live): 600 delivered, 4 dropped, 2 missed, 0 damaged, 2 stalls; "
        "its sender restarted 1 time"
    )
    assert "80.0 Hz, latency 9.0 ms (p99 30.0), 9 missing" in lines[1]
    assert "longest gap 400 ms" in lines[1]
    assert lines[2] == "rtp 127.0.0.1:5600: 580 of 600 images delivered (no route)"
    assert lines[3] == "real was sent obstacle_distance 160 times; 5 were too old to send"


def test_a_feed_of_which_nothing_is_known_has_a_line() -> None:
    dead = replace(FEED, rate_hz=None, latency_ms_p50=None, latency_ms_p99=None)
    only = ExternalResult(captures=(replace(OUTSIDE.captures[0], feed=dead),))
    assert external_lines([run(only)])[0].startswith("real at udp://0.0.0.0:5570: no rate, 3 miss")
