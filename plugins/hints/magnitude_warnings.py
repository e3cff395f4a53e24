"""Warnings of numbers that were probably typed in another unit, or for another drone; pure."""

import math
from collections.abc import Iterator
from itertools import chain

import numpy as np

from wil_campaign.campaigns.setup.case_files import CaseFiles
from wil_campaign.campaigns.setup.case_setup import Case
from wil_campaign.foundation.files.documents import BadInput, Document, Path, Problem
from wil_campaign.foundation.files.yaml_nodes import YamlNode
from wil_campaign.vehicles.embedded.profile import Profile, ProfileError, load_profile
from wil_campaign.worlds.scene.scene import SceneObject

_LEAST_FOV_DEG = 4.0
"""Below it a lens is a telescope's; pi and less are fields of view in radians."""
_LARGE_M, _HIGH_M, _SMALL_M = 100.0, 50.0, 0.02
"""A mesh larger and higher than a tall building, or smaller than a screw, has another unit."""
_AWAY_M = 1000.0
"""A mesh whose nearest point is farther from its own origin has the coordinates of a map."""
_WIDER = 1.25
"""An opening so many times as wide as its whole mesh has another unit."""
_VAST_M, _TALL_M = 1000.0, 200.0
"""No room, gate or box of a world is: a metre in millimetres is."""
_LEAST_V, _MOST_V = 3.0, 100.0
"""One lithium cell nearly empty, and more than the 14 cells in series of the largest drones."""
_LEAST_HOVER_MIN, _MOST_HOVER_MIN = 1.0, 300.0
_LATE_S = 2.0
"""No camera, motion capture or motor is later: a delay in milliseconds is."""
_FARTHEST = (("_m_s", 1e3), ("_m", 1e5), ("_s", 86_400.0))
"""No drone is so fast, flies so far or for so long, by the end of an oracle's key."""
_LATE = (
    *(("camera", key) for key in ("latency_s", "jitter_s", "exposure_s")),
    *(("mocap", "latency_s"), ("motors", "lag_s")),
)


def magnitude_warnings(files: CaseFiles, case: Case) -> Iterator[Problem]:
    """Yield a warning for each number of a case that is outside what such a thing has."""
    file = files.campaign
    seen: set[str] = set()
    for document in filter(None, (files.of_case, files.world, files.recipe)):
        yield from _degrees_as_radians(document, document.root, ())
    for use in case.oracles:
        yield from _vast_limits(file, ("oracles", use.name))
    for name, vehicle in case.vehicles.items():
        at: Path = ("vehicles", name)
        for sensor in vehicle.sensors:
            yield from _narrow_views(file, (*at, "sensors", sensor.name, "fov_deg"), seen)
        profile = _profile_of(vehicle.profile) if vehicle.embedded else None
        if profile is not None and vehicle.profile not in seen:
            seen.add(vehicle.profile)
            for text in _profile_texts(profile):
                yield file.problem((*at, "profile"), text)
        if profile is not None and profile.airframe is not None and file.get((*at, "body")):
            width_m, span_m = 2.0 * vehicle.body.half_m[0], profile.airframe.motor_span_m
            if span_m > width_m:
                message = f"a body {width_m:g} m wide, but its motors alone span {span_m:.2f} m"
                yield file.problem((*at, "body"), message)
    if files.world is not None:
        things = [placed.scene_object for placed in case.world.placed]
        yield from chain.from_iterable(_odd_sizes(files.world, thing) for thing in things)


def _vast_limits(file: Document, path: Path) -> Iterator[Problem]:
    """Yield a warning for each limit of an oracle that no flight comes near."""
    given = file.get(path)
    for key, value in given.items() if isinstance(given, dict) else ():
        most = next((most for end, most in _FARTHEST if key.endswith(end)), math.inf)
        if isinstance(value, int | float) and abs(value) > most:
            text = f"{value:g} is farther, faster or longer than any drone flies"
            yield file.problem((*path, key), f"{text}: no flight decides it")


def _profile_of(name: str) -> Profile | None:
    try:
        return load_profile(name)
    except (ProfileError, BadInput):
        return None  # a problem of the campaign


