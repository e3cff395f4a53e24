"""A small campaign that is good, to be spoilt one place at a time."""

from pathlib import Path

import pytest

from wil_campaign.campaigns.expansion.expansion import Campaign, ExpansionOptions, load_campaign
from wil_campaign.foundation.files.documents import BadInput

CAMPAIGN = """\
schema: wil/campaign/1
campaign: small
vehicles:
  real:
    link: embedded
    autopilot: px4
    profile: cage
    start: {north_m: 0, east_m: 0}
    pose_source: mocap
    sensors:
      camera: {type: camera, rate_hz: 15, width_px: 320, height_px: 240, fov_deg: 69}
  twin:
    link: embedded
    autopilot: ardupilot
    sensors:
      camera: {type: camera, rate_hz: 15, width_px: 320, height_px: 240, fov_deg: 69}
world: world.yaml
recipe: recipe.yaml
autonomy: {use: pilot.py:Pilot, with: {speed_m_s: 0.8}}
goal: {altitude_m: 1.2, gates: [gate]}
cases:
  large: {}
  small: {world.objects.gate.shape.gate.inner_size_m: 0.5}
modes: [sim, wil]
repetitions: 3
seed: 7
geofence:
  box: {north_m: [-1, 4], east_m: [-2, 2], up_m: [-0.5, 2.3]}
oracles:
  collision: {}
  reached: {}
  time_limit: {limit_s: 40}
  geofence:
accept: {large: {sim: 3/3, wil: 2/3}}
"""

WORLD = """\
schema: wil/world/1
origin: {latitude_deg: 47.4, longitude_deg: 8.5, altitude_m: 488}
objects:
  cage:
    shape: {room: {size_north_m: 6, size_east_m: 6, height_m: 2.5}}
    pose: {north_m: 1.5}
  gate:
    shape: {gate: {inner_size_m: 1.0, bar_m: 0.1}}
    pose: {north_m: 3.0, up_m: 1.2}
    color: orange
"""

RECIPE = """\
schema: wil/recipe/1
sensors: {camera: {type: camera, rate_hz: 15}}
combine:
  - sensor: camera
    filter: [{isolate_objects: [gate]}]
    merge: {overlay: {priority: [twin, real]}}
"""

PILOT = """\
class Pilot:
    def __init__(self, *, goal, parameters, seed):
        if set(parameters) - {"speed_m_s"}:
            raise ValueError(f"unknown parameters {sorted(parameters)}")
        self.goal = goal

    def perceive(self, reading):
        pass

    def act(self, telemetry):
        raise NotImplementedError


class Wrong:
    def __init__(self, goal):
        pass

    def perceive(self, reading):
        pass

    def act(self, telemetry):
        pass


class Deaf:
    def act(self, telemetry):
        pass


class Broken(Pilot):
    def __init__(self, *, goal, parameters, seed):
        raise KeyError("speed")
"""


class Files:
    """The four files in a folder, to be changed before they are loaded."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.path = folder / "campaign.yaml"
        for name, text in {
            "campaign.yaml": CAMPAIGN,
            "world.yaml": WORLD,
            "recipe.yaml": RECIPE,
            "pilot.py": PILOT,
        }.items():
            (folder / name).write_text(text)

    def change(self, old: str, new: str, file: str = "campaign.yaml") -> None:
        path = self.folder / file
        text = path.read_text()
        assert text.count(old) == 1, f"{old!r} stands {text.count(old)} times in {file}"
        path.write_text(text.replace(old, new))

    def append(self, text: str, file: str = "campaign.yaml") -> None:
        with (self.folder / file).open("a") as stream:
            stream.write(text)

    def load(self, **options: object) -> Campaign:
        return load_campaign(self.path, ExpansionOptions(**options))  # type: ignore[arg-type]  # a test's short form

    def faults(self, **options: object) -> list[str]:
        with pytest.raises(BadInput) as caught:
            self.load(**options)
        return [p.headline.removeprefix(f"{self.folder}/") for p in caught.value.problems]


@pytest.fixture
def files(tmp_path: Path) -> Files:
    return Files(tmp_path)
