"""Campaigns that would pass without a look are refused: nobody should trust their green."""

from typing import Any

import pytest

ORACLES = "oracles:\n  collision: {}\n  reached: {}\n  time_limit: {limit_s: 40}\n  geofence:\n"


def asking(files: Any, oracles: str) -> list[str]:
    files.change(ORACLES, f"oracles: {oracles}\n")
    found: list[str] = files.faults()
    return found


def test_a_mode_that_no_required_oracle_judges_is_reported(files: Any) -> None:
    goal, oracles = asking(files, "{reached: {vehicle: real}}")
    assert goal.startswith(
        "campaign.yaml:20:25: in mode sim no oracle judges whether 'twin' reaches"
    )
    assert "add 'reached: {}', with 'required: false' to report it only" in goal
    assert oracles.startswith("campaign.yaml:29:1: in mode sim no required oracle judges 'twin'")


def test_oracles_that_only_report_judge_nothing(files: Any) -> None:
    found = asking(files, "{reached: {required: false}, collision: {required: false}}")
    assert [fault.partition(": ")[2] for fault in found] == [
        f"in mode {mode} no required oracle judges '{name}': nearly any flight would pass"
        for mode, name in (("sim", "twin"), ("wil", "real"))
    ]


def test_a_pair_only_oracle_leaves_the_twin_alone_unjudged(files: Any) -> None:
    found = asking(
        files, "{reached: {required: false}, twin_divergence: {max_m: 1, required: true}}"
    )
    assert len(found) == 1
    assert "in mode sim no required oracle judges 'twin'" in found[0]


def test_a_goal_of_gates_has_to_be_judged_or_reported(files: Any) -> None:
    found = asking(files, "{collision: {}}")
    assert len(found) == 2
    assert all("reaches it; add 'reached: {}'" in fault for fault in found)
    files.change("oracles: {collision: {}}", "oracles: {collision: {}, reached: {required: false}}")
    assert files.load().runs


def test_a_goal_at_a_position_has_to_be_judged_or_reported(files: Any) -> None:
    files.change("gates: [gate]", "position: {north_m: 1, east_m: 0, up_m: 1.2}")
    found = asking(files, "{collision: {}}")
    assert len(found) == 2
    assert all("add 'reached_position: {tolerance_m: 0.3}'" in fault for fault in found)


def test_a_misspelt_oracle_is_one_fault(files: Any) -> None:
    (found,) = asking(files, "{collision: {}, reachd: {}}")
    assert "unknown oracle 'reachd'; did you mean 'reached'?" in found


@pytest.mark.parametrize("tolerance_m", [1.2, 1.5, 50])
def test_a_tolerance_within_which_a_vehicle_never_took_off_is_reported(
    files: Any, tolerance_m: float
) -> None:
    files.change("seed: 7\n", f"seed: 7\nsync: {{takeoff_tolerance_m: {tolerance_m}}}\n")
    assert files.faults() == [
        f"campaign.yaml:27:29: '{name}' climbs by 1.2 m: the tolerance of {tolerance_m:g} m "
        "is met on the ground"
        for name in ("twin", "real")
    ]


def test_a_goal_beneath_the_start_is_reported(files: Any) -> None:
    files.change("start: {north_m: 0, east_m: 0}", "start: {north_m: 0, east_m: 0, up_m: 1.5}")
    assert "campaign.yaml:20:20: is not above the start of 'real', 1.5 m up" in files.faults()


@pytest.mark.parametrize(
    ("sync", "oracles", "wanted_s"),
    [
        ("", "{reached: {}}", 600.0),
        ("", "{reached: {}, time_limit: {limit_s: 40}}", 600.0),
        ("", "{reached: {}, time_limit: {limit_s: 900}}", 901.0),
        ("sync: {goal_timeout_s: 20}\n", "{reached: {}, time_limit: {limit_s: 40}}", 20.0),
    ],
)
def test_a_goal_has_a_time_out_however_little_is_asked_for(
    files: Any, sync: str, oracles: str, wanted_s: float
) -> None:
    files.change("seed: 7\n", f"seed: 7\n{sync}")
    files.change(ORACLES, f"oracles: {oracles}\n")
    assert files.load().setups["large"].sync.goal_timeout_s == wanted_s
