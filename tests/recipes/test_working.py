"""What recipe steps work on: the shape of a mask for each reading, and a step's error."""

from typing import Any

import numpy as np
import pytest

from tests.recipes.samples import HEIGHT, WIDTH, beam, camera, cloud, depth, fix, scan, sound
from wil_campaign.recipes.working import StepError, element_shape


@pytest.mark.parametrize(
    ("reading", "shape"),
    [
        (camera(), (HEIGHT, WIDTH)),
        (depth(2.0), (HEIGHT, WIDTH)),
        (scan(np.ones(7)), (7,)),
        (cloud(np.ones((5, 3))), (5,)),
        (sound(np.zeros(9)), (9,)),
        (beam(1.0), (1,)),
        (fix(52.0, 13.0), (1,)),
    ],
    ids=lambda value: type(value).__name__,
)
def test_a_mask_has_one_value_for_each_element_and_never_for_a_channel(
    reading: Any, shape: tuple[int, ...]
) -> None:
    assert element_shape(reading) == shape


def test_the_error_of_a_step_names_its_place_first() -> None:
    error = StepError(file="r.yaml", line=7, step="crop", frame=3, detail="KeyError: 'x'")
    assert str(error) == "r.yaml:7: step crop, frame 3: KeyError: 'x'"
