"""Recipes that mix in nothing, or something elsewhere: INVALID."""

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader

from tests.orchestrator.conftest import ROOT, SMALL_CAMERAS
from wil_campaign.foundation.files.document_writer import to_json
from wil_campaign.orchestrator.cli import main
from wil_campaign.orchestrator.run.perception.perception import PerceivedSensor
from wil_campaign.orchestrator.run.perception.visibility import MixtureViews
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.plugins.python.mcap_reader import Recording
from wil_campaign.recipes.pipeline.stages import StageView

RECIPE = """\
schema: wil/recipe/1
sensors: {camera: {type: camera, rate_hz: 5}}
combine:
  - sensor: camera
    transform: [TIMING{resize: {to: real}}, {register: {pose: real, align: interpolate}}]
    filter: [FILTER]
    merge: MERGE
    max_skew_ms: SKEW
"""
WATCH = """\
from wil_campaign.vehicles.autonomy import Command
from wil_campaign.vehicles.setpoints import VelocitySetpoint


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

from wil_campaign.recipes.working import Masked


def shift(work, other, *, right_px):
    image = np.roll(work.reading.image_bgr, right_px, axis=1)
    return Masked(replace(work.reading, image_bgr=image), np.roll(work.mask, right_px, axis=1))


def enlarge(work, other, *, by):
    height, width = work.mask.shape[:2]
    about = cv2.getRotationMatrix2D((width / 2, height / 2), 0, by)
    image, mask = (
        cv2.warpAffine(one, about, (width, height), flags=cv2.INTER_NEAREST)
        for one in (work.reading.image_bgr, work.mask.astype(np.uint8))
    )
    return Masked(replace(work.reading, image_bgr=image), mask.astype(work.mask.dtype))


class Seldom:
    \"\"\"Keeps the object in one image of three.\"\"\"

    def __init__(self, *, first):
        self.count = -first

    def __call__(self, work, other):
        self.count += 1
        return work if self.count % 3 == 0 else Masked(work.reading, np.zeros_like(work.mask))


def red_for_blue(work, other):
    image = np.ascontiguousarray(work.reading.image_bgr[:, :, ::-1])
    return Masked(replace(work.reading, image_bgr=image), work.mask)
"""
ORANGE = "{isolate_color: {name: orange}}"
OVERLAY = "{overlay: {priority: [twin, real]}}"


Fly = Callable[..., tuple[RunResult, Path]]


@dataclass(frozen=True)
class Flown:
    """What came of one run."""

    run: dict[str, Any]
    folder: Path

    @property
    def gate(self) -> dict[str, Any]:
        found: dict[str, Any] = self.run["mixing"]["shown"]["gate"]
        return found

    def visibility(self) -> list[dict[str, Any]]:
        """Return the messages of the recording."""
        path = self.folder / "run.mcap"
        assert list(Recording(path))
        with path.open("rb") as stream:
            messages = make_reader(stream).iter_messages(topics=["/mixed/camera/visibility"])
            return [json.loads(message.data) for _, _, message in messages]


Watching = Callable[..., Flown]


@pytest.fixture
def sets(tmp_path: Path) -> tuple[str, ...]:
    """Return the overrides by which an autonomy looks at the shipped campaign's gate for 3 s."""
    (tmp_path / "watch.py").write_text(WATCH)
    (tmp_path / "own.py").write_text(STEPS)
    return (
        *SMALL_CAMERAS,
        # Mixtures are measured five times a second.
        *(f"vehicles.{name}.sensors.camera.rate_hz=5" for name in ("real", "twin")),
        f"autonomy={tmp_path}/watch.py:Watch",
        "world.objects.gate.pose.east_m=0",
        "oracles.reached.required=false",
    )


@pytest.fixture
def watch(fly_run: Fly, tmp_path: Path, sets: tuple[str, ...]) -> Watching:
    """Return a function that flies the campaign with a recipe, and overrides."""

    def fly(recipe: str = "", *more: str) -> Flown:
        if recipe:
            (tmp_path / "recipe.yaml").write_text(recipe)
            more = (f"recipe={tmp_path}/recipe.yaml", *more)
        result, folder = fly_run(sets=(*sets, *more), has_cameras=False)
        return Flown(json.loads(to_json(result)), folder)

    return fly


