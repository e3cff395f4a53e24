"""What a recipe asks of sensors that they cannot meet: rates and sizes, said with what it asks."""

from typing import Any

import pytest

SIZE = "camera: {type: camera, rate_hz: 15, width_px: 320, height_px: 240, fov_deg: 69}\n"
MERGE = "    merge: {overlay: {priority: [twin, real]}}\n"


def change_twin(files: Any, **values: float) -> None:
    """Give the twin another camera than the real vehicle has."""
    path = files.folder / "campaign.yaml"
    before, _, after = path.read_text().rpartition(SIZE)
    made = {"rate_hz": 15, "width_px": 320, "height_px": 240, "fov_deg": 69} | values
    inner = ", ".join(f"{key}: {value}" for key, value in made.items())
    path.write_text(f"{before}camera: {{type: camera, {inner}}}\n{after}")


def transform(files: Any, steps: str) -> None:
    files.change("    filter:", f"    transform: [{steps}]\n    filter:", file="recipe.yaml")


@pytest.mark.parametrize(
    ("twin", "said"),
    [
        (
            {"width_px": 160, "height_px": 120},
            (
                "overlay of 160 x 120 (twin) over 320 x 240 (real): add a resize step "
                "('camera' of real 320 x 240 and twin 160 x 120)"
            ),
        ),
        ({"fov_deg": 40}, "give both the same field of view, or add a camera_model step"),
    ],
)
def test_images_that_do_not_fit_each_other_are_reported(
    files: Any, twin: dict[str, float], said: str
) -> None:
    change_twin(files, **twin)
    (fault,) = files.faults()
    assert fault.startswith("recipe.yaml:6:")
    assert said in fault


@pytest.mark.parametrize(
    ("steps", "twin"),
    [
        ("{resize: {to: real}}", {"width_px": 160, "height_px": 120}),
        ("{camera_model: {to: real}}", {"width_px": 160, "height_px": 120, "fov_deg": 90}),
        (
            "{crop: {width_px: 320, height_px: 240}}",
            # Twice as wide with the same focal length: its middle is the other's picture.
            {"width_px": 640, "height_px": 480, "fov_deg": 107.91},
        ),
    ],
)
def test_the_check_of_sizes_follows_the_steps_that_change_them(
    files: Any, steps: str, twin: dict[str, float]
) -> None:
    change_twin(files, **twin)
    assert len(files.faults()) == 1
    transform(files, steps)
    files.load()


def test_a_part_that_does_not_lie_in_the_picture_is_reported_at_its_step(files: Any) -> None:
    transform(files, "{crop: {width_px: 640, height_px: 480}}")
    (fault,) = files.faults()
    assert fault.startswith("recipe.yaml:5:18: crop: ")
    assert "('camera' of real 320 x 240 and twin 320 x 240)" in fault


def test_sizes_are_not_checked_after_a_step_of_the_user(files: Any) -> None:
    change_twin(files, width_px=160, height_px=120)
    (files.folder / "own.py").write_text("def step(work, other):\n    return work\n")
    transform(files, "{use: 'own.py:step'}")
    files.load()


def test_a_missing_depth_is_no_mismatch(files: Any) -> None:
    files.change("priority: [twin, real]", "occlusion: by_depth", file="recipe.yaml")
    files.load()


def test_scans_of_other_beams_are_reported(files: Any) -> None:
    for beams in (360, 180):
        path = files.folder / "campaign.yaml"
        lidar = f"lidar: {{type: lidar, rate_hz: 10, beams: {beams}}}\n"
        path.write_text(path.read_text().replace(SIZE, lidar, 1))
    text = "schema: wil/recipe/1\nsensors: {lidar: {type: lidar}}\ncombine:\n  - sensor: lidar\n"
    (files.folder / "recipe.yaml").write_text(text + "    merge: {aggregate: min}\n")
    (fault,) = files.faults()
    assert "beams are" in fault
    assert "add a resample_beams step ('lidar' of real 360 beams and twin 180 beams)" in fault
    transform_line = "    transform: [{resample_beams: real}]\n    merge: {aggregate: min}\n"
    (files.folder / "recipe.yaml").write_text(text + transform_line)
    files.load()


@pytest.mark.parametrize(
    ("recipe", "twin_hz", "said"),
    [
        ("min_rate_hz: 20", 15, "has a rate of 15 Hz, the recipe asks for at least 20 Hz"),
        ("max_skew_ms: 60", 5, "up to 67 ms from its nearest reading; the recipe allows 60 ms"),
        ("max_skew_ms: 70", 5, None),
        ("max_skew_ms: 10", 15, None),
    ],
)
def test_rates_that_the_cameras_do_not_reach_are_reported(
    files: Any, recipe: str, twin_hz: float, said: str | None
) -> None:
    files.append(f"    {recipe}\n", file="recipe.yaml")
    change_twin(files, rate_hz=twin_hz)
    if said is None:
        files.load()
        return
    (fault,) = files.faults()
    assert said in fault


def test_a_least_rate_above_that_of_the_mixture_itself_is_reported(files: Any) -> None:
    files.change("rate_hz: 15", "rate_hz: 10", file="recipe.yaml")
    files.append("    min_rate_hz: 12\n", file="recipe.yaml")
    (fault,) = files.faults()
    assert "'camera' is mixed at 10 Hz at most (its rate_hz)" in fault
    assert "the recipe asks for at least 12" in fault


def test_a_twin_that_is_asked_need_not_come_often(files: Any) -> None:
    files.append("    max_skew_ms: 20\n", file="recipe.yaml")
    change_twin(files, rate_hz=5)
    assert len(files.faults()) == 1
    transform(files, "{register: {pose: real, align: interpolate}}")
    files.load()


def test_blocks_of_sound_may_be_of_any_length(files: Any) -> None:
    for samples in (512, 8192):
        path = files.folder / "campaign.yaml"
        ear = f"ear: {{type: microphone, block_samples: {samples}}}\n"
        path.write_text(path.read_text().replace(SIZE, ear, 1))
    text = "schema: wil/recipe/1\nsensors: {ear: {type: microphone}}\ncombine:\n"
    (files.folder / "recipe.yaml").write_text(text + "  - {sensor: ear, merge: add}\n")
    files.load()
