"""Recipes are read whole, and every fault of one is told at its place."""

from pathlib import Path

import pytest

from wil_campaign.foundation.files.documents import BadInput, load_document, parse_document
from wil_campaign.recipes.language.recipe_document import MAX_SKEW_MS, load_recipe
from wil_campaign.recipes.model.recipe import Recipe

ROOT = Path(__file__).parents[3]

HEAD = "schema: wil/recipe/1\nsensors: {camera: {type: camera, rate_hz: 15}}\n"


def read(body: str, head: str = HEAD) -> Recipe:
    return load_recipe(parse_document((head + body).encode(), name="r.yaml"))


def faults(body: str, head: str = HEAD) -> list[str]:
    with pytest.raises(BadInput) as caught:
        read(body, head)
    return [problem.headline for problem in caught.value.problems]


def combine(**parts: str) -> str:
    given = {"sensor": "camera", "merge": "{overlay: {priority: [twin, real]}}"} | parts
    inner = ", ".join(f"{key}: {value}" for key, value in given.items() if value)
    return f"combine: [{{{inner}}}]\n"


def test_the_recipe_of_the_gate() -> None:
    recipe = load_recipe(load_document(ROOT / "recipes" / "gate.yaml"))
    (one,) = recipe.combinations
    assert [step.kind.name for step in one.steps] == ["resize", "register", "isolate_color"]
    assert one.merge.kind.name == "overlay"
    assert one.publish == ("real", "twin")
    assert one.max_skew_s == pytest.approx(0.06)
    assert (one.sensor.name, one.sensor.kind, one.sensor.rate_hz) == ("camera", "camera", 15)


def test_a_step_may_be_a_name_or_take_one_plain_value() -> None:
    transform, chosen = "[register, {resize: real}]", "[{isolate_color: orange}]"
    (one,) = read(combine(transform=transform, filter=chosen)).combinations
    assert [step.kind.name for step in one.steps] == ["register", "resize", "isolate_color"]


def test_the_skew_is_bounded_when_a_recipe_says_nothing() -> None:
    (one,) = read(combine()).combinations
    assert one.max_skew_s == pytest.approx(MAX_SKEW_MS / 1000)


def test_two_mixtures_of_a_sensor_for_different_vehicles() -> None:
    body = (
        "combine:\n"
        "  - {sensor: camera, merge: {overlay: [twin, real]}, publish: [real]}\n"
        "  - {sensor: camera, merge: {overlay: [real, twin]}, publish: [twin]}\n"
    )
    assert [combination.publish for combination in read(body).combinations] == [
        ("real",),
        ("twin",),
    ]


def test_all_faults_at_once_in_order_of_their_places() -> None:
    body = combine(
        transform="[{regster: {pose: real}}, {resize: {too: real}}]",
        filter="[{isolate_color: {name: ornge}}]",
        merge="{overlay: {priority: [twin]}}",
        max_skew_ms="-1",
    )
    found = faults(body, HEAD.replace("type: camera", "type: camra"))
    said = ["'camera'", "at least 2", "'register'", "'to'", "'orange'", "greater than 0"]
    assert all(word in line for word, line in zip(said, found, strict=True)), found
    assert [int(line.split(":")[1]) for line in found] == [2, 3, 3, 3, 3, 3]