@pytest.fixture
def invalid(forked_workers: None, tmp_path: Path, sets: tuple[str, ...]) -> Watching:
    """Return a function that flies a wrong recipe through the command line: INVALID, exit 3."""

    def fly(recipe: str) -> Flown:
        (tmp_path / "recipe.yaml").write_text(recipe)
        given = (*sets, f"recipe={tmp_path}/recipe.yaml", "controls={}")
        options = [option for value in given for option in ("--set", value)]
        options += ["--case", "large", "--mode", "wil", "--repetitions", "1", "--jobs", "1"]
        out = tmp_path / "out"
        gate = str(ROOT / "campaigns" / "gate.yaml")
        assert main(["run", gate, *options, "--out", str(out), "--json"]) == 3
        (path,) = out.rglob("result.json")
        run = json.loads(path.read_text("utf-8"))
        assert run["verdict"] == "INVALID"
        return Flown(run, path.parent)

    return fly


def recipe(
    filter_: str = ORANGE, merge: str = OVERLAY, *, timing: str = "", skew_ms: int = 60
) -> str:
    text = RECIPE.replace("TIMING", timing).replace("FILTER", filter_).replace("MERGE", merge)
    return text.replace("SKEW", str(skew_ms))


def test_a_faithful_mixture_shows_the_gate_in_its_place(watch: Watching) -> None:
    flown = watch("", "recipe.sensors.camera.rate_hz=5")
    assert (flown.run["verdict"], flown.run["reason"]) == ("PASS", "")
    gate = flown.gate
    assert gate["frames_in_view"] >= 10
    assert gate["frames_shown"] == gate["frames_in_view"]
    assert gate["offset_px"]["p99"] <= 6.0
    assert flown.run["mixing"]["not_measured"] == ""
    messages = flown.visibility()
    assert len(messages) >= flown.run["mixing"]["frames_measured"] >= gate["frames_in_view"]
    shown = [one for message in messages for one in message["objects"] if one["is_shown"]]
    assert len(shown) >= gate["frames_shown"]
    assert all(one["unit"] == "px" and one["offset"] <= one["limit"] for one in shown)


def test_a_mixture_that_never_shows_the_gate_is_invalid(invalid: Watching) -> None:
    flown = invalid(recipe("{isolate_color: {name: blue}}"))
    assert flown.run["reason"].startswith("mixing of camera: the mixture never showed gate: it was")
    assert "(isolate_color kept nothing)" in flown.run["reason"]
    assert flown.gate["frames_shown"] == 0


def test_a_mixture_that_shows_the_gate_elsewhere_is_invalid(invalid: Watching) -> None:
    """43 px of 320 are the 87 px of 640 that were once flown without a word."""
    flown = invalid(recipe(f"{ORANGE}, {{use: 'own.py:shift', with: {{right_px: 43}}}}"))
    assert flown.run["reason"].startswith("mixing of camera: the mixture shows gate ")
    assert " px from its place at " in flown.run["reason"]
    assert flown.gate["offset_px"]["p99"] >= 40.0


def test_a_mixture_that_shows_the_gate_in_another_size_is_invalid(invalid: Watching) -> None:
    flown = invalid(recipe(f"{ORANGE}, {{use: 'own.py:enlarge', with: {{by: 1.5}}}}"))
    assert flown.run["reason"].startswith("mixing of camera: the mixture shows gate ")
    assert " px from its place at " in flown.run["reason"]


@pytest.mark.parametrize("first", [0, 1, 2])
def test_a_mixture_that_shows_the_gate_in_one_image_of_three_is_invalid(
    watch: Watching, first: int
) -> None:
    """The measured mixtures were each third image of 15 a second: always those with the gate."""
    steps = f"{ORANGE}, {{use: 'own.py:Seldom', with: {{first: {first}}}}}"
    quick = [f"vehicles.{name}.sensors.camera.rate_hz=15" for name in ("real", "twin")]
    flown = watch(recipe(steps), *quick, "recipe.sensors.camera.rate_hz=15")
    assert flown.run["verdict"] == "INVALID"
    assert "the mixture hardly showed gate" in flown.run["reason"]


