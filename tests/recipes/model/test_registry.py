"""The registry lists every step once, with what it is for."""

import pytest

from wil_campaign.recipes.model.registry import STAGES, registered_steps
from wil_campaign.vehicles.readings import sensor_names


def test_the_listing_is_ordered_and_says_what_each_step_does() -> None:
    places = [(STAGES.index(kind.stage), kind.name) for kind in registered_steps()]
    assert places == sorted(places)
    assert len(set(places)) == len(places)
    for kind in registered_steps():
        assert kind.summary.endswith("."), kind.name
        assert set(kind.sensors) <= set(sensor_names()), kind.name
        assert set(kind.gives) <= set(kind.sensors)


@pytest.mark.parametrize("sensor", sensor_names())
def test_every_sensor_can_be_transformed_filtered_and_merged(sensor: str) -> None:
    for stage in STAGES:
        assert any(kind.stage == stage and sensor in kind.sensors for kind in registered_steps())
