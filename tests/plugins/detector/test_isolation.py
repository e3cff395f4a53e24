"""Isolation by a detector: what it finds is kept, and a file that is none is told at load."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.recipes.samples import camera, plain
from tests.vehicles.tiny_onnx import noise, tiny_detector
from wil_campaign.foundation.files.documents import BadInput
from wil_campaign.recipes.language.recipe_files import load_recipe_file
from wil_campaign.recipes.pipeline.pipeline import compile_recipe

RECIPE = """\
schema: wil/recipe/1
sensors: {camera: {type: camera}}
combine:
  - sensor: camera
    filter:
      - isolate_detections:
          model: MODEL
          names: [red, green]
          keep: [KEEP]
          input_width_px: 32
          input_height_px: 32
    merge: overlay
"""


def written(folder: Path, model: str = "tiny.onnx", keep: str = "red") -> Path:
    (folder / "tiny.onnx").write_bytes(tiny_detector("v8"))
    (folder / "bad.onnx").write_bytes(noise())
    path = folder / "recipe.yaml"
    path.write_text(RECIPE.replace("MODEL", model).replace("KEEP", keep))
    return path


def test_only_the_kept_part_is_laid_over(tmp_path: Path) -> None:
    (mixer,) = compile_recipe(load_recipe_file(written(tmp_path)), object_ids={})
    image: Any = np.zeros((48, 64, 3), np.uint8)
    image[:24, :32] = (0, 0, 255)
    image[24:, 32:] = (0, 255, 0)
    mixed = mixer.mix(camera(plain(), "real"), camera(image), now_s=1.1).reading
    assert mixed is not None
    # The letterbox adds 8 rows above and below the picture's 48, laid into 32 x 24.
    assert (mixed.image_bgr[:24, :32] == (0, 0, 255)).all()
    assert (mixed.image_bgr[24:] == plain()[24:]).all()


def test_of_a_network_with_masks_the_pixels_of_the_object_are_kept_and_not_its_box(
    tmp_path: Path,
) -> None:
    path = written(tmp_path)
    (tmp_path / "tiny.onnx").write_bytes(tiny_detector("v8", masks=True))
    image: Any = np.full((48, 64, 3), (255, 0, 0), np.uint8)
    image[:16, :20] = (0, 0, 255)
    kept = {}
    for grow_px in (0, 2):
        path.write_text(RECIPE.replace("MODEL", f"tiny.onnx\n          grow_px: {grow_px}"))
        path.write_text(path.read_text().replace("KEEP", "red"))
        (mixer,) = compile_recipe(load_recipe_file(path), object_ids={})
        mixed = mixer.mix(camera(plain(), "real"), camera(image), now_s=1.1).reading
        assert mixed is not None
        kept[grow_px] = (mixed.image_bgr != plain()).any(axis=2)
    assert kept[0][:14, :18].all()
    assert not kept[0][20:, :].any()
    assert not kept[0][:, 26:].any()
    assert kept[2].sum() > kept[0].sum()


@pytest.mark.parametrize(
    ("model", "keep", "said"),
    [
        ("bad.onnx", "red", "'bad.onnx' is not an ONNX network"),
        ("none.onnx", "red", "there is no file 'none.onnx'"),
        ("tiny.onnx", "gren", "did you mean 'green'?"),
    ],
)
def test_a_wrong_detector_is_reported_with_its_place(
    tmp_path: Path, model: str, keep: str, said: str
) -> None:
    with pytest.raises(BadInput) as caught:
        load_recipe_file(written(tmp_path, model, keep))
    (problem,) = caught.value.problems
    assert said in problem.headline
    assert problem.line == (9 if keep == "gren" else 7)
