"""Which virtual objects a combination has to show, and which it leaves out by name."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.orchestrator.conftest import ROOT
from tests.recipes.samples import CAMERA, depth
from wil_campaign.campaigns.expansion.expansion import ExpansionOptions, load_campaign
from wil_campaign.campaigns.values.sensor_setups import (
    CameraSetup,
    DepthSetup,
    OtherSensorSetup,
    SensorSetup,
)
from wil_campaign.orchestrator.run.perception.visibility import (
    MixtureViews,
    ReadingExposure,
    VisibilityMeasurement,
    VisibilityProbe,
    visibility_comparison_of,
)
from wil_campaign.orchestrator.run.perception.visibility_probes import (
    VisibilityProbes,
    sought_objects,
)
from wil_campaign.orchestrator.state.run_setup import RunOrder, RunSetup
from wil_campaign.plugins.lidar.lidar_points import LidarPointsOptions
from wil_campaign.plugins.lidar.rangefinder import RangefinderOptions
from wil_campaign.plugins.lidar.visibility import lidar_reach_m
from wil_campaign.recipes.language.recipe_files import load_recipe_file
from wil_campaign.recipes.model.recipe import Combination
from wil_campaign.recipes.visibility.coverage import uncovered_objects
from wil_campaign.recipes.visibility.model import (
    ExpectedRanges,
    FrameVisibility,
    ObjectVisibility,
    VirtualObjects,
)
from wil_campaign.recipes.visibility.sampling import sampled_intrinsics
from wil_campaign.vehicles.readings import LidarPointsReading, Reading
from wil_campaign.vehicles.sensors.noise_sets import NoiseSetName
from wil_campaign.vehicles.sensors.sensor_spec import MountPart
from wil_campaign.worlds.camera import CameraMount
from wil_campaign.worlds.frames import AT_ORIGIN
from wil_campaign.worlds.scene.scene import Scene

THINGS = {2: "gate", 3: "intruder", 4: "decoy"}
RECIPE = """\
schema: wil/recipe/1
sensors: {camera: {type: camera, rate_hz: 15}}
combine:
  - sensor: camera
    filter: [FILTER]
    merge: {overlay: {priority: [twin, real]}}