@pytest.mark.parametrize(
    ("parts", "said"),
    [
        ({"transform": "[{regster: {}}]"}, "unknown step 'regster'; did you mean 'register'?"),
        ({"transform": "[{zzz: {}}]"}, "unknown step 'zzz' (known for transform: "),
        ({"transform": "[{isolate_color: orange}]"}, "belongs under 'filter', not 'transform'"),
        ({"filter": "[{isolate_color: {}}]"}, "needs a colour: 'name' or 'ranges'"),
        ({"filter": "[isolate_color]"}, "step 'isolate_color' needs parameters"),
        ({"filter": "[{isolate_color: ornge}]"}, "did you mean 'orange'?"),
        ({"filter": "[{isolate_objects: []}]"}, "must have at least 1 entries"),
        ({"filter": "[{isolate_objects: {names: [gate], on: real}}]"}, "only the twin's images"),
        ({"transform": "[{resize: {to: twin}}]"}, "twin would get its own size"),
        ({"transform": "[{resize: {to: {width_px: 0, height_px: 5}}}]"}, "must be at least 1"),
        ({"transform": "[{register: {pose: reel}}]"}, "did you mean 'real'?"),
        ({"transform": "[register, register]"}, "a second 'register'"),
        ({"transform": "[{a: 1, b: 2}]"}, "a step is a name, or one mapping"),
        ({"transform": "resize"}, "must be a list"),
        ({"merge": "{overlay: {priority: [real, real]}}"}, "names a side twice"),
        ({"merge": "{overlai: [twin, real]}"}, "did you mean 'overlay'?"),
        ({"merge": ""}, "missing key 'merge'"),
        ({"merge": "null"}, "needs a step, like overlay"),
        ({"filter": "[{isolate_depth: {max_m: 1.0e+308}}]"}, "must be at most 1e+09"),
        ({"sensor": "camera2"}, "no sensor 'camera2' is declared"),
        ({"publish": "[]"}, "must have at least 1 entries"),
        ({"publish": "[real, real]"}, "names a side twice"),
        ({"max_skew_ms": "soon"}, "must be a number"),
        ({"max_skew_s": "1"}, "did you mean 'max_skew_ms'?"),
    ],
)
def test_a_fault_and_its_message(parts: dict[str, str], said: str) -> None:
    found = faults(combine(**parts))
    assert len(found) == 1
    assert said in found[0]


def test_ranges_of_a_colour_are_checked() -> None:
    ranges = "[{hue_deg: [10, 400]}, {saturation: [0.9, 0.1]}, {value: [0.5]}]"
    found = faults(combine(filter=f"[{{isolate_color: {{ranges: {ranges}}}}}]"))
    assert len(found) == 3
    assert "at most 360" in found[0]
    assert "wrong order" in found[1]
    assert "at least 2 entries" in found[2]


def test_one_vehicle_cannot_get_two_mixtures_of_a_sensor() -> None:
    one = "{sensor: camera, merge: {overlay: [twin, real]}}"
    found = faults(f"combine:\n  - {one}\n  - {one}\n")
    assert len(found) == 2
    assert "'real' already receives camera from combination 1" in found[0]


def test_the_objects_that_a_mixture_has_to_show_are_known_to_the_world() -> None:
    recipe = read(combine(shows="[gate, gaet]"))
    assert recipe.combinations[0].shows == ("gate", "gaet")
    (problem,) = recipe.unknown_objects(frozenset({"gate", "cage"}))
    assert problem.headline.startswith("r.yaml:3:")
    assert "no object 'gaet' in the world" in problem.headline
    assert read(combine()).combinations[0].shows is None


def test_unknown_objects_are_reported_with_their_places() -> None:
    for filters in ("[{isolate_objects: [gate, gatf]}]", "[{isolate_objects: {names: [gatf]}}]"):
        recipe = read(combine(filter=filters))
        (problem,) = recipe.unknown_objects(frozenset({"gate", "cage"}))
        assert problem.suggestion == "gate"
        shown = problem.source_line[problem.column - 1 :]
        assert shown.startswith("gatf")
    assert not read(combine(filter="[{isolate_objects: [gate]}]")).unknown_objects(
        frozenset({"gate"})
    )


def test_an_empty_recipe_names_what_is_missing() -> None:
    found = faults("combine: []\n", "schema: wil/recipe/1\nsensors: {}\n")
    assert len(found) == 2


@pytest.mark.parametrize(
    ("twin", "transform", "said"),
    [
        ("depth", "[{resize: real}, to_points]", "step 'resize' is to be like real"),
        ("depth", "[{camera_model: real}, to_points]", "step 'camera_model' is to be like real"),
        (
            "lidar",
            "[{resample_beams: real}, to_points]",
            "step 'resample_beams' is to be like real",
        ),
    ],
)
def test_a_step_is_not_like_a_reading_that_has_no_such_thing(
    twin: str, transform: str, said: str
) -> None:
    """A cloud has no size and no beams: the flight came to ERROR by an AttributeError."""
    head = f"schema: wil/recipe/1\nsensors: {{l: {{type: lidar_points, twin_type: {twin}}}}}\n"
    body = combine(sensor="l", transform=transform, merge="concatenate")
    (fault,) = faults(body, head)
    assert f"{said}, which is a lidar_points there" in fault
    read(body.replace(transform, "[to_points]"), head)