@pytest.mark.parametrize("is_exchanged", [False, True])
def test_two_gates_of_which_each_is_shown_as_the_other_are_invalid(
    watch: Watching, *, is_exchanged: bool
) -> None:
    """Their outlines were where they are expected: a red and a blue gate exchanged were a PASS."""
    shape = "shape: {gate: {inner_size_m: 0.6}}, exists_in: {sim: Wv, wil: Wv, real: W}"
    gates = (
        f"world.objects.{name}={{{shape}, color: {color}, pose: {{{place}, up_m: 1.2}}}}"
        for name, color, place in (
            ("gate", "red", "north_m: 3, east_m: -0.7"),
            ("other", "blue", "north_m: 3, east_m: 0.7"),
        )
    )
    exchange = ", {use: 'own.py:red_for_blue', on: twin}" if is_exchanged else ""
    flown = watch(recipe("{isolate_objects: [gate, other]}" + exchange), *gates)
    assert flown.run["verdict"] == ("INVALID" if is_exchanged else "PASS")
    said = "mixing of camera: the mixture shows gate in the place of other, "
    assert flown.run["reason"].startswith(said if is_exchanged else "")


def test_a_late_whole_picture_is_invalid(invalid: Watching) -> None:
    """Too far from its place, or hardly found at all: by how much the vehicle has moved."""
    flown = invalid(recipe("", "{replace: twin}", timing="{delay: 1000}, ", skew_ms=3000))
    assert "the mixture " in flown.run["reason"]
    assert " gate" in flown.run["reason"]


def test_a_recipe_that_changes_the_whole_picture_is_measured_too(watch: Watching) -> None:
    flown = watch(recipe("", "{aggregate: mean}"))
    assert (flown.run["verdict"], flown.run["reason"]) == ("PASS", "")
    assert flown.gate["frames_shown"] == flown.gate["frames_in_view"] >= 10
    assert flown.gate["offset_px"]["p99"] <= 6.0


def test_an_object_that_the_recipe_need_not_show_is_not_missed(watch: Watching) -> None:
    pillar = (
        "world.objects.pillar={shape: {box: {size_m: [0.3, 0.3, 2.0]}}, color: blue,"
        " pose: {north_m: 2.5, east_m: 1.2, up_m: 1.0}, exists_in: {sim: Wv, wil: Wv, real: W}}"
    )
    missed = watch(recipe(), pillar)
    assert missed.run["verdict"] == "INVALID"
    said = "mixing: the mixture never showed pillar: it was in view in "
    assert missed.run["reason"].startswith(said)
    flown = watch(recipe() + "    shows: [gate]\n", pillar)
    assert (flown.run["verdict"], flown.run["reason"]) == ("PASS", "")
    assert set(flown.run["mixing"]["shown"]) == {"gate"}


POSES = "  - {sensor: pose, transform: [{resample: interpolate}], merge: {aggregate: mean}}\n"


