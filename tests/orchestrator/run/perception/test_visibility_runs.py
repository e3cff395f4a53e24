"""Recipes that mix in nothing, or something elsewhere, through the command line: INVALID."""

import json
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import yaml

import orchestrator.cli
from orchestrator.cli import main
from orchestrator.recording.mcap_reader import Recording

ROOT = Path(orchestrator.cli.__file__).parents[2]

RECIPE = """\
schema: wil/recipe/1
sensors: {camera: {type: camera, rate_hz: 15}}
combine:
  - sensor: camera
    transform: [TIMING{resize: {to: real}}, {register: {pose: real, align: interpolate}}]
    filter: [FILTER]
    merge: MERGE
    max_skew_ms: SKEW
"""
WATCH = """\
from vehicles.autonomy import Command
from vehicles.setpoints import VelocitySetpoint


class Watch:
    \"\"\"Looks at the gate for some seconds, and goes up and down meanwhile.\"\"\"

    def __init__(self, *, goal, parameters, seed):
        self.since_s = None

    def perceive(self, reading):
        pass

    def act(self, telemetry):
        self.since_s = telemetry.t_s if self.since_s is None else self.since_s
        flown_s = telemetry.t_s - self.since_s
        side = 0.6 if flown_s < 1.5 else -0.6
        return Command(VelocitySetpoint((0.0, side, 0.0)), done=flown_s > 3.0)
"""
STEPS = """\
from dataclasses import replace

import cv2
import numpy as np

from recipes.working import Masked


def shift(work, other, *, right_px):
    image = np.roll(work.reading.image_bgr, right_px, axis=1)
    return Masked(replace(work.reading, image_bgr=image), np.roll(work.mask, right_px, axis=1))


def scaled(work, other, *, by):
    height, width = work.mask.shape
    about = np.array([[by, 0, (1 - by) * width / 2], [0, by, (1 - by) * height / 2]])
    image = cv2.warpAffine(work.reading.image_bgr, about, (width, height))
    mask = cv2.warpAffine(work.mask, about, (width, height), flags=cv2.INTER_NEAREST)
    return Masked(replace(work.reading, image_bgr=image), mask)
"""
ORANGE = "{isolate_color: {name: orange}}"
OVERLAY = "{overlay: {priority: [twin, real]}}"


@dataclass(frozen=True)
class Flown:
    """What the program made of one run."""

    code: int
    folder: Path

    @property
    def run(self) -> dict[str, Any]:
        (path,) = self.folder.rglob("summary.json")
        document: dict[str, Any] = json.loads(path.read_text())
        (run,) = document["runs"]
        found: dict[str, Any] = run
        return found

    @property
    def gate(self) -> dict[str, Any]:
        found: dict[str, Any] = self.run["mixing"]["shown"]["gate"]
        return found

    def visibility(self) -> list[dict[str, Any]]:
        """Return the messages of the recording."""
        from mcap.reader import make_reader

        (path,) = self.folder.rglob("run.mcap")
        assert list(Recording(path))
        with path.open("rb") as stream:
            messages = make_reader(stream).iter_messages(topics=["/mixed/camera/visibility"])
            return [json.loads(message.data) for _, _, message in messages]


@pytest.fixture
def campaign(tmp_path: Path) -> Path:
    """The shipped gate campaign with an autonomy that looks at the gate for three seconds."""
    for folder in ("campaigns", "worlds", "recipes"):
        (tmp_path / folder).mkdir()
        shutil.copy(ROOT / folder / "gate.yaml", tmp_path / folder / "gate.yaml")
    (tmp_path / "campaigns" / "watch.py").write_text(WATCH)
    (tmp_path / "recipes" / "own.py").write_text(STEPS)
    path = tmp_path / "campaigns" / "gate.yaml"
    document = yaml.safe_load(path.read_text())
    document |= {"autonomy": "watch.py:Watch"}
    document["oracles"]["reached"] = {"required": False}
    del document["controls"]
    path.write_text(yaml.safe_dump(document))
    world = tmp_path / "worlds" / "gate.yaml"
    document = yaml.safe_load(world.read_text())
    document["objects"]["gate"]["pose"]["east_m"] = 0
    world.write_text(yaml.safe_dump(document))
    return path