def _narrow_views(file: Document, path: Path, seen: set[str]) -> Iterator[Problem]:
    fov_deg = file.get(path)
    if not isinstance(fov_deg, int | float) or fov_deg >= _LEAST_FOV_DEG:
        return
    problem = file.problem(
        path,
        f"a field of view of {fov_deg:g} degrees is a telescope's: in radians it would be "
        f"{math.degrees(fov_deg):.0f} degrees",
    )
    if problem.headline not in seen:  # two vehicles with one anchor
        seen.add(problem.headline)
        yield problem


def _profile_texts(profile: Profile) -> Iterator[str]:
    """Yield in words what of a profile no such drone has."""
    if profile.airframe is not None:
        yield from profile.airframe.unusual()
    battery = profile.battery
    if not _LEAST_V <= battery.full_v <= _MOST_V:
        yield f"battery.full_v of {battery.full_v:g} V: one cell has 4.2 V, large drones 60 V"
    hover_min = battery.capacity_mah / 1000.0 / battery.hover_current_a * 60.0
    if not _LEAST_HOVER_MIN <= hover_min <= _MOST_HOVER_MIN:
        yield (
            f"battery.capacity_mah of {battery.capacity_mah:g} mAh lasts for {hover_min:.2g} min "
            f"at battery.hover_current_a of {battery.hover_current_a:g} A"
        )
    for part, key in _LATE:
        value_s: float = getattr(getattr(profile, part), key)
        if value_s > _LATE_S:
            yield f"{part}.{key} of {value_s:g} s: milliseconds would be {value_s / 1000.0:g}"


def _degrees_as_radians(file: Document, node: YamlNode, path: Path) -> Iterator[Problem]:
    """Yield a warning for each angle in radians that is more than a turn, at any depth."""
    value = node.value
    if isinstance(value, dict):
        for key, entry in value.items():
            yield from _degrees_as_radians(file, entry.node, (*path, key))
    elif isinstance(value, tuple):
        for index, item in enumerate(value):
            yield from _degrees_as_radians(file, item, (*path, index))
    elif isinstance(value, int | float) and abs(value) > 2.0 * math.pi:
        named = next((key for key in reversed(path) if isinstance(key, str)), "")
        if named.endswith("_rad"):
            turned = f"{value:g} radians are {value / math.tau:.3g} turns"
            yield file.problem(path, f"{turned}: as degrees it is {math.radians(value):.4g} rad")


def _odd_sizes(file: Document, thing: SceneObject) -> Iterator[Problem]:
    """Yield a warning for an object whose lengths are probably in another unit."""
    shape = file.get(("objects", thing.name, "shape"))
    if not isinstance(shape, dict):
        return
    (kind,) = shape
    path: Path = ("objects", thing.name, "shape", kind)
    spans = [float(span) for span in np.ptp(thing.shape.mesh.vertices_m, axis=0)]
    size = " x ".join(f"{span:.3g}" for span in spans)
    if kind != "mesh":
        if max(spans) > _VAST_M and spans[2] > _TALL_M:
            yield file.problem(path, f"is {size} m large: lengths are in metres", key=True)
    elif max(spans) > _LARGE_M and spans[2] > _HIGH_M:
        text = f"is {size} m large: if its file is in millimetres, set scale: 0.001"
        yield file.problem(path, text, key=True)
    elif max(spans) < _SMALL_M:
        text = f"is {size} m small: if its file is in metres, leave `scale` out"
        yield file.problem(path, text, key=True)
    corners_m = thing.shape.mesh.vertices_m
    away_m = float(np.linalg.norm(np.clip(0.0, corners_m.min(axis=0), corners_m.max(axis=0))))
    if kind == "mesh" and away_m > _AWAY_M:
        text = f"begins {away_m:.3g} m from the origin of its file, which is what `pose` places"
        yield file.problem(path, f"{text}: move its corners to the origin", key=True)
    for opening in thing.shape.openings if kind == "mesh" else ():
        across = max((float(span) for span in np.ptp(opening.corners_m, axis=0)), default=0.0)
        if across > _WIDER * max(spans):
            text = f"is {across:.3g} m across, and its mesh {max(spans):.3g} m: what flies past it"
            yield file.problem((*path, "opening"), f"{text} is through; lengths are in metres")
