"""What the run server loads before it forks, and what a run loads before its flight."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from tests.orchestrator.conftest import ROOT
from tests.recipes.samples import CAMERA
from wil_campaign.campaigns.expansion.expansion import ExpansionOptions, load_campaign
from wil_campaign.campaigns.values.sensor_setups import (
    CameraSetup,
    DepthSetup,
    OtherSensorSetup,
    SensorSetup,
)
from wil_campaign.orchestrator.run.perception import warm_up
from wil_campaign.orchestrator.state.run_setup import RunOrder, RunSetup
from wil_campaign.plugins.lidar.rangefinder import RangefinderOptions
from wil_campaign.vehicles.embedded.emulations import load_kernels
from wil_campaign.vehicles.embedded.physics.motion_kernel import estimate_motion
from wil_campaign.worlds import jit
from wil_campaign.worlds.camera import CameraMount
from wil_campaign.worlds.clearance.surfaces import is_swept_beyond, surface_distance
from wil_campaign.worlds.frames import AT_ORIGIN, Pose, Vec3
from wil_campaign.worlds.scene.parts import SolidPart, SurfaceShape
from wil_campaign.worlds.scene.scene import Scene, SceneObject
from wil_campaign.worlds.scene.shapes import Shape, box_shape


def test_a_kernel_is_cached_once_it_was_compiled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    load_kernels()
    assert jit.is_kernel_cached(estimate_motion)
    monkeypatch.setattr(jit, "cache_folder", lambda _: tmp_path)
    assert not jit.is_kernel_cached(estimate_motion)
    monkeypatch.setattr(jit, "cache_folder", lambda _: None)
    assert not jit.is_kernel_cached(estimate_motion)


@pytest.mark.parametrize(
    "kept",
    [
        (),
        ("estimate_motion",),
        ("write_ids",),
        ("mark_hsv_pixels",),
        ("write_ids", "mark_hsv_pixels"),
        ("estimate_motion", "write_ids"),
    ],
)
def test_the_run_server_compiles_nothing(
    monkeypatch: pytest.MonkeyPatch, kept: tuple[str, ...]
) -> None:
    loaded: list[str] = []
    monkeypatch.setattr(warm_up, "is_kernel_cached", lambda kernel: kernel.__name__ in kept)
    monkeypatch.setattr(warm_up, "load_kernels", lambda: loaded.append("estimate"))
    monkeypatch.setattr(warm_up, "load_rendering", lambda: loaded.append("rendering"))
    warm_up.load_kept_kernels()
    assert ("estimate" in loaded) == ("estimate_motion" in kept)
    assert ("rendering" in loaded) == ({"write_ids", "mark_hsv_pixels"} <= {*kept})


def setup_of_gate(folder: Path) -> RunSetup:
    options = ExpansionOptions(cases=("large",), modes=("sim",))
    plan = load_campaign(ROOT / "campaigns" / "gate.yaml", options).runs[0]
    return RunSetup.of(RunOrder(plan=plan, folder=folder, clock="virtual"))


@pytest.mark.parametrize(
    ("sensor", "is_rendered"),
    [
        (CameraSetup(name="camera", rate_hz=15, intrinsics=CAMERA, mount=CameraMount()), True),
        (DepthSetup(name="depth", rate_hz=15, intrinsics=CAMERA, mount=CameraMount()), True),
        (OtherSensorSetup(kind="rangefinder", name="range", options=RangefinderOptions()), False),
    ],
    ids=["camera", "depth", "range"],
)
def test_rendering_is_loaded_before_the_flight_for_whatever_is_rendered(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, sensor: SensorSetup, is_rendered: bool
) -> None:
    loaded: list[str] = []
    monkeypatch.setattr(warm_up, "load_rendering", lambda: loaded.append("rendering"))
    setup = setup_of_gate(tmp_path)
    (vehicle,) = setup.vehicles
    warm_up.warm_up(replace(setup, vehicles=(replace(vehicle, sensors=(sensor,)),)))
    assert bool(loaded) is is_rendered


@pytest.mark.parametrize(
    "at", [(8.0, 0.0, -1.0), (0.0, 8.0, -1.0), (0.0, 0.0, -1.0)], ids=["north", "east", "around"]
)
def test_the_kernels_that_measure_a_mesh_are_loaded_before_the_flight(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, at: Vec3
) -> None:
    called: set[str] = set()
    kernels: tuple[Any, ...] = (surface_distance, is_swept_beyond)
    for kernel in kernels:

        def watched(*arguments: Any, kernel: Any = kernel) -> Any:
            called.add(kernel.__name__)
            return kernel(*arguments)

        monkeypatch.setattr(f"wil_campaign.worlds.clearance.distance.{kernel.__name__}", watched)
    mesh = box_shape((1.0, 1.0, 1.0)).mesh
    surface = SurfaceShape(mesh.vertices_m, mesh.faces)
    shape = Shape("mesh", mesh, (SolidPart("surface", surface, AT_ORIGIN),))
    scene = Scene((SceneObject(1, "mesh", shape, Pose(at)),))
    warm_up.warm_up(replace(setup_of_gate(tmp_path), virtual_scene=scene))
    assert called == {"surface_distance", "is_swept_beyond"}
