"""Which vehicles a campaign flies: those of its planned runs, and of no other mode."""

from pathlib import Path
from typing import Any

import pytest

from tests.orchestrator.hover import write_hover
from wil_campaign.campaigns.expansion.expansion import Campaign, ExpansionOptions, load_campaign
from wil_campaign.orchestrator.campaign.flight_options import ClearedCampaign, FlightOptions
from wil_campaign.orchestrator.campaign.reevaluation import _as_settled
from wil_campaign.orchestrator.campaign.resuming.attached_vehicles import (
    attached_vehicles,
    flown_vehicles,
    vehicles_with_open_poses,
)
from wil_campaign.orchestrator.cli.arming_consent import clear_for_flight
from wil_campaign.orchestrator.cli.clock_choice import campaign_clock_for

GATE = Path(__file__).parents[4] / "campaigns" / "gate.yaml"
COMPOSED = """\
schema: wil/campaign/1
campaign: both
campaigns: {%s}
"""
ATTACHED = "{link: 'udpin://127.0.0.1:14540', autopilot: px4, pose_source: mavlink}"


def composed(folder: Path, parts: str, **options: Any) -> Campaign:
    path = folder / "both.yaml"
    path.write_text(COMPOSED % parts)
    return load_campaign(path, ExpansionOptions(loads_code=False, **options))


@pytest.fixture
def hover(tmp_path: Path) -> Path:
    """A campaign of the twin alone, in mode sim."""
    return write_hover(tmp_path)


def test_a_part_without_a_real_vehicle_is_flown_beside_one_with_it(hover: Path) -> None:
    whole = composed(hover.parent, f"smoke: hover.yaml, gate: {GATE}")
    assert whole.modes == ("sim", "wil")
    assert [flown_vehicle.name for flown_vehicle in flown_vehicles(whole)] == ["twin", "real"]
    assert campaign_clock_for(whole, None) == "virtual"
    cleared = clear_for_flight(whole, FlightOptions(jobs=1))
    assert cleared == ClearedCampaign("virtual", 1, "embedded")


def gate_at(pose_source: str) -> Campaign:
    link = "vehicles.real.link=udpin://127.0.0.1:14540"
    given = (link, f"vehicles.real.pose_source={pose_source}")
    return load_campaign(GATE, ExpansionOptions(modes=("wil",), sets=given, loads_code=False))


def test_a_pose_source_is_open_where_a_campaign_gives_none(hover: Path) -> None:
    assert vehicles_with_open_poses(gate_at("null")) == ("real",)
    assert vehicles_with_open_poses(gate_at("mavlink")) == ()
    whole = composed(hover.parent, f"gate: {GATE}", sets=gate_at("null").options.sets)
    assert vehicles_with_open_poses(whole) == ()


def test_flights_are_judged_again_by_the_pose_source_that_they_were_judged_by() -> None:
    truth = "vehicles.real.pose_source=simulator"
    flown = {"options": {"set": ["goal.altitude_m=1", truth]}}
    judged = _as_settled(gate_at("null"), flown)
    assert {setup.vehicles["real"].pose_source for setup in judged.setups.values()} == {"simulator"}
    assert judged.options.sets[-1] == truth
    for campaign, manifest in (
        (gate_at("mavlink"), flown),
        (gate_at("null"), {"options": {"set": ["goal.altitude_m=1"]}}),
        (gate_at("null"), {"options": None}),
    ):
        assert _as_settled(campaign, manifest) is campaign


def test_a_pace_is_asked_of_the_planned_runs_alone(hover: Path) -> None:
    parts = f"smoke: hover.yaml, gate: {GATE}"
    whole = composed(hover.parent, parts, sets=("clock.speed=4",))
    assert campaign_clock_for(whole, "scaled") == "scaled"


def test_a_real_vehicle_that_no_run_flies_needs_no_consent(hover: Path) -> None:
    """One part flies a real vehicle, another has one attached and flies mode sim alone."""
    other = hover.with_name("other.yaml")
    vehicles = "vehicles: {twin: {link: embedded, autopilot: px4}"
    text = hover.read_text()
    assert vehicles in text
    other.write_text(text.replace(vehicles, f"{vehicles}, real: {ATTACHED}"))
    whole = composed(hover.parent, f"other: other.yaml, gate: {GATE}")
    assert attached_vehicles(whole) == ()
    assert clear_for_flight(whole, FlightOptions(jobs=1)).real_kind == "embedded"
