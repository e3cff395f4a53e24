"""The cameras that an autonomy perceives, as large as the images that it gets."""

from typing import Any

import pytest

from wil_campaign.campaigns.schema import Mode, VehicleName
from wil_campaign.plugins.outlets.perceived_cameras import perceived_cameras

SENSORS = "    sensors:\n"
DOWN = "      down: {type: camera, rate_hz: 5, width_px: 64, height_px: 48, fov_deg: 69}\n"
CROP = "transform: [{crop: {width_px: 160, height_px: 120, on: both}}]"
RESIZED = "{resize: {to: {width_px: 200, height_px: 150}, on: both}}"
RESIZE = f"transform: [{RESIZED}]"
OWN = f"transform: [{RESIZED}, {{use: 'own.py:step'}}]"


def perceived(files: Any, mode: Mode, vehicle: VehicleName) -> list[tuple[str, int, int, float]]:
    plan = next(run for run in files.load().runs if run.mode == mode)
    return [
        (one.name, one.intrinsics.width_px, one.intrinsics.height_px, one.rate_hz)
        for one in perceived_cameras(plan.setup(), mode, vehicle)
    ]


@pytest.mark.parametrize(
    ("steps", "size"), [(CROP, (160, 120)), (RESIZE, (200, 150)), (OWN, (200, 150))]
)
def test_a_mixture_is_as_large_as_the_recipe_makes_it(
    files: Any, steps: str, size: tuple[int, int]
) -> None:
    (files.folder / "own.py").write_text("def step(work, other):\n    return work\n")
    files.change("    filter:", f"    {steps}\n    filter:", file="recipe.yaml")
    files.change("rate_hz: 15", "rate_hz: 10", file="recipe.yaml")
    assert perceived(files, "wil", "real") == [("camera", *size, 10.0)]
    assert perceived(files, "wil", "twin") == [("camera", *size, 10.0)]
    assert perceived(files, "sim", "twin") == [("camera", 320, 240, 15.0)]


def test_mixed_cameras_come_first_then_those_of_the_vehicle_itself(files: Any) -> None:
    text = files.path.read_text().replace(SENSORS, SENSORS + DOWN)
    files.path.write_text(text)
    files.append("    publish: [real]\n", file="recipe.yaml")
    down = ("down", 64, 48, 5.0)
    camera = ("camera", 320, 240, 15.0)
    assert perceived(files, "wil", "real") == [camera, down]
    assert perceived(files, "wil", "twin") == [down, camera]
