"""The paper's XML gives the pipeline of its YAML twin, and its faults have places."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.recipes.samples import camera, plain
from wil_campaign.foundation.files.documents import BadInput
from wil_campaign.plugins.paper_xml.paper_xml import parse_paper_xml
from wil_campaign.recipes.language.recipe_document import load_recipe
from wil_campaign.recipes.language.recipe_files import load_recipe_document, load_recipe_file
from wil_campaign.recipes.model.recipe import Recipe
from wil_campaign.recipes.pipeline.pipeline import compile_recipe

LISTING = """\
<recipe_file>
  <AS_sensors>
    <Camera id="camera1"/>
    <Camera id="camera2"/>
    <Lidar id="lidar1"/>
  </AS_sensors>
  <combine id="camera1">
    <transform> camera.transform.py </transform>
    <filter> color_isolation.py </filter>
    <merge> prioritize_overlay.py </merge>
  </combine>
  <combine id="lidar1">
    <merge by="min">aggregate.py</merge>
  </combine>
</recipe_file>
"""
LISTING_YAML = """\
schema: wil/recipe/1
sensors: {camera1: {type: camera}, camera2: {type: camera}, lidar1: {type: lidar}}
combine:
  - sensor: camera1
    transform: [{resize: {to: real}}]
    filter: [{isolate_color: {name: orange}}]
    merge: {overlay: {priority: [twin, real]}}
  - {sensor: lidar1, merge: {aggregate: {by: min}}}
"""
RICH = """\
<recipe_file description="two of them">
  <AS_sensors><Camera id="c" rate_hz="15"/><GPS id="g" twin_type="pose"/></AS_sensors>
  <combine id="c" publish="[real]" max_skew_ms="60" max_latency_ms="200" publish_raw="true">
    <transform>register.py</transform>
    <transform to="real">resize.py</transform>
    <filter on="twin" left_px="3" width_px="4">mine.py</filter>
    <filter box="{left: 0.5}">isolate_region.py</filter>
    <merge occlusion="by_depth">overlay.py</merge>
  </combine>
  <combine id="g">
    <transform latitude_deg="47.0" longitude_deg="8.0">geodetic.py</transform>
    <merge source="twin" when="{of: real, what: fix_type, below: 3}">replace.py</merge>
  </combine>
</recipe_file>
"""
RICH_YAML = """\
schema: wil/recipe/1
description: two of them
sensors: {c: {type: camera, rate_hz: 15}, g: {type: gps, twin_type: pose}}
combine:
  - sensor: c
    transform: [register, {resize: {to: real}}]
    filter:
      - {use: "mine.py:filter", on: twin, with: {left_px: 3, width_px: 4}}
      - isolate_region: {box: {left: 0.5}}
    merge: {overlay: {occlusion: by_depth}}
    publish: [real]
    max_skew_ms: 60
    max_latency_ms: 200
    publish_raw: true
  - sensor: g
    transform: [{geodetic: {latitude_deg: 47.0, longitude_deg: 8.0}}]
    merge: {replace: {source: twin, when: {of: real, what: fix_type, below: 3}}}
"""
MINE = """
import numpy as np
from wil_campaign.recipes.working import Masked
def filter(work, other, *, left_px, width_px):
    mask = np.zeros(work.reading.image_bgr.shape[:2], np.uint8)
    mask[:, left_px : left_px + width_px] = 255
    return Masked(work.reading, mask)
