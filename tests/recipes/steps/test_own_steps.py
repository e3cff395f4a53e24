"""The user's own steps: checked at load, and an exception names file, line, step and frame."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.recipes.samples import beam, camera, plain
from wil_campaign.foundation.files.documents import (
    BadInput,
    load_document,
    parse_document,
    parse_option_value,
)
from wil_campaign.recipes.language.recipe_document import load_recipe
from wil_campaign.recipes.language.recipe_files import load_recipe_file
from wil_campaign.recipes.pipeline.pipeline import Mixer, compile_recipe
from wil_campaign.recipes.working import StepError

STEPS = """
import asyncio
from dataclasses import replace
import numpy as np
from wil_campaign.recipes.working import CannotMixError, Masked


def desaturate(work, other, *, amount=1.0):
    image = work.reading.image_bgr.astype(float)
    grey = image.mean(axis=2, keepdims=True)
    made = np.rint(image + (grey - image) * amount).astype(np.uint8)
    return replace(work.reading, image_bgr=made)


def keep_left(work, other):
    mask = np.zeros(work.reading.image_bgr.shape[:2], np.uint8)
    mask[:, :10] = 255
    return Masked(work.reading, mask)


BUFFER = np.zeros((1, 1), np.uint8)


def keep_own_side(work, other):
    global BUFFER
    if BUFFER.shape != work.reading.image_bgr.shape[:2]:
        BUFFER = np.zeros(work.reading.image_bgr.shape[:2], np.uint8)
    BUFFER[:] = 0
    BUFFER[:, : 5 if work.reading.source == "real" else 10] = 255
    return Masked(work.reading, BUFFER)


def widths(sides):
    real = sides["real"].reading
    image = np.zeros_like(real.image_bgr)
    image[0, 0, :2] = [np.count_nonzero(sides[name].mask[0]) for name in ("real", "twin")]
    return replace(real, image_bgr=image)


class Counter:
    def __init__(self, start):
        self.count = start

    def __call__(self, work, other):
        self.count += 1
        image = np.full_like(work.reading.image_bgr, self.count)
        return replace(work.reading, image_bgr=image)


def brighter(sides, *, by):
    real = sides["real"].reading
    return replace(real, image_bgr=real.image_bgr + np.uint8(by))


def broken(work, other):
    if other is not None and work.reading.seq == 5:
        return 1 / 0
    return work


def refuses(work, other):
    raise CannotMixError("mismatch", "not today")


def nothing(work, other):
    return None


def wrong_size(work, other):
    return replace(work.reading, image_bgr=work.reading.image_bgr[:3])


def writes(work, other):
    work.reading.image_bgr[:] = 7
    if work.mask is not None:
        work.mask[:] = 255
    if other is not None:
        other.reading.image_bgr[:] = 9
    return work


def merges_and_writes(sides):
    for work in sides.values():
        work.reading.image_bgr[:] = 8
    return sides["real"].reading


class Reuses:
    def __init__(self):
        self.image = None

    def __call__(self, sides):
        real = sides["real"].reading
        if self.image is None:
            self.image = np.zeros_like(real.image_bgr)
        self.image += 1
        return replace(real, image_bgr=self.image)


def halved(sides):
    ranges = [work.reading.range_m for work in sides.values()]
    return replace(sides["real"].reading, range_m=np.float32(min(ranges) / 2), seq=np.int64(4))


def lighter(work, other):
    from vehicles import BY

    return replace(work.reading, image_bgr=work.reading.image_bgr + np.uint8(BY))


def bad_mask(work, other):
    return Masked(work.reading, np.zeros(3, np.uint8))


def where_red(work, other):
    return Masked(work.reading, work.reading.image_bgr[:, :, 2] > 50)


def float_mask(work, other):
    return Masked(work.reading, np.ones(work.reading.image_bgr.shape[:2]))


def list_mask(work, other):
    return Masked(work.reading, [[255]])


def stacks(work, other):
    return np.stack([work.reading.image_bgr, np.zeros(3)])


def leaves(work, other):
    raise SystemExit(0)


def cancels(work, other):
    raise asyncio.CancelledError


def cannot_say(work, other):
    class Mute(Exception):
        def __str__(self):
            raise ValueError

    raise Mute


def unknown_reason(work, other):
    raise CannotMixError("", "why")


