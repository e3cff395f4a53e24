"""What a vehicle's takeoff is known to take before it has flown: of the firmware, or of ours."""

from pathlib import Path

import pytest

from tests.orchestrator.wall import write_wall
from wil_campaign.campaigns.expansion.expansion import ExpansionOptions, load_campaign
from wil_campaign.orchestrator.state.run_setup import RunOrder, RunSetup


@pytest.mark.parametrize(
    ("autopilot", "link", "takes_s"),
    [
        ("px4", "embedded", 2.9),
        ("px4", "udpin://127.0.0.1:14540", 3.2),
        ("ardupilot", "embedded", 1.6),
        ("ardupilot", "udpin://127.0.0.1:14540", 1.3),
    ],
)
def test_a_takeoff_takes_as_long_as_that_of_its_kind(
    tmp_path: Path, autopilot: str, link: str, takes_s: float
) -> None:
    sets = (f"vehicles.twin.autopilot={autopilot}", f"vehicles.twin.link={link}")
    plan = load_campaign(write_wall(tmp_path), ExpansionOptions(sets=sets)).runs[0]
    order = RunOrder(plan=plan, folder=tmp_path, clock="wall")
    assert RunSetup.of(order).liftoff_delays_s == {"twin": takes_s}
    measured = RunOrder(plan=plan, folder=tmp_path, clock="wall", liftoff_delays_s={"twin": 2.2})
    assert RunSetup.of(measured).liftoff_delays_s == {"twin": 2.2}
