"""Flights that must fail, each for a cause that is known, whatever telemetry says meanwhile.

One is sound, cause "none": it fails by what is done to it alone.

The autonomy flies legs by time alone: no fault of a signal leads the vehicle aside of its cause.
"""

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, get_args

import yaml

from wil_campaign.vehicles.embedded.profile import load_profile

Cause = Literal[
    "wall",
    "table",
    "bar",
    "fence",
    "time",
    "area",
    "altitude",
    "wrong order",
    "around",
    "speed",
    "tilt",
    "battery",
    "estimator",
    "separation",
    "formula",
    "none",
]
CAUSES: tuple[Cause, ...] = get_args(Cause)[:-1]
Mode = Literal["sim", "wil"]
AutopilotKind = Literal["px4", "ardupilot"]
JudgedBy = Literal["mavlink", "mocap", "simulator"]

LEGS = """\
from wil_campaign.vehicles.autonomy import Command
from wil_campaign.vehicles.setpoints import VelocitySetpoint


class Legs:
    '''Flies velocities (north, east, up in m/s), each for some seconds; looks at nothing.'''

    def __init__(self, *, goal, parameters, seed):
        self.left = [
            (north, east, -up) for north, east, up, for_s in parameters["legs"]
            for _ in range(round(for_s * 20))
        ]

    def perceive(self, reading):
        pass

    def act(self, telemetry):
        velocity = self.left.pop(0) if self.left else (0.0, 0.0, 0.0)
        return Command(VelocitySetpoint(velocity), done=not self.left)
"""


@dataclass(frozen=True, slots=True)
class Mission:
    """One flight that must fail.

    expected: what the reason says when nothing disturbs it, a regular expression. keys: what its
    campaign says beside the rest. legs: velocities north, east and up in m/s, each for some
    seconds. capacity_mah: of its vehicles' batteries, None for that of their profiles.
    """

    expected: str
    objects: dict[str, Any]
    keys: dict[str, Any] = field(default_factory=dict)
    oracles: dict[str, Any] = field(default_factory=dict)
    legs: tuple[tuple[float, float, float, float], ...] = ((1.0, 0.0, 0.0, 6.0),)
    capacity_mah: float | None = None


def _box(size_m: list[float], north_m: float, up_m: float) -> dict[str, Any]:
    pose = {"north_m": north_m, "east_m": 0, "up_m": up_m}
    return {"shape": {"box": {"size_m": size_m}}, "pose": pose, "color": "orange"}


def _gate(north_m: float, east_m: float) -> dict[str, Any]:
    pose = {"north_m": north_m, "east_m": east_m, "up_m": 1.2}
    return {"shape": {"gate": {"inner_size_m": 1.4}}, "pose": pose, "color": "orange"}


_FAR = {"wall": _box([0.1, 6, 4], 30.0, 2.0)}
_AREA = {"north_m": [-2, 4], "east_m": [-2, 2], "up_m": [-1, 3]}
_FAST = ((2.2, 0.0, 0.0, 3.0), (0.0, 0.0, 0.0, 2.0))
"""So much above a limit of 1 m/s that no error of a velocity that is not found hides it."""
_TO_AND_FRO = ((2.5, 0.0, 0.0, 1.0), (-2.5, 0.0, 0.0, 1.0)) * 3
_WALKER = {
    "shape": {"box": {"size_m": [0.8, 0.8, 2.5]}},
    "pose": {"north_m": 9.0, "east_m": 1.5, "up_m": 1.25},
    "color": "orange",
    "motion": {
        "start": {"on": "goal"},
        "waypoints": [{"north_m": 1.0, "east_m": 1.5, "up_m": 1.25, "speed_m_s": 1.0}],
    },
}
"""Comes past at 0.9 m."""
MISSIONS: dict[Cause, Mission] = {
    "wall": Mission("touched wall", {"wall": _box([0.1, 6, 4], 3.0, 2.0)}),
    "table": Mission("touched table", {"table": _box([3, 3, 0.6], 6.5, 0.3)}),
    "bar": Mission(
        "touched gate",
        {"gate": _gate(3.0, -0.75)},
        {"goal": {"altitude_m": 1.2, "gates": ["gate"]}},
        {"reached": {}},
    ),
    "fence": Mission(
        "fence",
        _FAR,
        {"geofence": {"box": {"north_m": [-3, 3.5], "east_m": [-4, 4], "up_m": [-1, 4]}}},
        {"geofence": {}},
    ),
    "time": Mission("4", _FAR, {}, {"time_limit": {"limit_s": 4}}),
    "area": Mission("area", _FAR, {}, {"area": {"keep": {"box": _AREA}}}),
    "altitude": Mission("1", _FAR, {}, {"altitude": {"max_m": 1.0}}),
    "wrong order": Mission(
        "second before first|never flew through first",
        {"first": _gate(4.2, 0.0), "second": _gate(2.2, 0.0)},
        {"goal": {"altitude_m": 1.2, "gates": ["first", "second"]}},
        {"reached": {}},
    ),
    "around": Mission(
        "never flew through",
        {"gate": _gate(3.0, 2.2)},
        {"goal": {"altitude_m": 1.2, "gates": ["gate"]}},
        {"reached": {}},
    ),
    "speed": Mission(
        r"flew \d\.\d+ m/s",
        _FAR,
        {},
        {"speed": {"axis": "horizontal", "max_m_s": 1.0}},
        legs=_FAST,
    ),
    "tilt": Mission("had a tilt of", _FAR, {}, {"attitude": {"max_tilt_deg": 6}}, legs=_TO_AND_FRO),
    "battery": Mission(
        "battery at 9",
        _FAR,
        {},
        {"battery": {"min_percent": 97}},
        legs=((0.5, 0.0, 0.0, 10.0),),
        capacity_mah=300.0,
    ),
    "estimator": Mission("no horizontal position", _FAR, {}, {"estimator": {}}),
    "separation": Mission(
        r"was \d\.\d+ m from walker",
        {"walker": _WALKER},
        {},
        {"distance": {"object": "walker", "min_m": 3.0}},
    ),
    "formula": Mission(
        "ground_speed_m_s|distance_wall_m",
        {"wall": _box([0.1, 6, 4], 12.0, 2.0)},
        {},
        {"stl": {"stl": "always (distance_wall_m >= 8 or ground_speed_m_s <= 1)"}},
        legs=_FAST,
    ),
    "none": Mission(
        "",
        _FAR,
        {"geofence": {"box": {"north_m": [-2, 9], "east_m": [-1.5, 1.5], "up_m": [-1, 4]}}},
        {"geofence": {}},
    ),
}

