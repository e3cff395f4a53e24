"""Autonomies that do the wrong thing, flown as users fly: none passes, and each reason says why.

One that does it right flies among them, so that a campaign that fails whatever flies would show.
"""

import json
from pathlib import Path

import pytest

from wil_campaign.orchestrator.cli import main

CAMPAIGN = """\
schema: wil/campaign/1
campaign: wrong
vehicles: {twin: {link: embedded, autopilot: px4}}
world: world.yaml
autonomy: {use: path.py:Path, with: {path: [[2, 1.5, 1.5], [7.6, 1.5, 1.5]]}}
goal: {altitude_m: 1.5, gates: [first, second]}
cases:
  right: {}
  blind: {autonomy.with.path: [[8, 0, 1.5]]}
  around: {autonomy.with.path: [[2, 1.5, 1.5], [2, 3.2, 1.5], [7.6, 3.2, 1.5]]}
  over: {autonomy.with.path: [[2, 1.5, 1.5], [2, 1.5, 3], [7.6, 1.5, 3]]}
  backwards: {autonomy.with.path: [[2, 3.2, 1.5], [7.6, 3.2, 1.5], [7.6, 1.5, 1.5], [2, 1.5, 1.5]]}
  disordered:
    autonomy.with.path:
      [[2, 3.2, 1.5], [4.5, 3.2, 1.5], [4.5, 1.5, 1.5], [7.6, 1.5, 1.5], [7.6, 3.2, 1.5],
       [1.8, 3.2, 1.5], [1.8, 1.5, 1.5], [4.5, 1.5, 1.5]]
  dip:
    autonomy.with.path:
      [[2, 1.5, 1.5], [3.12, 1.5, 1.5], [2, 1.5, 1.5], [2, 3.2, 1.5], [4.5, 3.2, 1.5],
       [4.5, 1.5, 1.5], [7.6, 1.5, 1.5]]
  clip: {autonomy.with.path: [[2, 2.0, 1.5], [7.6, 2.0, 1.5]]}
  fast: {autonomy.with.speed_m_s: 3.5}
modes: [sim]
oracles:
  collision: {}
  reached: {}
  speed: {max_m_s: 1.8, axis: horizontal}
  time_limit: {limit_s: 60}
  landed: {}
"""
WORLD = """\
schema: wil/world/1
origin: {latitude_deg: 47.4, longitude_deg: 8.5}
objects:
  hall: {shape: {room: {size_north_m: 16, size_east_m: 10, height_m: 5}}, pose: {north_m: 4}}
  first: {shape: {gate: {inner_size_m: 1.0}}, pose: {north_m: 3, east_m: 1.5, up_m: 1.5}}
  second: {shape: {gate: {inner_size_m: 1.0}}, pose: {north_m: 6, east_m: 1.5, up_m: 1.5}}
"""
AUTONOMY = """\
import math

from wil_campaign.vehicles.autonomy import Command
from wil_campaign.vehicles.setpoints import VelocitySetpoint


class Path:
    '''Flies from point to point (north, east, up), so slowly that it stops; done at the last.'''

    def __init__(self, *, goal, parameters, seed):
        self.left = [(n, e, -u) for n, e, u in parameters["path"]]
        self.speed_m_s = parameters.get("speed_m_s", 1.0)

    def perceive(self, reading):
        pass

    def act(self, telemetry):
        here = telemetry.pose.position_ned_m
        way = [b - a for a, b in zip(here, self.left[0])]
        far_m = math.hypot(*way)
        done = len(self.left) == 1 and far_m < 0.15
        if far_m < 0.12 and len(self.left) > 1:
            self.left.pop(0)
        speed_m_s = min(self.speed_m_s, 0.8 * far_m)
        velocity = tuple(speed_m_s * each / far_m for each in way) if far_m else (0.0, 0.0, 0.0)
        note = f"{len(self.left)} to go"
        return Command(VelocitySetpoint(velocity, yaw_rad=0.0), done=done, note=note)
"""

EXPECTED = {
    "blind": ("reached/twin", "never flew through first (0 of 2 gates); passed 1.5"),
    "around": ("reached/twin", "never flew through first (0 of 2 gates); passed 1."),
    "over": ("reached/twin", "never flew through first (0 of 2 gates); passed 1."),
    "backwards": ("reached/twin", "flew through first the wrong way"),
    "disordered": ("reached/twin", "(1 of 2 gates); flew through second before first"),
    "dip": ("reached/twin", "and came back"),
    "clip": ("collision/twin", "twin touched first.right"),
    "fast": ("speed/twin", "m/s"),
}
"""Of each wrong autonomy what decides, and a part of the reason."""


@pytest.mark.usefixtures("forked_workers")
def test_the_right_one_passes_and_each_wrong_one_fails_by_the_right_oracle(tmp_path: Path) -> None:
    """All are flown by one campaign."""
    (tmp_path / "campaign.yaml").write_text(CAMPAIGN)
    (tmp_path / "world.yaml").write_text(WORLD)
    (tmp_path / "path.py").write_text(AUTONOMY)
    assert main(["run", str(tmp_path / "campaign.yaml"), "--out", str(tmp_path / "out")]) == 1
    (path,) = (tmp_path / "out" / "wrong").glob("*/summary.json")
    runs = {run["case"]: run for run in json.loads(path.read_text("utf-8"))["runs"]}
    assert runs.keys() == {"right", *EXPECTED}
    right = runs.pop("right")
    assert (right["verdict"], right["reason"]) == ("PASS", "")
    for case, run in runs.items():
        source, text = EXPECTED[case]
        assert (run["verdict"], run["decided_by"]) == ("FAIL", source), (case, run["reason"])
        assert text in run["reason"], case
        assert run["reason"].endswith("to go'"), f"{case}: the autonomy's last note is missing"