NUMBER = 3
"""
HEAD = "schema: wil/recipe/1\nsensors: {camera: {type: camera}}\ncombine:\n  - sensor: camera\n"


def mixer(folder: Path, *lines: str, merge: str = "overlay") -> Mixer:
    (one,) = compile_recipe(load_recipe_file(written(folder, *lines, merge=merge)), object_ids={})
    return one


def written(folder: Path, *lines: str, merge: str = "overlay") -> Path:
    (folder / "my_steps.py").write_text(STEPS)
    path = folder / "own.yaml"
    body = "".join(f"    {line}\n" for line in lines)
    path.write_text(f"{HEAD}{body}    merge: {merge}\n")
    return path


def mixed(one: Mixer, seq: int = 3) -> Any:
    twin = camera(plain((10, 20, 60)), seq=seq)
    return one.mix(camera(plain(), "real"), twin, now_s=1.1)


def test_functions_work_in_every_stage(tmp_path: Path) -> None:
    one = mixer(
        tmp_path,
        "transform: [{use: 'my_steps.py:desaturate', with: {amount: 1.0}}]",
        "filter: [{use: 'my_steps.py:keep_left'}]",
    )
    image = mixed(one).reading.image_bgr
    assert (image[:, :10] == 30).all()
    assert (image[:, 10:] == plain()[:, 10:]).all()
    by = mixer(tmp_path, merge="{use: 'my_steps.py:brighter', with: {by: 5}}")
    assert (mixed(by).reading.image_bgr == plain() + 5).all()


def test_a_step_imports_what_stands_beside_it(tmp_path: Path) -> None:
    (tmp_path / "vehicles.py").write_text("BY = 5\n")
    one = mixer(tmp_path, "filter: [{use: 'my_steps.py:lighter'}]")
    assert (mixed(one).reading.image_bgr == plain((15, 25, 65))).all()


def test_a_class_is_made_once_for_each_side(tmp_path: Path) -> None:
    one = mixer(tmp_path, "transform: [{use: 'my_steps.py:Counter', with: {start: 7}, on: both}]")
    assert [int(mixed(one).reading.image_bgr[0, 0, 0]) for _ in range(3)] == [8, 9, 10]


@pytest.mark.parametrize("on", ["real", "twin"])
def test_a_step_that_writes_into_what_it_is_given_changes_no_reading(
    tmp_path: Path, on: str
) -> None:
    writes = f"{{use: 'my_steps.py:writes', on: {on}}}"
    one = mixer(tmp_path, "filter:", "  - {use: 'my_steps.py:keep_left'}", f"  - {writes}")
    real, twin = camera(plain(), "real"), camera(plain((10, 20, 60)))
    made: Any = one.mix(real, twin, now_s=1.1).reading
    assert (real.image_bgr == plain()).all()
    assert (twin.image_bgr == plain((10, 20, 60))).all()
    assert (made.image_bgr[:, :10] == (7 if on == "twin" else (10, 20, 60))).all()


def test_a_merge_that_writes_into_what_it_is_given_changes_no_reading(tmp_path: Path) -> None:
    one = mixer(tmp_path, merge="{use: 'my_steps.py:merges_and_writes'}")
    real, twin = camera(plain(), "real"), camera(plain((10, 20, 60)))
    made: Any = one.mix(real, twin, now_s=1.1).reading
    assert (made.image_bgr == 8).all()
    assert (real.image_bgr == plain()).all()
    assert (twin.image_bgr == plain((10, 20, 60))).all()


def test_readings_that_may_not_be_written_are_given_as_copies_too(tmp_path: Path) -> None:
    """As in a replay: its readings are of the recording's bytes."""
    one = mixer(tmp_path, merge="{use: 'my_steps.py:merges_and_writes'}")
    image = plain()
    image.flags.writeable = False
    made: Any = one.mix(camera(image, "real"), camera(image), now_s=1.1).reading
    assert (made.image_bgr == 8).all()


def test_a_step_that_reuses_its_buffer_leaves_earlier_mixtures_as_they_were(
    tmp_path: Path,
) -> None:
    one = mixer(tmp_path, merge="{use: 'my_steps.py:Reuses'}")
    made = [mixed(one).reading.image_bgr for _ in range(3)]
    assert [int(image[0, 0, 0]) for image in made] == [1, 2, 3]


def test_a_step_that_reuses_its_mask_leaves_the_other_side_s_as_it_was(tmp_path: Path) -> None:
    one = mixer(
        tmp_path,
        "filter: [{use: 'my_steps.py:keep_own_side', on: both}]",
        merge="{use: 'my_steps.py:widths'}",
    )
    assert mixed(one).reading.image_bgr[0, 0, :2].tolist() == [5, 10]


def test_numbers_of_numpy_are_recorded_as_numbers(tmp_path: Path) -> None:
    (tmp_path / "my_steps.py").write_text(STEPS)
    path = tmp_path / "own.yaml"
    path.write_text(
        "schema: wil/recipe/1\nsensors: {range: {type: rangefinder}}\n"
        "combine: [{sensor: range, merge: {use: 'my_steps.py:halved'}}]\n"
    )
    (one,) = compile_recipe(load_recipe_file(path), object_ids={})
    made: Any = one.mix(beam(3.0, "real"), beam(2.0), now_s=1.1).reading
    assert made.range_m == 1.0
    assert type(made.range_m) is float


def test_an_exception_is_reported_in_full(tmp_path: Path) -> None:
    one = mixer(
        tmp_path, "filter:", "  - {use: 'my_steps.py:keep_left'}", "  - {use: 'my_steps.py:broken'}"
    )
    assert mixed(one).reading is not None
    with pytest.raises(StepError) as caught:
        mixed(one, seq=5)
    error = caught.value
    assert (error.line, error.step, error.frame) == (7, "my_steps.py:broken", 1)
    assert error.file.endswith("own.yaml")
    line = STEPS.splitlines().index("        return 1 / 0") + 1
    assert f"ZeroDivisionError: division by zero (my_steps.py line {line})" in error.detail
    assert isinstance(error.__cause__, ZeroDivisionError)


