"""The registry lists every step once, with what it is for."""

import pytest

from recipes import registry
from recipes.registry import Context, DuplicateStepError, StepParameters, step, steps
from recipes.working import Masked, Operator


def test_the_listing_is_ordered_and_says_what_each_step_does() -> None:
    names = [(kind.stage, kind.name) for kind in steps()]
    assert names == [
        ("transform", "register"),
        ("transform", "resize"),
        ("filter", "isolate_color"),
        ("filter", "isolate_objects"),
        ("merge", "overlay"),
    ]
    for kind in steps():
        assert kind.summary.endswith(".")
        assert "camera" in kind.sensors


def test_a_second_step_of_a_name_is_refused() -> None:
    def again(parameters: StepParameters, context: Context) -> Operator:
        return lambda work, _other: Masked(work.reading)

    decorate = step("resize", stage="transform", sensors=("camera",), parameters=StepParameters)
    with pytest.raises(DuplicateStepError, match="'resize'"):
        decorate(again)
    found = registry.find("resize")
    assert found is not None
    assert found.stage == "transform"
