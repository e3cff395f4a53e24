"""The campaign of short flights that the benches of a cluster fly, and what its runs leave."""

import json
from pathlib import Path

WORLD = "schema: wil/world/1\norigin: {latitude_deg: 47.4, longitude_deg: 8.5}\n"
CAMPAIGN = """\
schema: wil/campaign/1
campaign: hover
vehicles: {twin: {link: embedded, autopilot: px4}}
world: world.yaml
autonomy: {use: wait, with: {}}
goal: {altitude_m: 1.2}
modes: [sim]
oracles: {landed: {}}
"""
STILL = """\
import time

from wil_campaign.vehicles.autonomy import Command
from wil_campaign.vehicles.setpoints import VelocitySetpoint


class Still:
    def __init__(self, *, goal, parameters, seed):
        self.ticks = parameters.get("ticks", 1)

    def perceive(self, reading):
        pass

    def act(self, telemetry):
        self.ticks -= 1
        if self.ticks == 0:
            print(time.time(), flush=True)
        return Command(VelocitySetpoint((0.0, 0.0, 0.0)), done=self.ticks <= 0)
"""


def write_campaign(folder: Path, *, ticks: int) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "world.yaml").write_text(WORLD)
    (folder / "still.py").write_text(STILL)
    autonomy = f"still.py:Still, with: {{ticks: {ticks}}}"
    (folder / "hover.yaml").write_text(CAMPAIGN.replace("wait, with: {}", autonomy))
    return folder / "hover.yaml"


def contents(folder: Path) -> dict[str, object]:
    """Return the files of runs, without the time that each took on the wall."""
    found: dict[str, object] = {}
    for path in folder.glob("default/**/*"):
        name = str(path.relative_to(folder))
        if path.name == "result.json":
            found[name] = {**json.loads(path.read_text()), "wall_s": 0}
        elif path.suffix in {".csv", ".jsonl", ".tlog"}:
            found[name] = path.read_bytes()
    return found