def test_the_line_is_of_the_step_where_a_library_of_python_raised(tmp_path: Path) -> None:
    with pytest.raises(StepError) as caught:
        mixed(mixer(tmp_path, "transform: [{use: 'my_steps.py:stacks'}]"))
    line = next(
        number for number, text in enumerate(STEPS.splitlines(), 1) if "return np.stack" in text
    )
    assert caught.value.detail.endswith(f"(my_steps.py line {line})")


def test_a_mask_of_bools_keeps_what_is_true(tmp_path: Path) -> None:
    """OpenCV ended the process at such a mask."""
    one = mixer(tmp_path, "filter: [{use: 'my_steps.py:where_red'}]")
    image = plain((10, 20, 60))
    image[:, 10:, 2] = 40
    made: Any = one.mix(camera(plain(), "real"), camera(image), now_s=1.1).reading
    assert (made.image_bgr[:, :10] == (10, 20, 60)).all()
    assert (made.image_bgr[:, 10:] == plain()[:, 10:]).all()


@pytest.mark.parametrize(("name", "said"), [("case.yaml", "case.yaml:2: "), ("--set", "--set: ")])
def test_an_exception_names_the_place_of_a_step_that_a_campaign_overrides(
    tmp_path: Path, name: str, said: str
) -> None:
    recipe = load_document(written(tmp_path, "filter: [{use: 'my_steps.py:keep_left'}]"))
    step = "[{use: 'my_steps.py:broken'}]"
    if name == "--set":
        entry = parse_option_value(step, name=name)
    else:
        case = parse_document(f"\nfilter: {step}\n".encode(), name=name)
        entry = case.entry(("filter",))
    (one,) = compile_recipe(load_recipe(recipe.override("combine.0.filter", entry)), object_ids={})
    with pytest.raises(StepError) as caught:
        mixed(one, seq=5)
    assert str(caught.value).startswith(f"{said}step my_steps.py:broken, frame 0: ")


def test_a_step_may_refuse_a_frame(tmp_path: Path) -> None:
    made = mixed(mixer(tmp_path, "transform: [{use: 'my_steps.py:refuses'}]"))
    assert (made.provenance.dropped, made.provenance.detail) == ("mismatch", "not today")
    assert np.array_equal(made.reading.image_bgr, plain())


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("nothing", "returned NoneType, not a reading"),
        ("wrong_size", r"returned a bad reading: image is \(3, 64, 3\)"),
        ("bad_mask", r"returned a mask of \(3,\), not \(48, 64\)"),
        ("float_mask", "returned a mask of float64, not of bool, or uint8 with 255 for kept"),
        ("list_mask", "returned a mask of list, not of bool"),
        ("leaves", r"SystemExit: 0 \(my_steps.py line \d+\)"),
        ("cancels", r"CancelledError: *\(my_steps.py line \d+\)"),
        ("cannot_say", r"Mute: \(its message cannot be shown\) \(my_steps.py line \d+\)"),
        (
            "unknown_reason",
            r"ValueError: CannotMixError has no reason ''.* \(my_steps.py line \d+\)",
        ),
    ],
)
def test_a_wrong_result_is_an_error_and_no_wrong_picture(
    tmp_path: Path, name: str, said: str
) -> None:
    with pytest.raises(StepError, match=said):
        mixed(mixer(tmp_path, f"transform: [{{use: 'my_steps.py:{name}'}}]"))


@pytest.mark.parametrize(
    ("step", "said"),
    [
        ("{use: 'my_steps.py:desaturat'}", "did you mean 'desaturate'?"),
        ("{use: 'my_step.py:desaturate'}", "no file 'my_step.py' beside the recipe"),
        ("{use: 'my_steps.py:NUMBER'}", "neither a function nor a class"),
        ("{use: 'my_steps.py:desaturate', with: {amont: 1}}", "unexpected keyword argument"),
        ("{use: 'my_steps.py:Counter'}", "missing a required argument: 'start'"),
        ("{use: 'my_steps.py:brighter', with: {by: 1}}", "cannot be called with (work, other)"),
        ("{use: 'desaturate'}", "is not of the form file.py:Name"),
        ("{use: 'my_steps.py:desaturate', wiht: {}}", "did you mean 'with'?"),
        ("{use: 'bad.py:f'}", "line 2: ZeroDivisionError"),
    ],
)
def test_a_step_that_cannot_be_used_is_reported_at_load(
    tmp_path: Path, step: str, said: str
) -> None:
    (tmp_path / "bad.py").write_text("x = 1\n1 / 0\n")
    with pytest.raises(BadInput) as caught:
        load_recipe_file(written(tmp_path, f"transform: [{step}]"))
    (problem,) = caught.value.problems
    assert said in problem.headline
    assert problem.line == 5
