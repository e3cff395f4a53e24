"""Progress is for people: so much of it goes on as they can follow, and all that happens."""

from time import monotonic

import pytest

from wil_campaign.orchestrator.operator.run_messages import (
    ProgressLimiter,
    RunEventReport,
    RunProgressReport,
)

PROGRESS = RunProgressReport(case="default", mode="sim", repetition=1, stage="goal", t_s=1.0)
HAPPENING = RunEventReport(
    run="default/sim/1", t_s=1.0, kind="stage", word="goal", vehicle="", text=""
)


def test_progress_faster_than_the_limit_is_dropped_and_happenings_are_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now_s = monotonic()
    monkeypatch.setattr(
        "wil_campaign.orchestrator.operator.run_messages.time.monotonic", lambda: now_s
    )
    limiter = ProgressLimiter(0.1)

    passed = []
    for _ in range(100):  # a second, a hundredth at a time
        passed.append(limiter.passes(PROGRESS))
        assert limiter.passes(HAPPENING)
        now_s += 0.01

    assert passed[0]
    assert 9 <= sum(passed) <= 10


def test_progress_at_the_pace_of_the_wall_all_passes(monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = monotonic()
    monkeypatch.setattr(
        "wil_campaign.orchestrator.operator.run_messages.time.monotonic", lambda: now_s
    )
    limiter = ProgressLimiter(0.1)

    for _ in range(10):
        assert limiter.passes(PROGRESS)
        now_s += 0.5
