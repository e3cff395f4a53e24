"""The registry lists every step once, with what it is for."""

import pytest

from recipes import registry
from recipes.registry import (
    STAGES,
    Context,
    DuplicateStepError,
    StepParameters,
    step,
    steps,
)
from recipes.working import Masked, Operator
from vehicles.readings import SENSOR_TYPES


def test_the_listing_is_ordered_and_says_what_each_step_does() -> None:
    places = [(STAGES.index(kind.stage), kind.name) for kind in steps()]
    assert places == sorted(places)
    assert len(set(places)) == len(places)
    for kind in steps():
        assert kind.summary.endswith("."), kind.name
        assert set(kind.sensors) <= set(SENSOR_TYPES), kind.name
        assert set(kind.gives) <= set(kind.sensors)


@pytest.mark.parametrize("sensor", SENSOR_TYPES)
def test_every_sensor_can_be_transformed_filtered_and_merged(sensor: str) -> None:
    for stage in STAGES:
        assert any(kind.stage == stage and sensor in kind.sensors for kind in steps())


def test_a_second_step_of_a_name_is_refused() -> None:
    def again(parameters: StepParameters, context: Context) -> Operator:
        return lambda work, _other: Masked(work.reading)

    decorate = step("resize", stage="transform", sensors=("camera",), parameters=StepParameters)
    with pytest.raises(DuplicateStepError, match="'resize'"):
        decorate(again)
    found = registry.find("resize")
    assert found is not None
    assert found.stage == "transform"
