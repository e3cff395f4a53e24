"""Loads compiled kernels before the flight, so that none is compiled or loaded during it.

The first call of a kernel holds the interpreter's lock for most of a second: the guard would take
that for a dead orchestrator. On a busy machine without a compilation cache it takes minutes: the
pool would take that for a hanging worker.
"""

import math
from functools import cache

from wil_campaign.campaigns.values.sensor_setups import CameraSetup, DepthSetup
from wil_campaign.orchestrator.run.perception.visibility import visibility_comparison_of
from wil_campaign.orchestrator.state.run_setup import RunSetup
from wil_campaign.vehicles.embedded.emulations import load_kernels
from wil_campaign.vehicles.embedded.physics.contact_world import BODY
from wil_campaign.vehicles.embedded.physics.motion_kernel import estimate_motion
from wil_campaign.vehicles.perception.hsv import NAMED_COLORS, HsvMask
from wil_campaign.vehicles.perception.hsv_kernel import mark_hsv_pixels
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.clearance.clearance import ClearanceProbe
from wil_campaign.worlds.frames import Pose
from wil_campaign.worlds.jit import is_kernel_cached
from wil_campaign.worlds.render.renderer import Renderer
from wil_campaign.worlds.render.shading import write_ids
from wil_campaign.worlds.scene.scene import Scene

_FAR_M = 1000.0
_SMALL = Intrinsics.from_fov(64, 48, math.radians(60.0))


def load_kept_kernels() -> None:
    """Load the kernels in this machine's compilation cache, and compile none.

    The run server calls it before it forks: half a second less for each run. Missing kernels are
    compiled by the run, which can be aborted meanwhile.
    """
    if is_kernel_cached(estimate_motion):
        load_kernels()
    if is_kernel_cached(write_ids) and is_kernel_cached(mark_hsv_pixels):
        load_rendering()


def warm_up(setup: RunSetup) -> None:
    """Warm up before the flight: control laws, clearance, rendering, colour search.

    And what the comparison of the sensors' mixtures with geometry takes.
    """
    if any(vehicle.embedded for vehicle in setup.vehicles):
        load_kernels()
    probe = ClearanceProbe(setup.judged_scene, BODY, within_m=_FAR_M)
    probe.load_kernels()
    probe.sweep(Pose((0.0, 0.0, -1.0)), 0.0, Pose((0.1, 0.0, -1.0)), 0.1)
    sensors = [sensor for vehicle in setup.with_sensors for sensor in vehicle.sensors]
    if any(isinstance(sensor, CameraSetup | DepthSetup) for sensor in sensors):
        load_rendering()
    for kind in sorted({sensor.kind for sensor in sensors}):
        if (comparison := visibility_comparison_of(kind)) is not None:
            comparison.warm_up()


@cache
def load_rendering() -> None:
    """Load or compile the kernels of rendering and of the colour search, once.

    An empty scene serves: kernels are compiled for the types of their arguments.
    """
    renderer = Renderer(Scene(()))
    for ids in (False, True):
        seen = renderer.render(Pose((0.0, 0.0, -1.0)), _SMALL, 0.0, {}, want_ids=ids)
    HsvMask(NAMED_COLORS["orange"]).of(seen.image_bgr)
