"""The code of a plugin that fails is named with the plugin, and judges and mixes nothing wrong."""

import json
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.orchestrator.hover import write_hover
from tests.recipes.samples import camera, plain
from tests.test_house import ROOT
from tests.wil_campaign.test_installed_plugins import PLUGIN, fly, forget_plugins, put_distribution
from wil_campaign.orchestrator.cli import main
from wil_campaign.recipes.language.recipe_files import load_recipe_file
from wil_campaign.recipes.pipeline.pipeline import Mixer, compile_recipe
from wil_campaign.recipes.working import StepError

STEP = """
from dataclasses import replace

import numpy as np

from wil_campaign.api import Masked, SidedParameters, StepParameters, step
from wil_campaign.hooks import RecipeStep, implements


@implements
def recipe_steps():
    return [RecipeStep("dim", "wil_sonar:DIM"), RecipeStep("blend", "wil_sonar:blend")]


class DimParameters(SidedParameters):
    shorthand = "how"

    how: str


def dim(parameters, context):
    \"\"\"Take light off an image.\"\"\"
    how = parameters.how
    if how == "unbuilt":
        raise ValueError("no lamp")

    def operator(work, other):
        image, reading = work.reading.image_bgr, work.reading
        if how == "bare":
            return replace(reading, image_bgr=image // 2)
        if how == "inside":
            image[:] = image // 2
            return work
        if how == "nothing":
            return None
        if how == "raises":
            raise ValueError("no light")
        if how == "mask":
            return Masked(reading, np.ones(image.shape[:2]))
        if how == "late":
            return replace(work, reading=replace(reading, t_s=float("nan")))
        return replace(work, reading=replace(reading, image_bgr=image * 0.5))

    return operator


DIM = tuple(
    step("dim", stage=stage, sensors=("camera",), parameters=DimParameters)(dim)
    for stage in ("transform", "filter")
)


class BlendParameters(StepParameters):
    pass


@step("blend", stage="merge", sensors=("camera",), parameters=BlendParameters)
def blend(parameters, context):
    \"\"\"Blend both images.\"\"\"

    def merge(sides):
        image = sides["real"].reading.image_bgr * 0.5
        return replace(sides["real"].reading, image_bgr=image)

    return merge
"""
Install = Callable[[str], None]
FORGOT = "the check of a SonarReading returned None, not a text"
STOPPED = "gave a reading of 0.000 s at 7.103 s, after one of 0.000 s"
DOWN = "(sonar down of twin)"
NAMED = "; plugin sonar (wil-sonar 1.2): mend it, or uninstall it"
WHOSE = r"; plugin sonar \(wil-sonar 1\.2\): mend it, or uninstall it"


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Install]:
    """Return a function that installs a distribution with a plugin, whose source is given."""

    def write(source: str) -> None:
        put_distribution(tmp_path, "sonar", "wil_sonar", {"wil_sonar.py": source})
        monkeypatch.syspath_prepend(tmp_path)
        monkeypatch.delitem(sys.modules, "wil_sonar", raising=False)
        forget_plugins()

    yield write
    forget_plugins()


def mixer(folder: Path, how: str, merge: str = "overlay") -> Mixer:
    """Return what mixes by a step of the plugin, on the real side, which the autonomy perceives."""
    path = folder / "dim.yaml"
    path.write_text(
        "schema: wil/recipe/1\nsensors: {camera: {type: camera}}\ncombine:\n"
        f"  - {{sensor: camera, transform: [{{dim: {{how: {how}, on: real}}}}], merge: {merge}}}\n"
    )
    (one,) = compile_recipe(load_recipe_file(path), object_ids={})
    return one


def mixed(one: Mixer) -> Any:
    return one.mix(camera(plain(), "real"), None, now_s=1.1)


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ("unbuilt", r"ValueError: no lamp \(wil_sonar.py line \d+\)"),
        ("raises", r"ValueError: no light \(wil_sonar.py line \d+\)"),
        ("nothing", "returned NoneType, not a reading or a Masked"),
        ("float", "returned a bad reading: image is float64, not uint8"),
        ("mask", "returned a mask of float64, not of bool, or uint8 with 255 for kept"),
        ("late", "returned a bad reading: sampled at nan s, delivered at nan s"),
    ],
)
def test_a_plugin_s_step_that_fails_is_named_with_its_line(
    install: Install, tmp_path: Path, how: str, said: str
) -> None:
    """The autonomy was given images of floats; of nothing, the next step was blamed."""
    install(STEP)
    with pytest.raises(StepError, match=rf"dim.yaml:4: step dim, frame 0: .*{said}{WHOSE}"):
        mixed(mixer(tmp_path, how))


