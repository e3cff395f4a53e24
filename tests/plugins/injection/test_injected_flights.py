"""Flights whose autopilot is told of what stands in the virtual world, through the guard."""

from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from pymavlink import mavutil

from tests.orchestrator.flights import all_landed, rows_of
from wil_campaign.orchestrator.run_results.run_result import RunResult

Fly = Callable[..., tuple[RunResult, Path]]


def flown(
    fly_run: Fly, *sets: str, mode: str = "wil", boots: bool = False
) -> tuple[RunResult, Path]:
    return fly_run("avoid-ardupilot", "default", mode, has_cameras=False, sets=sets, boots=boots)


def messages(log: Path) -> Counter[tuple[str, int]]:
    """Return how many messages of whom a .tlog holds, in the order of the first ones."""
    link: Any = mavutil.mavlink_connection(str(log))
    found: Counter[tuple[str, int]] = Counter()
    while (message := link.recv_match()) is not None:
        found[message.get_type(), message.get_srcSystem()] += 1
    link.close()
    return found


def farthest_north_m(folder: Path, vehicle: str) -> float:
    """Return how far north a vehicle came in truth."""
    rows = [row for row in rows_of(folder) if row["vehicle"] == vehicle and row["true_north_m"]]
    return max(float(row["true_north_m"]) for row in rows)


def test_the_real_autopilot_stops_before_a_wall_that_is_not_there_and_again(fly_run: Fly) -> None:
    result, folder = flown(fly_run, boots=True)
    assert (result.verdict, result.reason) == ("PASS", "")
    farthest_m = farthest_north_m(folder, "real")
    # Ten seconds at 1 m/s would end behind the wall at 4.9 m; AVOID_MARGIN is 1.5 m.
    assert 3.2 < farthest_m < 3.6
    sent = messages(folder / "real.tlog")
    assert sent["OBSTACLE_DISTANCE", 245] > 100
    order = list(sent)
    assert order.index(("AUTOPILOT_VERSION", 1)) < order.index(("OBSTACLE_DISTANCE", 245))
    assert result.outside is not None
    assert [one.vehicle for one in result.outside.injected] == ["real"]
    assert all(one.sent > 100 and one.stale == 0 for one in result.outside.injected)
    assert all_landed(folder)
    again, beside = flown(fly_run, boots=True)
    assert again.outside == result.outside, "the same seed injects the same"
    assert rows_of(beside) == rows_of(folder)


@pytest.mark.parametrize(("coupling", "told"), [("follow", ["real"]), ("shadow", ["real", "twin"])])
def test_a_twin_that_follows_keeps_from_nothing_by_itself(
    fly_run: Fly, coupling: str, told: list[str]
) -> None:
    """It was pushed off its vehicle by what that had kept from: INVALID with most seeds."""
    result, folder = flown(fly_run, f"vehicles.twin.coupling={coupling}", "seed=4711", boots=True)
    assert (result.verdict, result.reason) == ("PASS", "")
    assert result.outside is not None
    assert [one.vehicle for one in result.outside.injected] == told
    sent = messages(folder / "twin.tlog")
    assert sent["OBSTACLE_DISTANCE", 245] > 50, "else its sensor is dead"
    assert result.twin is not None
    assert result.twin.distance_max_m is not None
    if coupling == "follow":
        assert result.twin.distance_max_m < 0.5


def test_in_mode_sim_the_twin_gets_its_own_lidar(fly_run: Fly) -> None:
    result, folder = flown(fly_run, mode="sim")
    assert (result.verdict, result.reason) == ("PASS", "")
    farthest_m = farthest_north_m(folder, "twin")
    assert 3.2 < farthest_m < 3.6


def test_an_autopilot_that_would_not_listen_is_not_even_armed(fly_run: Fly) -> None:
    result, folder = flown(fly_run, "vehicles.real.params={AVOID_ENABLE: 1}")
    assert result.verdict == "ERROR"
    assert "real, obstacle_distance: PRX1_TYPE is 0" in result.reason
    assert "set PRX1_TYPE to 2 and reboot the autopilot" in result.reason
    assert "set AVOID_ENABLE to 3" in result.reason
    assert "twin" not in result.reason
    assert all(row["armed"] == "0" for row in rows_of(folder))


def test_an_arducopter_whose_range_sensor_is_silent_is_not_ready(fly_run: Fly) -> None:
    result, _ = flown(fly_run, "inject={}", mode="sim")
    assert result.verdict == "ERROR"
    assert "pre-arm checks have not passed" in result.reason
    assert "PreArm: PRX1: No Data" in result.reason


@pytest.mark.parametrize(
    ("autopilot", "parameter"), [("px4", "EKF2_EV_CTRL"), ("ardupilot", "VISO_TYPE")]
)
def test_a_feature_that_the_vehicle_lacks_is_reported_by_its_parameter(
    fly_run: Fly, autopilot: str, parameter: str
) -> None:
    result, _ = flown(
        fly_run,
        "inject={vision_position_estimate: {to: [real]}}",
        f"vehicles.real.autopilot={autopilot}",
        "vehicles.real.params={}",
        "vehicles.twin.params={}",
    )
    assert result.verdict == "ERROR"
    assert f"{parameter} does not exist on this autopilot" in result.reason


BY_POSITIONS = """
from wil_campaign.vehicles.autonomy import Command
from wil_campaign.vehicles.setpoints import PositionSetpoint


class ByPositions:
    def __init__(self, *, goal, parameters, seed):
        pass

    def perceive(self, reading):
        pass

    def act(self, telemetry):
        return Command(PositionSetpoint((2.0, 0.0, -1.5)))
"""


def test_an_autonomy_that_goes_round_the_avoidance_proves_nothing(
    fly_run: Fly, tmp_path: Path
) -> None:
    (tmp_path / "by_positions.py").write_text(BY_POSITIONS)
    result, folder = flown(fly_run, f"autonomy={tmp_path}/by_positions.py:ByPositions", mode="sim")
    assert result.verdict == "INVALID"
    assert "twin, obstacle_distance: position setpoints in GUIDED are not adjusted" in result.reason
    assert all_landed(folder)
