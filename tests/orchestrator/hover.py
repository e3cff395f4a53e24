"""A campaign of flights that take a second or two each: up, and down."""

from pathlib import Path

CAMPAIGN = """\
schema: wil/campaign/1
campaign: hover
vehicles: {twin: {link: embedded, autopilot: px4}}
world: world.yaml
autonomy: still.py:Still
goal: {altitude_m: 1.2}
modes: [sim]
repetitions: 2
oracles: {landed: {}}
"""
WORLD = "schema: wil/world/1\norigin: {latitude_deg: 47.4, longitude_deg: 8.5}\n"
STILL = """\
from wil_campaign.vehicles.autonomy import Command
from wil_campaign.vehicles.setpoints import VelocitySetpoint

COUNT = []


class Still:
    def __init__(self, *, goal, parameters, seed):
        self.ticks = parameters.get("ticks", 1)

    def perceive(self, reading):
        pass

    def act(self, telemetry):
        COUNT.append(1)
        self.ticks -= 1
        note = f"{len(COUNT)} by now"
        return Command(VelocitySetpoint((0.0, 0.0, 0.0)), done=self.ticks <= 0, note=note)
"""


def write_hover(folder: Path, *, waits_for: Path | None = None) -> Path:
    """Write the campaign's files, and return the campaign's.

    waits_for: a file for which each flight waits in the air, so that none has ended before a test
    acts on it.
    """
    (folder / "world.yaml").write_text(WORLD)
    source = STILL
    if waits_for is not None:
        head, act, tail = STILL.partition("        COUNT.append(1)\n")
        imports = "import time\nfrom pathlib import Path\n\n"
        wait = f"        while not Path({str(waits_for)!r}).exists():\n"
        source = f"{imports}{head}{act}{wait}            time.sleep(0.01)\n{tail}"
    (folder / "still.py").write_text(source)
    path = folder / "hover.yaml"
    path.write_text(CAMPAIGN)
    return path