def test_a_plugin_s_merge_that_returns_what_is_no_image_is_named(
    install: Install, tmp_path: Path
) -> None:
    install(STEP)
    with pytest.raises(StepError, match=rf"step blend, frame 0: .*is float64, not uint8{WHOSE}"):
        mixed(mixer(tmp_path, "bare", merge="blend"))


@pytest.mark.parametrize("how", ["bare", "inside"])
def test_a_plugin_s_step_may_return_a_reading_and_write_into_what_it_is_given(
    install: Install, tmp_path: Path, how: str
) -> None:
    install(STEP)
    given = camera(plain(), "real")
    made: Any = mixer(tmp_path, how).mix(given, None, now_s=1.1).reading
    assert (made.image_bgr == plain() // 2).all()
    assert (given.image_bgr == plain()).all()


SENSOR = """
import os
from dataclasses import dataclass

from wil_campaign.api import NumbersReading, SensorOptions, SensorSpec
from wil_campaign.hooks import SensorKind, implements


@implements
def sensor_types():
    return [SensorKind("sonar", "wil_sonar:SONAR")]


@dataclass(frozen=True, slots=True, kw_only=True)
class SonarReading(NumbersReading):
    depth_m: float


class SonarOptions(SensorOptions):
    \"\"\"A sonar. rate_hz: pings in a second. how: it fails.\"\"\"

    rate_hz: float = 10.0
    how: str = ""


class Sonar:
    def __init__(self, options, site):
        self.how, self.side = options.how, site.side
        if self.how == "unbuilt":
            raise ValueError("no water")

    def sample(self, truth, t_s, rng):
        if self.how == "raises":
            raise ValueError("no echo")
        if self.how == "nothing":
            return None
        depths_m = {"text": "deep", "nan": float("nan"), "check": -1.0, "forgot": 9.0}
        depth_m = depths_m.get(self.how, 1.0)
        at_s = 0.0 if self.how == "stopped" else t_s
        side = "mixed" if self.how == "other side" else self.side
        return SonarReading(t_s=at_s, arrived_s=t_s, seq=0, source=side, depth_m=depth_m)


def fault(reading):
    if reading.depth_m < 0.0:
        raise ValueError("no such depth")
    return None if reading.depth_m == 9.0 else ""


SONAR = SensorSpec("sonar", SonarReading, SonarOptions, Sonar, fault)
"""


@pytest.mark.parametrize(
    ("how", "verdict", "said"),
    [
        ("", "PASS", ""),
        ("unbuilt", "ERROR", f"the run: ValueError: no water {DOWN}{NAMED}"),
        ("raises", "ERROR", f"sensor samples: ValueError: no echo {DOWN}{NAMED}"),
        (
            "nothing",
            "ERROR",
            f"sensor samples: TypeError: gave NoneType, not SonarReading {DOWN}{NAMED}",
        ),
        (
            "other side",
            "ERROR",
            f"sensor samples: ValueError: gave a reading of mixed, not of twin {DOWN}{NAMED}",
        ),
        (
            "stopped",
            "ERROR",
            f"sensor samples: ValueError: {STOPPED} {DOWN}{NAMED}",
        ),
        ("text", "INVALID", "down of twin: depth_m is 'deep', no number; no autonomy is given it"),
        ("nan", "INVALID", "down of twin: depth_m is nan; no autonomy is given it"),
        ("check", "ERROR", f"sensor delivery: ValueError: no such depth{NAMED}"),
        ("forgot", "ERROR", f"sensor delivery: TypeError: {FORGOT}{NAMED}"),
    ],
)
def test_a_plugin_s_sensor_that_fails_is_named(
    tmp_path: Path, how: str, verdict: str, said: str
) -> None:
    put_distribution(tmp_path, "sonar", "wil_sonar", {"wil_sonar.py": SENSOR})
    file = write_hover(tmp_path)
    sensor = f"sensors: {{down: {{type: sonar, how: '{how}'}}}}"
    file.write_text(file.read_text().replace("px4", f"px4, {sensor}"))
    out = tmp_path / "out"
    fly([str(file), "--repetitions", "1", "--out", str(out)], tmp_path)
    (result,) = (json.loads(path.read_text()) for path in out.glob("**/result.json"))
    assert (result["verdict"], result["reason"]) == (verdict, said)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            ("(SensorOptions)", ""),
            "sensor 'sonar': SonarOptions is not derived from SensorOptions",
        ),
        (
            ("(NumbersReading)", ""),
            "sensor 'sonar': SonarReading lacks the stamps of a NumbersReading",
        ),
        (
            ("@dataclass(frozen=True, slots=True, kw_only=True)\n", ""),
            "sensor 'sonar': SonarReading is no dataclass of its own",
        ),
    ],
)
def test_a_plugin_s_type_of_sensors_that_does_not_fit_is_refused(
    install: Install, capsys: pytest.CaptureFixture[str], change: tuple[str, str], said: str
) -> None:
    """It was an internal error, or an ERROR of a vehicle that had armed."""
    install(SENSOR.replace(*change))
    assert main(["validate", str(ROOT / "campaigns" / "gate.yaml")]) == 2
    said = f"{PLUGIN}: cannot be used: TypeError: {said}; mend it, or uninstall it"
    assert capsys.readouterr().err.startswith(said)


