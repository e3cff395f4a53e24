"""Objects are isolated by their ids."""

import numpy as np

from tests.recipes.samples import (
    HEIGHT,
    WIDTH,
    build,
    cloud,
    depth,
    scan,
)
from wil_campaign.recipes.model.registry import StepContext
from wil_campaign.recipes.working import Masked


def test_objects_of_lidars_and_depth_are_kept_by_their_ids() -> None:
    choose = build("isolate_objects", StepContext({"gate": 7}), names=["gate"])
    ids = np.array([0, 7, 3, 7], np.uint8)
    assert choose(Masked(scan(np.ones(4), object_ids=ids)), None).mask.tolist() == [0, 255, 0, 255]
    points = cloud(np.ones((4, 3)), object_ids=ids)
    assert choose(Masked(points), None).mask.tolist() == [0, 255, 0, 255]
    seen = depth(1.0, object_ids=np.full((HEIGHT, WIDTH), 7, np.uint8))
    assert (choose(Masked(seen), None).mask == 255).all()