_WIDE_BAR = Mission(
    "touched gate",
    {
        "gate": {
            "shape": {"gate": {"inner_size_m": 1.4, "bar_m": 0.9}},
            "pose": {"north_m": 3.0, "east_m": -1.15, "up_m": 1.8},
            "color": "orange",
        }
    },
    {"goal": {"altitude_m": 1.8, "gates": ["gate"]}},
    {"reached": {}},
)
"""Of the pair: the real vehicle, flown by time alone, drifts by up to 0.4 m before the gate."""


def mission_of(cause: Cause, mode: Mode) -> Mission:
    """Return the mission that fails for a cause in a mode."""
    return _WIDE_BAR if (cause, mode) == ("bar", "wil") else MISSIONS[cause]


def write_mission(
    folder: Path,
    cause: Cause,
    *,
    mode: Mode = "sim",
    autopilot: AutopilotKind = "px4",
    judged_by: JudgedBy = "mavlink",
    keys: dict[str, Any] | None = None,
) -> Path:
    """Write a mission's files into a folder; return its campaign. keys: what else it says."""
    mission = mission_of(cause, mode)
    vehicle = {"link": "embedded", "autopilot": autopilot, "pose_source": judged_by}
    campaign: dict[str, Any] = {
        "schema": "wil/campaign/1",
        "campaign": re.sub(r"\W", "-", cause),
        "vehicles": {"twin": vehicle},
        "world": "world.yaml",
        "autonomy": {"use": "legs.py:Legs", "with": {"legs": [list(leg) for leg in mission.legs]}},
        "goal": {"altitude_m": 1.2},
        "modes": [mode],
        "oracles": {"landed": {}, "vehicle_fault": {}, "battery": {"min_percent": 10}},
    }
    if mode == "wil":
        camera = {"type": "camera", "rate_hz": 10, "width_px": 96, "height_px": 72, "fov_deg": 69}
        sensors = {"camera": camera}
        twin = {"link": "embedded", "autopilot": "px4", "sensors": sensors}
        # The heading that `cage` estimates is off by a degree, as many as the mixture may be off.
        profile = "cage" if judged_by == "mocap" else "nominal"
        campaign["vehicles"] = {
            "real": {**vehicle, "profile": profile, "sensors": sensors},
            "twin": twin,
        }
        campaign["recipe"] = "recipe.yaml"
        # The mixture is judged in flight; nobody looks at the pictures of a thousand flights.
        campaign["record"] = {"pictures": "none"}
        (folder / "recipe.yaml").write_text(yaml.safe_dump(_recipe(mission)))
    if mission.capacity_mah is not None:
        for given in campaign["vehicles"].values():
            given["profile"] = write_profile(folder, given.get("profile", "nominal"), mission).name
    campaign.update(mission.keys)
    campaign["oracles"] = {**campaign["oracles"], **mission.oracles}
    campaign.update(keys or {})
    world = {
        "schema": "wil/world/1",
        "origin": {"latitude_deg": 47.4, "longitude_deg": 8.5},
        "objects": mission.objects,
    }
    (folder / "world.yaml").write_text(yaml.safe_dump(world))
    (folder / "legs.py").write_text(LEGS)
    path = folder / "campaign.yaml"
    path.write_text(yaml.safe_dump(campaign, sort_keys=False))
    return path


def write_profile(folder: Path, name: str, mission: Mission) -> Path:
    """Write a profile with the battery of a mission into a folder; return its file."""
    given = load_profile(name).model_dump(mode="json", by_alias=True)
    given["battery"]["capacity_mah"] = mission.capacity_mah
    path = folder / f"{name}-battery.yaml"
    path.write_text(yaml.safe_dump(given))
    return path


def _recipe(mission: Mission) -> dict[str, Any]:
    register = {"register": {"pose": "real", "align": "interpolate"}}
    return {
        "schema": "wil/recipe/1",
        "sensors": {"camera": {"type": "camera", "rate_hz": 10}},
        "combine": [
            {
                "sensor": "camera",
                "transform": [{"resize": {"to": "real"}}, register],
                "filter": [{"isolate_objects": list(mission.objects)}],
                "merge": {"overlay": {"priority": ["twin", "real"]}},
                "publish": ["real", "twin"],
                "max_skew_ms": 60,
            }
        ],
    }