ORACLE = """
from wil_campaign.api import LimitOracle, Windowed, oracle
from wil_campaign.hooks import OracleKind, implements


@implements
def oracles():
    return [OracleKind("calm", "wil_sonar:calm")]


class CalmParameters(Windowed):
    how: str


class Calm(LimitOracle):
    def __init__(self, terms, how):
        super().__init__(terms, unit="m", limit=9.0)
        self.how = how

    def on_pose(self, sample):
        if self.how == "true":
            return True
        return self.judge_margin(sample.t_s, 1.0, 8.0, lambda: "")

    def result(self, t_s):
        return None if self.how == "nothing" else super().result(t_s)


@oracle("calm", "is calm", CalmParameters)
def calm(terms, parameters, context):
    if parameters.how == "unbuilt":
        raise ValueError("no wind")
    return None if parameters.how == "unmade" else Calm(terms, parameters.how)
"""
OF_TWIN = "(oracle 'calm' of twin)"


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ("true", f"in flight: TypeError: it returned a bool, not a sequence of flags {OF_TWIN}"),
        (
            "nothing",
            f"the result: TypeError: its result is a NoneType, not an OracleResult {OF_TWIN}",
        ),
    ],
)
def test_a_plugin_s_oracle_that_returns_what_is_no_answer_is_named(
    tmp_path: Path, how: str, said: str
) -> None:
    """A line of the program's own file was blamed, and no plugin."""
    put_distribution(tmp_path, "sonar", "wil_sonar", {"wil_sonar.py": ORACLE})
    file, out = write_hover(tmp_path), tmp_path / "out"
    words = ["--repetitions", "1", "--out", str(out), "--set", f"oracles.calm={{how: '{how}'}}"]
    assert fly([str(file), *words], tmp_path).returncode == 3
    (result,) = (json.loads(path.read_text()) for path in out.glob("**/result.json"))
    assert (result["verdict"], result["reason"]) == ("ERROR", said + NAMED)


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ("unbuilt", "ValueError: no wind (oracle 'calm', made by wil_sonar)"),
        ("unmade", "TypeError: gave NoneType, not an Oracle (oracle 'calm', made by wil_sonar)"),
    ],
)
def test_a_plugin_s_oracle_that_cannot_be_made_is_named(
    tmp_path: Path, how: str, said: str
) -> None:
    put_distribution(tmp_path, "sonar", "wil_sonar", {"wil_sonar.py": ORACLE})
    file = write_hover(tmp_path)
    shown = fly([str(file), "--set", f"oracles.calm={{how: '{how}'}}"], tmp_path)
    assert shown.returncode == 3
    assert shown.stderr.startswith(f"internal error: {said}{NAMED}")
