"""The facts of a run at the beginning of run.mcap, by which its readings can be mixed again."""

import json
import re
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wil_campaign.foundation.files.documents import Data, parse_document
from wil_campaign.foundation.files.problems import without_passwords
from wil_campaign.orchestrator.installation import flown_program
from wil_campaign.orchestrator.recording.mcap.mcap_settings import ImageSettings
from wil_campaign.recipes.language.recipe_document import load_recipe
from wil_campaign.recipes.model.recipe import Recipe
from wil_campaign.safety.fence.fence_values import fence_of_plain, plain_fence
from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.worlds.camera import CameraMount
from wil_campaign.worlds.frames import Pose
from wil_campaign.worlds.scene.scene import Scene
from wil_campaign.worlds.world_file.world import World

if TYPE_CHECKING:  # readers of a recording do not load the code that flies
    from wil_campaign.orchestrator.state.run_setup import RunSetup


def facts_of_run(setup: "RunSetup") -> dict[str, str]:
    """Return a run's facts for its recording: its name, files as flown, ids of its objects.

    Files are recorded with the overrides of the case and of the command line.
    """
    plan = setup.order.plan
    facts = {
        "case": plan.case,
        "mode": plan.mode,
        "rep": str(plan.repetition),
        "seed": str(plan.seed),
        "objects": json.dumps(setup.case.world.object_ids),
        "campaign": without_passwords(json.dumps(plan.files.campaign.data, default=str)),
        "fences": json.dumps(
            {vehicle: plain_fence(fence) for vehicle, fence in setup.case.fences.items()}
        ),
    }
    if plan.files.world is not None:
        facts["world"] = json.dumps(plan.files.world.data, default=str)
        facts["world_file"] = str(setup.order.own_path(plan.files.world.path))
    if any(camera.source is None for one in setup.with_sensors for camera in one.cameras):
        # By these a reader says why it cannot draw an image again.
        facts["program"] = flown_program()
        facts["shapes_real"] = scene_digest(setup.real_scene)
        facts["shapes_twin"] = scene_digest(setup.virtual_scene)
    latencies = {
        f"{vehicle.name} {camera.name}": camera.source.latency_s
        for vehicle in setup.with_sensors
        for camera in vehicle.cameras
        if camera.source is not None
    }
    if latencies:
        facts["latency_s"] = json.dumps(latencies)
    mounts = {
        f"{vehicle.name}/{sensor.name}": asdict(mount)
        for vehicle in setup.with_sensors
        for sensor in vehicle.sensors
        if isinstance(mount := getattr(sensor, "mount", None), CameraMount)
    }
    if mounts:
        facts["mounts"] = json.dumps(mounts)
    recipe = setup.case.recipe
    if recipe is not None and plan.mode == "wil":
        # JSON is YAML: the recipe as it was flown, with the overrides of the case.
        facts["recipe"] = json.dumps(recipe.document.data)
        facts["recipe_file"] = str(setup.order.own_path(recipe.document.path))
    return facts


def scene_digest(scene: Scene) -> str:
    """Return a digest of the shapes of a scene, with their textures."""
    digest = 0
    for body in scene.bodies:
        digest = body.shape.mesh.crc32(digest)
    return f"{digest:08x}"


def recipe_in(facts: Mapping[str, str], *, loads_code: bool) -> Recipe | None:
    """Return the recipe in a recording's facts; None where nothing was mixed. Raises BadInput.

    loads_code: whether the user's steps that it names are loaded; False: no user code runs.
    """
    text = facts.get("recipe")
    if text is None:
        return None
    file = facts.get("recipe_file", "recipe.yaml")
    name = f"{file} (as recorded)"
    document = parse_document(_as_yaml(text), name=name, path=Path(file))
    return load_recipe(document, loads_code=loads_code)


def world_in(facts: Mapping[str, str]) -> World | None:
    """Return a recording's world as flown; None in older recordings. Raises BadInput."""
    text = facts.get("world")
    if text is None:
        return None
    file = facts.get("world_file", "world.yaml")
    return World.parse(
        parse_document(_as_yaml(text), name=f"{file} (as recorded)", path=Path(file))
    )


_PAIR = re.compile(r"(?<!\\)((?:\\\\)*)\\u(d[89ab][0-9a-f]{2})\\u(d[c-f][0-9a-f]{2})")
"""A character beyond the first 65536, as JSON writes it; not after an odd backslash."""


def _as_yaml(text: str) -> bytes:
    """Return a document in JSON as YAML, which has other words for an emoji alone."""

    def joined(pair: re.Match[str]) -> str:
        high, low = int(pair[2], 16), int(pair[3], 16)
        return f"{pair[1]}\\U{0x10000 + ((high - 0xD800) << 10) + low - 0xDC00:08x}"

    return _PAIR.sub(joined, text).encode()


def campaign_in(facts: Mapping[str, str]) -> dict[str, Data]:
    """Return a recording's campaign file as flown; empty in older recordings."""
    found: dict[str, Data] = json.loads(facts.get("campaign", "{}"))
    return found


def quality_in(facts: Mapping[str, str]) -> int:
    """Return the quality of a recording's JPEG images."""
    record = campaign_in(facts).get("record")
    quality = record.get("quality") if isinstance(record, dict) else None
    return quality if isinstance(quality, int) else ImageSettings().quality


def fences_in(facts: Mapping[str, str]) -> dict[str, Fence]:
    """Return a recording's fences by vehicle, as at the start. Raises FenceError, ValueError."""
    found = json.loads(facts.get("fences", "{}"))
    return {vehicle: fence_of_plain(plain) for vehicle, plain in found.items()}


def latencies_in(facts: Mapping[str, str]) -> dict[str, float]:
    """Return a recording's camera latencies by vehicle and camera, as subtracted in flight."""
    found: dict[str, float] = json.loads(facts.get("latency_s", "{}"))
    return found


def mounts_in(facts: Mapping[str, str]) -> dict[str, CameraMount]:
    """Return the mounts of a recording's cameras by vehicle and camera, as "real/camera"."""
    found = json.loads(facts.get("mounts", "{}"))
    return {frame: _mount_of(mount) for frame, mount in found.items()}


def _mount_of(mount: dict[str, Any]) -> CameraMount:
    x_m, y_m, z_m = mount["pose"]["position_ned_m"]
    w, x, y, z = mount["pose"]["q_wxyz"]
    return CameraMount(Pose((x_m, y_m, z_m), (w, x, y, z)), mount["stabilized"])


def objects_in(facts: Mapping[str, str]) -> dict[str, int]:
    """Return the object ids in a recording's facts."""
    found: dict[str, int] = json.loads(facts.get("objects", "{}"))
    return found
