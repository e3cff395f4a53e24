"""ArduPilot as an autopilot of a plugin: found by name and heartbeat, and offered by the schema."""

import pytest
from pydantic import ValidationError
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.campaigns.schema.vehicles import VehiclePart
from wil_campaign.vehicles.autopilots.registry import (
    autopilot_named,
    autopilot_of,
    autopilot_strategies,
)
from wil_campaign.vehicles.embedded.emulations import emulations

NAMES = ["px4", "ardupilot"]


def test_it_is_found_by_its_name_and_by_its_heartbeat() -> None:
    found = autopilot_of(mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA)
    assert found is autopilot_named("ardupilot")
    assert [*autopilot_strategies()] == [*emulations()] == NAMES
    with pytest.raises(ValueError, match=r"there is no autopilot 'beta' \(px4, ardupilot\)"):
        autopilot_named("beta")


def test_campaigns_may_name_it_and_launch_it() -> None:
    schema = VehiclePart.model_json_schema()
    assert schema["properties"]["autopilot"]["enum"] == NAMES
    (launch,) = (one for one in schema["properties"]["link"]["anyOf"] if "discriminator" in one)
    assert [*launch["discriminator"]["mapping"]] == ["ardupilot", "px4"]
    link = {"launch": "ardupilot", "binary": "arducopter"}
    part = VehiclePart.model_validate({"autopilot": "ardupilot", "link": link})
    assert not isinstance(part.link, str)
    assert part.link.launch == "ardupilot"
    with pytest.raises(ValidationError, match="the link launches ardupilot"):
        VehiclePart.model_validate({"autopilot": "px4", "link": link})
