"""What takes its time once in a process is done before the loop runs, not in flight.

Compiled kernels are loaded, or compiled, at their first call, with the interpreter's lock held
for most of a second: the guard would take that for an orchestrator that is dead. On a machine that
has nothing kept and much to do it takes minutes: the pool would take that for a worker that hangs.
"""

import math

import numpy as np

from campaigns.values.sensor_setups import LidarPointsSetup
from orchestrator.state.run_setup import RunSetup
from recipes.visibility.ranges import nearest_m
from vehicles.embedded.control.law import load_kernels
from vehicles.embedded.physics.contact_world import BODY
from vehicles.perception.hsv import NAMED_COLORS, HsvMask
from worlds.camera import Intrinsics
from worlds.clearance.clearance import ClearanceProbe
from worlds.frames import Pose
from worlds.render.renderer import Renderer

_FAR_M = 1000.0
_SMALL = Intrinsics.from_fov(64, 48, math.radians(60.0))


def warm_up(setup: RunSetup) -> None:
    """Warm up before the flight: compile control laws, clearance, rendering, search for colours.

    Where there are clouds of points, the search for the nearest point is imported.
    """
    if any(vehicle.embedded for vehicle in setup.vehicles):
        load_kernels()
    probe = ClearanceProbe(setup.judged_scene, BODY, within_m=_FAR_M)
    probe.sweep(Pose((0.0, 0.0, -1.0)), 0.0, Pose((0.1, 0.0, -1.0)), 0.1)
    if any(vehicle.cameras for vehicle in setup.vehicles):
        for scene in (setup.real_scene, setup.virtual_scene):
            renderer = Renderer(scene)
            for ids in (False, True):
                seen = renderer.render(Pose((0.0, 0.0, -1.0)), _SMALL, 0.0, {}, want_ids=ids)
        HsvMask(NAMED_COLORS["orange"]).of(seen.image_bgr)
    sensors = [sensor for vehicle in setup.with_sensors for sensor in vehicle.sensors]
    if any(isinstance(sensor, LidarPointsSetup) for sensor in sensors):
        nearest_m(np.zeros((1, 3)), np.zeros((1, 3), np.float32))
