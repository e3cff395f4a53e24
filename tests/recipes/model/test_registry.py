"""The registry lists every step once, with what it is for."""

import pytest

from wil_campaign.recipes.language.step_docs import describe_step
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


def test_every_step_is_described_with_its_parameters() -> None:
    docs = {(doc.name, doc.stage): doc for doc in map(describe_step, registered_steps())}
    resize = docs["resize", "transform"]
    assert resize.sensors == ("camera", "depth")
    assert "(h, w, 3) uint8" in resize.details
    on, to, aspect = resize.parameters
    assert (aspect.takes, aspect.default) == ("fit | crop | pad", "fit")
    assert (on.name, on.takes, on.default, on.needed) == (
        "on",
        "real | twin | both",
        "twin",
        False,
    )
    assert (to.takes, to.needed) == ("real | twin or {width_px, height_px}", True)
    assert docs["geodetic", "transform"].gives == "gps"
    assert docs["use", "filter"].parameters[-1].name == "with"
    overlay = {parameter.name: parameter for parameter in docs["overlay", "merge"].parameters}
    assert overlay["priority"].default == "[twin, real]"
    for doc in docs.values():
        assert doc.summary.endswith((".", ":"))
        assert doc.notes