def fly(campaign: Path, recipe: str | None = None, *sets: str) -> Flown:
    """Fly one run of mode wil in virtual time, with small pictures."""
    if recipe is not None:
        (campaign.parents[1] / "recipes" / "gate.yaml").write_text(recipe)
    small = [
        f"vehicles.{name}.sensors.camera.{key}={value}"
        for name in ("real", "twin")
        for key, value in (("width_px", 320), ("height_px", 240))
    ]
    given = [word for one in (*small, *sets) for word in ("--set", one)]
    out = campaign.parents[1] / "out"
    which = ["--case", "large", "--mode", "wil", "--repetitions", "1", "--jobs", "1"]
    code = main(["run", str(campaign), *which, *given, "--out", str(out), "--clock", "virtual"])
    return Flown(code, out)


def recipe(
    filter_: str = ORANGE, merge: str = OVERLAY, *, timing: str = "", skew_ms: int = 60
) -> str:
    text = RECIPE.replace("TIMING", timing).replace("FILTER", filter_).replace("MERGE", merge)
    return text.replace("SKEW", str(skew_ms))


def test_a_faithful_mixture_shows_the_gate_in_its_place(campaign: Path) -> None:
    flown = fly(campaign)
    assert (flown.run["verdict"], flown.run["reason"]) == ("PASS", "")
    gate = flown.gate
    assert gate["frames_in_view"] >= 10
    assert gate["frames_shown"] == gate["frames_in_view"]
    assert gate["offset_px"]["p99"] <= 6.0
    assert flown.run["mixing"]["not_measured"] == ""
    messages = flown.visibility()
    assert len(messages) >= flown.run["mixing"]["frames_measured"]
    shown = [one for message in messages for one in message["objects"] if one["is_shown"]]
    assert len(shown) >= gate["frames_shown"]
    assert all(one["unit"] == "px" and one["offset"] <= one["limit"] for one in shown)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (recipe(merge="{overlay: {priority: [real, twin]}}"), "never showed gate"),
        (recipe("{isolate_color: {name: blue}}"), "(isolate_color kept nothing)"),
        (recipe("{isolate_objects: [cage]}"), "never showed gate"),
    ],
    ids=["empty", "wrong colour", "another object"],
)
def test_a_mixture_that_never_shows_the_gate_is_invalid(
    campaign: Path, text: str, said: str
) -> None:
    flown = fly(campaign, text)
    assert flown.code == 3
    assert flown.run["verdict"] == "INVALID"
    assert flown.run["reason"].startswith("mixing of camera: the mixture never showed gate: it was")
    assert said in flown.run["reason"]
    assert flown.gate["frames_shown"] == 0


@pytest.mark.parametrize(
    ("text", "least_px"),
    [
        (recipe(f"{ORANGE}, {{use: 'own.py:shift', with: {{right_px: 43}}}}"), 40.0),
        (recipe(f"{ORANGE}, {{use: 'own.py:scaled', with: {{by: 0.6}}}}"), 9.0),
        (recipe(f"{ORANGE}, {{use: 'own.py:scaled', with: {{by: 1.5}}}}"), 9.0),
        (recipe(timing="{delay: 1000}, ", skew_ms=3000), 9.0),
    ],
    ids=["shifted", "smaller", "larger", "late"],
)
def test_a_mixture_that_shows_the_gate_elsewhere_is_invalid(
    campaign: Path, text: str, least_px: float
) -> None:
    """43 px of 320 are the 87 px of 640 that were once flown without a word."""
    flown = fly(campaign, text)
    assert flown.code == 3
    assert flown.run["verdict"] == "INVALID"
    assert flown.run["reason"].startswith("mixing of camera: the mixture shows gate ")
    assert " px from its place at " in flown.run["reason"]
    assert flown.gate["offset_px"]["p99"] >= least_px


def test_a_late_whole_picture_is_invalid(campaign: Path) -> None:
    """Too far from its place, or hardly found at all: by how much the vehicle has moved."""
    flown = fly(campaign, recipe("", "{replace: twin}", timing="{delay: 1000}, ", skew_ms=3000))
    assert flown.code == 3
    assert flown.run["verdict"] == "INVALID"
    assert "the mixture " in flown.run["reason"]
    assert " gate" in flown.run["reason"]