"""


@pytest.mark.parametrize(
    ("filter_", "shows", "named", "sought", "left_out"),
    [
        ("isolate_color: {name: orange}", "", (), {2, 3, 4}, set()),
        ("isolate_objects: [decoy]", "", (), {4}, {2, 3}),
        ("isolate_objects: [decoy]", "", ("intruder", "cage"), {3, 4}, {2}),
        ("isolate_objects: [cage]", "", (), {2, 3, 4}, set()),
        ("isolate_objects: [decoy]", "[decoy]", ("intruder",), {4}, {2, 3}),
        ("isolate_objects: [decoy]", "[cage]", (), set(), {2, 3, 4}),
    ],
    ids=["by colour", "by name", "named by an oracle", "of both worlds", "said", "none"],
)
def test_only_objects_that_goal_or_oracles_name_must_be_shown(  # noqa: PLR0917 - a table
    tmp_path: Path,
    filter_: str,
    shows: str,
    named: tuple[str, ...],
    sought: set[int],
    left_out: set[int],
) -> None:
    text = RECIPE.replace("FILTER", f"{{{filter_}}}")
    (tmp_path / "recipe.yaml").write_text(text + (f"    shows: {shows}\n" if shows else ""))
    (combination,) = load_recipe_file(tmp_path / "recipe.yaml").combinations
    virtual = sought_objects(combination, THINGS, named)
    assert (set(virtual.names), set(virtual.not_mixed)) == (sought, left_out)


@pytest.mark.parametrize(
    ("filter_", "beside"),
    [
        ("isolate_color: {name: orange}", {3, 4}),
        ("isolate_objects: [decoy]", {4}),
        ("isolate_objects: [gate]", set()),
    ],
)
def test_a_recipe_may_show_more_than_it_has_to(
    tmp_path: Path, filter_: str, beside: set[int]
) -> None:
    text = RECIPE.replace("FILTER", f"{{{filter_}}}")
    (tmp_path / "recipe.yaml").write_text(f"{text}    shows: [gate]\n")
    (combination,) = load_recipe_file(tmp_path / "recipe.yaml").combinations
    assert sought_objects(combination, THINGS, ()).beside == beside


STEREO = DepthSetup(name="depth", rate_hz=15, intrinsics=CAMERA, mount=CameraMount())


def spinning(source: Any = None, **keys: Any) -> OtherSensorSetup:
    options = LidarPointsOptions(rate_hz=10.0, columns=36, rings=4, **keys)
    return OtherSensorSetup(kind="lidar_points", name="points", options=options, source=source)


SPINNING, NEAR = spinning(), spinning(range_max_m=8.0)
AHEAD = RangefinderOptions(rate_hz=10.0, beam_deg=0.0, mount=MountPart())
BELOW = OtherSensorSetup(kind="rangefinder", name="range", options=AHEAD)


def measured(folder: Path, sensor: SensorSetup, noise: NoiseSetName, at_m: float) -> Any:
    """Return what a probe measures of an object all around, of which the mixture shows nothing."""
    text = RECIPE.replace("filter: [FILTER]", "").replace("camera", sensor.kind)
    text = text.replace("{overlay: {priority: [twin, real]}}", "replace")
    (folder / "recipe.yaml").write_text(text)

    def seen(*given: Any) -> ExpectedRanges:
        sampled = sampled_intrinsics(CAMERA)
        count = sampled.width_px * sampled.height_px
        if sensor is not STEREO:
            count = len(given[1])
        return ExpectedRanges(np.full(count, at_m), np.full(count, 2, np.uint8))

    views: Any = SimpleNamespace(depths=seen, ranges=seen)
    parts = VisibilityMeasurement(
        combination=_combination(folder),
        real=sensor,
        twin=sensor,
        virtual=VirtualObjects({2: "gate"}),
        views=views,
        body=lambda _: AT_ORIGIN,
        is_like=True,
        is_judged=lambda: True,
        noise=noise,
    )
    nothing: Reading = depth(np.inf)
    if sensor is not STEREO:
        nothing = LidarPointsReading(1.0, 1.0, 3, "mixed", np.zeros((0, 3), np.float32))
    comparison = visibility_comparison_of(sensor.kind)
    assert comparison is not None
    probe = VisibilityProbe(parts, comparison=comparison, views=MixtureViews())
    found = probe._compare(nothing, nothing, AT_ORIGIN, 1.0)
    assert isinstance(found, FrameVisibility)
    (gate,) = found.objects
    assert gate.shown == 0.0
    return gate


def probed(shows: dict[str, str], *, rate_hz: float, count: int) -> tuple[Any, list[Any]]:
    """Return a probe, and the numbers of the mixtures that it measured, each with its visibility.

    shows: by object in view whether each mixture shows it (S) or misses it (M), by turns.
    """

    def seen(real: Any, mixed: int, at: ReadingExposure) -> FrameVisibility:
        del real
        objects = tuple(
            ObjectVisibility(name, True, 0.1, is_shown, is_shown, None, 10.0, "px")
            for name, turns in shows.items()
            for is_shown in [turns[mixed % len(turns)] == "S"]
        )
        return FrameVisibility(at.t_s, objects)

    parts: Any = SimpleNamespace(is_judged=lambda: True, body=lambda _: AT_ORIGIN)
    views: Any = SimpleNamespace(merged_real=lambda: 0)
    comparison: Any = SimpleNamespace(compare=seen)
    probe = VisibilityProbe(parts, comparison=comparison, views=views)
    found = []
    for k in range(count):
        made = SimpleNamespace(real_t_s=1.0 + k / rate_hz)
        given: Any = SimpleNamespace(reading=k, provenance=made)
        visibility = probe.measure(given)
        if visibility is not None:
            probe.coverage.observe(visibility)
            found.append((k, visibility))
    return probe, found


def test_a_mixture_after_a_wrong_one_is_measured_early_and_confirms_it() -> None:
    """At 100 Hz: the next one that is due is at least 0.05 s away."""
    probe, found = probed({"gate": "M" + "S" * 19}, rate_hz=100.0, count=20)
    confirms = [(k, visibility.confirms) for k, visibility in found]
    assert confirms[:2] == [(0, False), (1, True)]
    assert all(not is_early and k >= 5 for k, is_early in confirms[2:])
    gate = probe.coverage.objects["gate"]
    assert (gate.in_view, gate.due) == (len(found), len(found) - 1)


def test_what_confirms_postpones_nothing_that_is_due() -> None:
    """Each of these mixtures confirms the one before; the first alone would decide the shares."""
    turns = {"person": "SMM", "gate": "SSM", "wall": "MSS"}
    probe, found = probed(turns, rate_hz=100.0, count=6000)
    assert len(found) == 6000
    calm, _ = probed(dict.fromkeys(turns, "S"), rate_hz=100.0, count=6000)
    shares = {}
    for name, one in probe.coverage.objects.items():
        assert one.due == calm.coverage.objects[name].due
        shares[name] = one.due_shown / one.due
    assert shares == pytest.approx({"person": 1 / 3, "gate": 2 / 3, "wall": 2 / 3}, abs=0.05)
    fault = uncovered_objects([probe.coverage])
    assert fault is not None
    assert fault.text.startswith("the mixture hardly showed person: ")


def _combination(folder: Path) -> Combination:
    (combination,) = load_recipe_file(folder / "recipe.yaml").combinations
    return combination


@pytest.mark.parametrize(
    ("sensor", "noise", "at_m", "is_due"),
    [
        (STEREO, "datasheet", 9.0, True),
        (STEREO, "datasheet", 12.0, False),
        (STEREO, "datasheet", 0.2, False),
        (STEREO, "ideal", 12.0, True),
        (SPINNING, "ideal", 90.0, True),
        (SPINNING, "ideal", 120.0, False),
        (SPINNING, "ideal", 0.4, False),
        (NEAR, "datasheet", 7.0, True),
        (NEAR, "datasheet", 9.0, False),
    ],
)
def test_an_object_is_due_within_the_reach_of_the_twins_sensor(
    tmp_path: Path, sensor: SensorSetup, noise: NoiseSetName, at_m: float, is_due: bool
) -> None:
    assert measured(tmp_path, sensor, noise, at_m).in_view is is_due


def test_a_lidar_with_a_source_of_its_own_has_the_reach_that_the_campaign_gives() -> None:
    source: Any = SimpleNamespace()
    assert lidar_reach_m(spinning(source), "datasheet") == (0.0, np.inf)
    given = spinning(source, range_min_m=1.0, range_max_m=200.0)
    assert lidar_reach_m(given, "datasheet") == (1.0, 200.0)
    assert lidar_reach_m(BELOW, "ideal") == (0.0, np.inf)


SEEING = CameraSetup(name="camera", rate_hz=15, intrinsics=CAMERA, mount=CameraMount())


@pytest.mark.parametrize("sensor", [SEEING, STEREO, SPINNING, BELOW], ids=lambda one: one.kind)
def test_the_rays_of_a_probe_that_casts_some_are_built_before_the_flight(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, sensor: SensorSetup
) -> None:
    built: list[Scene] = []
    monkeypatch.setattr("wil_campaign.vehicles.sensors.world_views.SceneRayCaster", built.append)
    text = RECIPE.replace("filter: [FILTER]", "").replace("camera", sensor.kind)
    text = text.replace("{overlay: {priority: [twin, real]}}", "replace")
    (tmp_path / "recipe.yaml").write_text(text)
    options = ExpansionOptions(cases=("large",), modes=("wil",))
    plan = load_campaign(ROOT / "campaigns" / "gate.yaml", options).runs[0]
    context: Any = SimpleNamespace(pose_source="mocap", truth=None, poses=None)
    nothing: Any = SimpleNamespace(stage="goal", cameras={}, simulators={})
    probes = VisibilityProbes(
        setup=RunSetup.of(RunOrder(plan=plan, folder=tmp_path, clock="wall")),
        contexts={"real": context},
        events={},
        external_io=nothing,
        run_state=nothing,
    )
    mixer: Any = SimpleNamespace(combination=_combination(tmp_path), observer=None)
    assert isinstance(probes.of(mixer, sensor, sensor), VisibilityProbe)
    assert len(built) == (1 if sensor in {SPINNING, BELOW} else 0)