"""


def same(a: Recipe, b: Recipe) -> bool:
    def plain_recipe(recipe: Recipe) -> object:
        return [
            (
                combination.sensor,
                [(step.kind.name, step.kind.stage, step.parameters) for step in combination.steps],
                (combination.merge.kind.name, combination.merge.parameters),
                combination.publish,
                combination.budget,
                combination.publish_raw,
            )
            for combination in recipe.combinations
        ]

    return (plain_recipe(a), a.sensors, a.description) == (
        plain_recipe(b),
        b.sensors,
        b.description,
    )


@pytest.mark.parametrize(("xml", "yaml"), [(LISTING, LISTING_YAML), (RICH, RICH_YAML)])
def test_xml_and_yaml_give_the_same_pipeline(tmp_path: Path, xml: str, yaml: str) -> None:
    (tmp_path / "mine.py").write_text(MINE)
    (tmp_path / "r.xml").write_text(xml)
    (tmp_path / "r.yaml").write_text(yaml)
    one, other = (load_recipe_file(tmp_path / name) for name in ("r.xml", "r.yaml"))
    assert same(one, other)


def test_the_papers_listing_mixes(tmp_path: Path) -> None:
    (tmp_path / "r.xml").write_text(LISTING)
    mixer, _ = compile_recipe(load_recipe_file(tmp_path / "r.xml"), object_ids={})
    image = plain((90, 90, 90))
    image[10:20, 10:20] = (0, 120, 255)
    mixed = mixer.mix(camera(plain(), "real"), camera(image), now_s=1.0).reading
    assert mixed is not None
    assert np.array_equal((mixed.image_bgr == (0, 120, 255)).all(axis=2), image[:, :, 2] == 255)


def test_a_file_beside_the_recipe_comes_before_the_built_in(tmp_path: Path) -> None:
    (tmp_path / "color_isolation.py").write_text("def filter(work, other):\n    return work\n")
    (tmp_path / "r.xml").write_text(LISTING)
    step = load_recipe_file(tmp_path / "r.xml").combinations[0].steps[1]
    assert step.label == "color_isolation.py:filter"


@pytest.mark.parametrize(
    ("old", "new", "line", "said"),
    [
        ("color_isolation.py", "isolate_colour.py", 9, "did you mean 'isolate_color'?"),
        ("<Lidar", "<Lidarr", 5, "<Lidarr> is not a sensor; did you mean 'lidar'?"),
        ('id="camera2"', "", 4, "<Camera> needs an id"),
        ('id="camera2"', 'id="camera1"', 4, "is declared twice"),
        ('<combine id="lidar1">', '<combine id="lidar2">', 12, "no sensor 'lidar2'"),
        ("<filter>", "<filtre>", 9, "not XML: mismatched tag"),
        ("<filter> color_isolation.py </filter>", "<filtr> a.py </filtr>", 9, "unknown tag"),
        ('by="min"', 'by="least"', 13, "must be"),
        ('by="min"', 'buy="min"', 13, "did you mean 'by'?"),
        ("aggregate.py", "aggregate", 13, "names a file.py"),
        ("aggregate.py", "overlay_.py", 13, "no built-in merge 'overlay_'"),
        ('by="min">aggregate.py', ">concatenate.py", 13, "'concatenate' works on"),
        ("<recipe_file>", "<recipe>", 15, "mismatched tag"),
        ("<recipe_file>", '<!DOCTYPE x [<!ENTITY a "b">]><recipe_file>', 1, "document type"),
        ('by="min"', 'by="[min"', 13, "attribute 'by'"),
        # These were left out without a word.
        ("<AS_sensors>", '<AS_sensors rate_hz="5">', 2, "attribute 'rate_hz': each sensor has"),
        ("<AS_sensors>", "<AS_sensors>5 Hz", 2, "<AS_sensors> has no text of its own: '5 Hz'"),
        (
            '<Camera id="camera1"/>',
            '<Camera id="camera1"><rate_hz>5</rate_hz></Camera>',
            3,
            '<rate_hz> in <Camera>: write it as rate_hz="5"',
        ),
        ('id="camera2"/>', 'id="camera2">5 Hz</Camera>', 4, "<Camera> has no text of its own"),
        ('id="camera1">', 'id="camera1">max_skew_ms=60', 7, "<combine> has no text of its own"),
        (
            "color_isolation.py ",
            "color_isolation.py <name>blue</name>",
            9,
            '<name> in <filter>: write it as name="blue"',
        ),
    ],
)
def test_faults_have_places_in_the_xml(
    tmp_path: Path, old: str, new: str, line: int, said: str
) -> None:
    assert old in LISTING
    (tmp_path / "r.xml").write_text(LISTING.replace(old, new, 1))
    with pytest.raises(BadInput) as caught:
        load_recipe_file(tmp_path / "r.xml")
    problem = caught.value.problems[0]
    assert said in problem.headline
    assert problem.line == line


def test_a_second_merge_is_refused() -> None:
    twice = LISTING.replace("</combine>", "<merge>overlay.py</merge></combine>", 1)
    with pytest.raises(BadInput, match="a second <merge>"):
        parse_paper_xml(twice.encode(), name="r.xml")


def test_a_file_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="cannot be read"):
        load_recipe_document(tmp_path / "none.xml")
    big = tmp_path / "big.xml"
    big.write_bytes(b"<a>" + b" " * 1_000_001)
    with pytest.raises(BadInput, match="larger than"):
        load_recipe_document(big)


@given(st.one_of(st.binary(max_size=200), st.text(max_size=200).map(str.encode)))
def test_random_input_is_bad_input(content: bytes) -> None:
    with pytest.raises(BadInput):
        parse_paper_xml(content, name="r.xml")


@given(st.integers(0, len(LISTING) - 1), st.integers(1, 30), st.sampled_from(["", "<", "&", '"']))
def test_a_spoilt_listing_is_bad_input_or_a_recipe(at: int, cut: int, put: str) -> None:
    spoilt = LISTING[:at] + put + LISTING[at + cut :]
    try:
        load_recipe(parse_paper_xml(spoilt.encode(), name="r.xml"))
    except BadInput as error:
        assert error.problems  # noqa: PT017 - either is right