@pytest.mark.parametrize("merge", ["{replace: twin}", "{aggregate: mean}"])
def test_a_recipe_that_changes_the_whole_picture_is_measured_too(
    campaign: Path, merge: str
) -> None:
    flown = fly(campaign, recipe("", merge))
    assert (flown.run["verdict"], flown.run["reason"]) == ("PASS", "")
    assert flown.gate["frames_shown"] == flown.gate["frames_in_view"] >= 10
    assert flown.gate["offset_px"]["p99"] <= 6.0


def test_an_object_that_the_recipe_need_not_show_is_not_missed(campaign: Path) -> None:
    pillar = (
        "world.objects.pillar={shape: {box: {size_m: [0.3, 0.3, 2.0]}}, color: blue,"
        " pose: {north_m: 2.5, east_m: 1.2, up_m: 1.0}, exists_in: {sim: Wv, wil: Wv, real: W}}"
    )
    missed = fly(campaign, recipe(), pillar)
    assert missed.run["verdict"] == "INVALID"
    said = "mixing: the mixture never showed pillar: it was in view in "
    assert missed.run["reason"].startswith(said)
    shutil.rmtree(missed.folder)
    flown = fly(campaign, recipe() + "    shows: [gate]\n", pillar)
    assert (flown.run["verdict"], flown.run["reason"]) == ("PASS", "")
    assert set(flown.run["mixing"]["shown"]) == {"gate"}


def test_a_recipe_that_shows_no_objects_says_that_it_was_not_measured(campaign: Path) -> None:
    sensors = [f"vehicles.{name}.sensors.pose={{type: pose}}" for name in ("real", "twin")]
    text = "schema: wil/recipe/1\nsensors: {pose: {type: pose}}\ncombine:\n"
    text += "  - {sensor: pose, transform: [{resample: interpolate}], merge: {aggregate: mean}}\n"
    flown = fly(campaign, text, *sensors)
    assert flown.run["mixing"]["not_measured"] == "a reading of type pose shows no objects"
    assert flown.run["mixing"]["shown"] == {}


LIDAR = """\
schema: wil/recipe/1
sensors: {lidar: {type: lidar, rate_hz: 10}}
combine:
  - sensor: lidar
    transform: [{register: {pose: real, align: interpolate}}MORE]
    merge: MERGE
"""


@pytest.mark.parametrize(
    ("text", "verdict", "said"),
    [
        (LIDAR.replace("MORE", "").replace("MERGE", "{aggregate: min}"), "PASS", ""),
        (
            LIDAR.replace("MORE", "").replace("MERGE", "{overlay: [real, twin]}"),
            "INVALID",
            "mixing of lidar: the mixture never showed wall: it was in view in ",
        ),
        (
            LIDAR.replace("MORE", ", {units: {length: ft}}").replace("MERGE", "{aggregate: min}"),
            "INVALID",
            "mixing of lidar: the mixture shows wall 3.",
        ),
    ],
    ids=["honest", "empty", "feet for metres"],
)
def test_beams_are_compared_with_what_geometry_puts_before_them(
    tmp_path: Path, text: str, verdict: str, said: str
) -> None:
    (tmp_path / "lidar.yaml").write_text(text)
    document = yaml.safe_load((ROOT / "campaigns" / "avoid-ardupilot.yaml").read_text())
    del document["controls"]
    straight = str(ROOT / "campaigns" / "autonomies" / "straight.py")
    document["autonomy"] = {
        "use": f"{straight}:StraightAutonomy",
        "with": {"speed_m_s": 1.0, "for_s": 3},
    }
    document |= {"recipe": "lidar.yaml", "world": str(ROOT / "worlds" / "wall.yaml")}
    document["oracles"]["clearance"]["required"] = False
    campaign, out = tmp_path / "avoid.yaml", tmp_path / "out"
    campaign.write_text(yaml.safe_dump(document))
    which = ["--mode", "wil", "--repetitions", "1", "--jobs", "1", "--clock", "virtual"]
    flown = Flown(main(["run", str(campaign), *which, "--out", str(out)]), out)
    assert flown.run["verdict"] == verdict
    assert flown.run["reason"].startswith(said)
    wall = flown.run["mixing"]["shown"]["wall"]
    assert wall["frames_in_view"] >= 5
    assert wall["offset_px"] is None
    if verdict == "PASS":
        assert wall["frames_shown"] == wall["frames_in_view"]
        assert wall["offset_m"]["p99"] < 0.2
