"""Campaigns over the field's bad radio, in virtual time: a verdict, without hang, and the same."""

import json
import re
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.orchestrator.conftest import BRIEF
from wil_campaign.foundation.files.document_writer import to_json
from wil_campaign.orchestrator.run_results.run_result import RunResult

Fly = Callable[..., tuple[RunResult, Path]]
LONGER = (*BRIEF, "autonomy.with={speed_m_s: 0.4, for_s: 6}")
BAD = "links.real={latency_ms: 80, jitter_ms: 40, loss: 0.05}"
DARK = "links.real={blackouts: [{on: goal, after_s: 2, for_s: %g}]}"
BOTH = pytest.mark.parametrize("campaign", ["gate", "gate-ardupilot"])


def guard_events(folder: Path) -> list[str]:
    lines = map(json.loads, (folder / "log.jsonl").read_text("utf-8").splitlines())
    return [line["kind"] for line in lines if line["event"] == "guard"]


@BOTH
@pytest.mark.parametrize("seed", [4])
def test_the_pair_flies_over_a_radio_that_loses_and_is_late(
    fly_run: Fly, campaign: str, seed: int
) -> None:
    # PX4 boots by that radio, too.
    result, _ = fly_run(campaign, sets=(BAD,), seed=seed, boots=campaign == "gate")
    assert (result.verdict, result.reason) == ("PASS", "")
    link = next(o for o in result.oracles if (o.name, o.vehicle) == ("link", "real"))
    twin = next(o for o in result.oracles if (o.name, o.vehicle) == ("link", "twin"))
    assert link.actual is not None
    assert twin.actual is not None
    # Several messages are due in each 20 ms: what is missed for longer shows the radio.
    assert link.actual > twin.actual


def test_luck_on_the_radio_is_seeded(fly_run: Fly) -> None:
    def everything(seed: int) -> tuple[str, bytes]:
        result, folder = fly_run(sets=(*BRIEF, BAD), seed=seed)
        document = json.loads(to_json(result))
        del document["wall_s"]
        return json.dumps(document), (folder / "real.tlog").read_bytes()

    assert everything(3) == everything(3)


def test_px4_returns_by_itself_in_an_outage_and_that_ends_at_the_ceiling(fly_run: Fly) -> None:
    # COM_OF_LOSS_T is 1 s; without a remote control it returns home, and climbs for that: had the
    # preflight not been overridden, it would be told to land, and to return beneath the ceiling.
    by_default = (
        "preflight.failsafe=check",
        "preflight.override={failsafe: a test, return_altitude: a test}",
    )
    result, folder = fly_run(sets=(*LONGER, DARK % 3.0, *by_default))
    assert {item.by for item in result.preflight if item.outcome == "overridden"} == {"a test"}
    assert result.verdict == "FAIL"
    assert "ceiling" in result.reason
    assert "fence" in guard_events(folder)


def test_ardupilot_waits_in_place_and_a_lost_vehicle_is_no_fail_of_the_autonomy(
    fly_run: Fly,
) -> None:
    result, folder = fly_run("gate-ardupilot", sets=(*LONGER, DARK % 3.5))
    assert result.verdict == "ERROR"
    assert result.reason.startswith("nothing received from real for 3 s")
    assert {"lost", "heard"} <= set(guard_events(folder))


@BOTH
def test_a_gap_that_was_recovered_but_too_long_fails(fly_run: Fly, campaign: str) -> None:
    sets = (*LONGER, DARK % 1.2, "vehicles.real.params={COM_OF_LOSS_T: 2.0}")
    result, _ = fly_run(campaign, sets=sets if campaign == "gate" else sets[:-1])
    assert result.verdict == "FAIL"
    assert re.match(r"real was silent for 1\.[23] s, more than 1 s", result.reason)


@pytest.mark.parametrize(
    ("dark_s", "verdict", "said"),
    [
        (1.3, "FAIL", "real was silent for 1.3 s, more than 1 s"),
        (4.0, "ERROR", "nothing received from real for 3 s"),
    ],
)
def test_a_silence_is_judged_as_one_also_where_poses_come_by_that_radio(
    fly_run: Fly, dark_s: float, verdict: str, said: str
) -> None:
    """Not as a mixture or a pair without poses, whose INVALID run would be flown again."""
    by_its_estimate = ("vehicles.real.pose_source=mavlink", "vehicles.real.profile=nominal")
    patient = "vehicles.real.params={COM_OF_LOSS_T: 2.0}"
    result, _ = fly_run(sets=(*LONGER, DARK % dark_s, *by_its_estimate, patient))
    assert (result.verdict, result.reason[: len(said)]) == (verdict, said)
    assert any("real and twin was not measured" in later.reason for later in result.also)


@pytest.mark.parametrize(
    "link",
    [
        "{loss: 1.0}",
        "{to_vehicle: {loss: 1.0}}",
        "{from_vehicle: {corrupt: 1.0}}",
    ],
)
def test_a_link_by_which_nothing_comes_is_an_error_within_the_time_limit(
    fly_run: Fly, link: str
) -> None:
    result, _ = fly_run(sets=(*BRIEF, f"links.real={link}", "sync.ready_timeout_s=8"))
    assert result.verdict == "ERROR"
    assert "real guard" in result.reason


FLAPS = "links.real={blackouts: [%s]}"


def flaps(for_s: float, every_s: float, count: int) -> str:
    """Return a radio that goes every now and then from t0 on."""
    row = "{on: goal, after_s: %g, for_s: %g}"
    return FLAPS % ", ".join(row % (0.5 + every_s * index, for_s) for index in range(count))


@BOTH
def test_a_radio_that_flaps_for_less_than_the_limit_is_flown_by(
    fly_run: Fly, campaign: str
) -> None:
    # Half of the heartbeats are lost, and the campaign declares it.
    sets = (*LONGER, flaps(0.3, 0.6, 10), "vehicles.real.telemetry={max_gap_s: 4}")
    result, folder = fly_run(campaign, sets=sets)
    assert (result.verdict, result.reason) == ("PASS", "")
    (link,) = [
        oracle for oracle in result.oracles if (oracle.name, oracle.vehicle) == ("link", "real")
    ]
    assert link.actual is not None
    assert 0.3 <= link.actual < 0.6
    # Nothing is taken for a loss, and nobody writes of each gap.
    assert not {"lost", "heard"} & set(guard_events(folder))
    log = list(map(json.loads, (folder / "log.jsonl").read_text("utf-8").splitlines()))
    assert len([one for one in log if one["event"] == "vehicle"]) < 80
    assert "link_lost" not in {one.get("kind") for one in log}


def test_a_radio_that_flaps_for_longer_fails_at_its_first_gap(fly_run: Fly) -> None:
    sets = (*LONGER, flaps(1.3, 1.8, 3), "vehicles.real.params={COM_OF_LOSS_T: 2.5}")
    result, folder = fly_run(sets=sets)
    assert result.verdict == "FAIL"
    assert re.match(r"real was silent for 1\.[345] s, more than 1 s", result.reason)
    # The verdict is told once, however often the radio goes.
    log = list(map(json.loads, (folder / "log.jsonl").read_text("utf-8").splitlines()))
    told = [one for one in log if one["event"] == "decisive" and "was silent" in one["reason"]]
    assert len(told) == 1
