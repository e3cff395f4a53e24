"""A campaign whose vehicle flies straight on, through a wall of the virtual world."""

from pathlib import Path

CAMPAIGN = """\
schema: wil/campaign/1
campaign: wall
vehicles: {twin: {link: embedded, autopilot: ardupilot}}
world: world.yaml
autonomy: {use: straight.py:Straight, with: {speed_m_s: 1.0, for_s: 6}}
goal: {altitude_m: 1.2}
modes: [sim]
oracles: {landed: {}}
"""
WORLD = """\
schema: wil/world/1
origin: {latitude_deg: 47.4, longitude_deg: 8.5}
objects:
  wall:
    shape: {box: {size_m: [0.1, 6, 4]}}
    pose: {north_m: 3.0, east_m: 0, up_m: 2.0}
"""
STRAIGHT = """\
from wil_campaign.vehicles.autonomy import Command
from wil_campaign.vehicles.setpoints import VelocitySetpoint


class Straight:
    def __init__(self, *, goal, parameters, seed):
        self.speed_m_s = parameters["speed_m_s"]
        self.ticks = parameters["for_s"] * 20

    def perceive(self, reading):
        pass

    def act(self, telemetry):
        self.ticks -= 1
        return Command(VelocitySetpoint((self.speed_m_s, 0.0, 0.0)), done=self.ticks <= 0)
"""


def write_wall(folder: Path) -> Path:
    """Write the campaign's files, and return the campaign's."""
    (folder / "world.yaml").write_text(WORLD)
    (folder / "straight.py").write_text(STRAIGHT)
    path = folder / "wall.yaml"
    path.write_text(CAMPAIGN)
    return path