@pytest.fixture
def held(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Return how many outputs of steps are held after each one that is taken."""
    take, held = MixtureViews.__call__, list[int]()

    def taken(views: MixtureViews, view: StageView) -> None:
        take(views, view)
        held.append(len(views.views))

    monkeypatch.setattr(MixtureViews, "__call__", taken)
    return held


def test_a_recipe_that_shows_no_objects_says_that_it_was_not_measured(
    watch: Watching, held: list[int]
) -> None:
    sensors = [f"vehicles.{name}.sensors={{pose: {{type: pose}}}}" for name in ("real", "twin")]
    text = f"schema: wil/recipe/1\nsensors: {{pose: {{type: pose}}}}\ncombine:\n{POSES}"
    flown = watch(text, *sensors)
    assert flown.run["mixing"]["frames"] > 100
    assert held == []
    assert flown.run["mixing"]["not_measured"] == "a reading of type pose shows no objects"
    assert flown.run["mixing"]["shown"] == {}


def test_the_outputs_of_a_measured_mixture_are_held_until_the_next_one(
    watch: Watching, held: list[int]
) -> None:
    sensors = [f"vehicles.{name}.sensors.pose={{type: pose}}" for name in ("real", "twin")]
    both = recipe().replace("rate_hz: 5}}", "rate_hz: 5}, pose: {type: pose}}") + POSES
    flown = watch(both, *sensors)
    assert (flown.run["verdict"], flown.run["reason"]) == ("PASS", "")
    # Both sides as given, resize, isolate_color, and the merge.
    assert max(held) == 5


LIDAR = """\
schema: wil/recipe/1
sensors: {lidar: {type: lidar, rate_hz: 10}}
combine:
  - sensor: lidar
    transform: [{register: {pose: real, align: interpolate}}MORE]
    merge: {aggregate: min}
"""


@pytest.mark.parametrize(
    ("more", "verdict", "said"),
    [
        ("", "PASS", ""),
        (
            ", {units: {length: ft}}",
            "INVALID",
            "mixing of lidar: the mixture shows wall 3.",
        ),
    ],
    ids=["honest", "feet for metres"],
)
def test_beams_are_compared_with_what_geometry_puts_before_them(
    fly_run: Fly, tmp_path: Path, more: str, verdict: str, said: str
) -> None:
    (tmp_path / "lidar.yaml").write_text(LIDAR.replace("MORE", more))
    sets = (
        f"recipe={tmp_path}/lidar.yaml",
        "world=../worlds/wall.yaml",
        "autonomy={use: autonomies/straight.py:StraightAutonomy, with: {speed_m_s: 1, for_s: 3}}",
        "oracles.clearance.required=false",
    )
    result, _ = fly_run("avoid-ardupilot", "default", sets=sets, has_cameras=False)
    assert result.verdict == verdict
    assert result.reason.startswith(said)
    assert result.mixing is not None
    wall = result.mixing.shown["wall"]
    assert wall.frames_in_view >= 5
    assert wall.offset_px is None
    if verdict == "PASS":
        assert wall.frames_shown == wall.frames_in_view
        assert wall.offset_m is not None
        assert wall.offset_m.p99 is not None
        assert wall.offset_m.p99 < 0.2


RANGES = """\
schema: wil/recipe/1
sensors:
  stereo: {type: depth, rate_hz: 5}
  lidar: {type: lidar, rate_hz: 5}
combine:
  - sensor: stereo
    transform: [{register: {pose: real, align: interpolate}}]
    merge: {aggregate: {by: min}}
    max_skew_ms: 60
  - sensor: lidar
    transform: [{register: {pose: real, align: interpolate}}]
    merge: {aggregate: {by: min}}
    max_skew_ms: 60
"""


@pytest.mark.parametrize(
    ("covered", "verdict"), [("", "PASS"), ("stereo", "INVALID"), ("lidar", "INVALID")]
)
def test_a_covered_real_sensor_of_which_nothing_comes_back_is_invalid(
    covered: str, verdict: str, watch: Watching, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The gate was mixed into nothing: what stands in the hall was not there, and it passed."""
    deliver = PerceivedSensor._deliver

    def taken(self: PerceivedSensor, reading: Any) -> None:
        if self.sensor == covered and reading.source == "real":
            name = "depth_m" if covered == "stereo" else "ranges_m"
            reading = replace(reading, **{name: np.full_like(getattr(reading, name), np.inf)})
        deliver(self, reading)

    monkeypatch.setattr(PerceivedSensor, "_deliver", taken)
    stereo = "{type: depth, rate_hz: 5, width_px: 160, height_px: 120, fov_deg: 69}"
    sensors = f"{{stereo: {stereo}, lidar: {{type: lidar, rate_hz: 5}}}}"
    more = [f"vehicles.{name}.sensors={sensors}" for name in ("real", "twin")]
    run = watch(RANGES, *more).run
    assert run["verdict"] == verdict, run["reason"]
    if covered:
        said = f"mixing of {covered}: the mixture has nothing of the real sensor from "
        assert run["reason"].startswith(said)
        assert run["reason"].endswith("within 4 m of it: it is covered or broken")
