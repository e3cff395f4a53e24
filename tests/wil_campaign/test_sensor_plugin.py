"""A sensor type of another distribution, in one file: flown, mixed, perceived, recorded, listed."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.orchestrator.hover import WORLD
from tests.test_house import ROOT
from tests.wil_campaign.test_installed_plugins import put_distribution

COMPASS = '''
"""A magnetometer: the field of the earth, turned by its declination, in the body's axes."""

import math
from dataclasses import dataclass

from wil_campaign.api import NumbersReading, SensorOptions, SensorSpec, rotate
from wil_campaign.hooks import SensorKind, implements


@implements
def sensor_types():
    return [SensorKind("magnetometer", "wil_compass:MAGNETOMETER")]


@dataclass(frozen=True, slots=True, kw_only=True)
class FieldReading(NumbersReading):
    """x_ut, y_ut, z_ut: microtesla in the body's FRD axes."""

    x_ut: float
    y_ut: float
    z_ut: float


class FieldOptions(SensorOptions):
    """A magnetometer. rate_hz: samples in a second. declination_deg: of the field, to the east."""

    rate_hz: float = 20.0
    declination_deg: float = 0.0
    strength_ut: float = 20.0


class Magnetometer:
    def __init__(self, options, site):
        self.side, self.strength_ut = site.side, options.strength_ut
        self.east_rad = math.radians(options.declination_deg)

    def sample(self, truth, t_s, rng):
        east_ut = self.strength_ut * math.sin(self.east_rad)
        north_ut = self.strength_ut * math.cos(self.east_rad)
        w, x, y, z = truth.pose.q_wxyz
        x_ut, y_ut, z_ut = rotate((w, -x, -y, -z), (north_ut, east_ut, 0.0))
        return FieldReading(
            t_s=t_s, arrived_s=t_s, seq=0, source=self.side, x_ut=x_ut, y_ut=y_ut, z_ut=z_ut
        )


def fault(reading):
    strength_ut = math.hypot(reading.x_ut, reading.y_ut, reading.z_ut)
    return "" if strength_ut < 100 else f"a field of {strength_ut:.0f} uT is none of the earth"


MAGNETOMETER = SensorSpec("magnetometer", FieldReading, FieldOptions, Magnetometer, fault)
'''
CAMPAIGN = """\
schema: wil/campaign/1
campaign: compass
vehicles:
  real: {link: embedded, autopilot: px4, sensors: {mag: {type: magnetometer}}}
  twin:
    link: embedded
    autopilot: px4
    sensors: {mag: {type: magnetometer, declination_deg: 90}}
world: world.yaml
recipe: recipe.yaml
autonomy: pilot.py:Pilot
goal: {altitude_m: 1.2}
modes: [wil]
oracles: {landed: {}}
"""
RECIPE = """\
schema: wil/recipe/1
sensors: {mag: {type: magnetometer}}
combine:
  - sensor: mag
    merge: {replace: {source: twin, when: {of: twin, what: y_ut, above: 15}}}
    publish: [real, twin]
"""
PILOT = """\
from wil_campaign.api import Command, VelocitySetpoint
from wil_compass import FieldReading


class Pilot:
    def __init__(self, *, goal, parameters, seed):
        self.seen = None

    def perceive(self, reading):
        assert isinstance(reading, FieldReading)
        self.seen = reading

    def act(self, telemetry):
        note = "" if self.seen is None else f"field {round(self.seen.x_ut)} {round(self.seen.y_ut)}"
        return Command(VelocitySetpoint((0.0, 0.0, 0.0)), done=self.seen is not None, note=note)
"""
READ = """\
import sys
from pathlib import Path
from wil_campaign.plugins.python.mcap_reader import RecordedReading, Recording

found = [one.reading for one in Recording(Path(sys.argv[1])) if isinstance(one, RecordedReading)]
print(*sorted({(type(one).__name__, one.source, round(one.y_ut)) for one in found}))
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A campaign of a pair whose sensor is of a plugin; the plugin's folder is `site`."""
    (tmp_path / "site").mkdir()
    put_distribution(tmp_path / "site", "compass", "wil_compass", {"wil_compass.py": COMPASS})
    texts = {"campaign": CAMPAIGN, "recipe": RECIPE, "world": WORLD}
    for name, text in texts.items():
        (tmp_path / f"{name}.yaml").write_text(text)
    (tmp_path / "pilot.py").write_text(PILOT)
    return tmp_path


def call(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Call the program in a process of its own, with the plugin on its path."""
    return subprocess.run(  # noqa: S603 - our own interpreter
        [sys.executable, "-P", *words],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(folder / "site"), str(ROOT)])},
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )


def program(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    return call(folder, "-m", "wil_campaign", *words)


def test_a_sensor_of_a_plugin_is_rendered_mixed_perceived_and_recorded(folder: Path) -> None:
    flown = program(folder, "run", "campaign.yaml", "--out", "out")
    assert flown.returncode == 0, flown.stdout + flown.stderr
    (run,) = folder.glob("out/*/*/*/wil/1")
    assert json.loads((run / "result.json").read_text())["note"] == "field 0 20"
    read = call(folder, "-c", READ, str(run / "run.mcap"))
    assert read.stdout.split("\n")[0] == (
        "('FieldReading', 'mixed', 20) ('FieldReading', 'real', 0) ('FieldReading', 'twin', 20)"
    )


def test_a_sensor_of_a_plugin_is_listed_and_in_the_schemas(folder: Path) -> None:
    rows = json.loads(program(folder, "list", "sensors", "--json").stdout)
    assert rows[-1] == {
        "name": "magnetometer",
        "keys": "source, rate_hz, declination_deg, strength_ut",
        "summary": "A magnetometer.",
    }
    assert "sensor types: magnetometer" in program(folder, "list", "plugins").stdout
    assert program(folder, "schema", "--folder", "schemas").returncode == 0
    schema = json.loads((folder / "schemas" / "campaign.schema.json").read_text())
    turned = schema["$defs"]["FieldPart"]["properties"]["declination_deg"]
    assert turned["description"] == "Of the field, to the east. Unit: degrees."
    recipe = json.loads((folder / "schemas" / "recipe.schema.json").read_text())
    assert "magnetometer" in recipe["$defs"]["SensorPart"]["properties"]["type"]["enum"]


@pytest.mark.parametrize(
    ("good", "bad", "said"),
    [
        ("declination_deg: 90", "declinaton_deg: 9", "did you mean 'declination_deg'?"),
        ("type: magnetometer}}}", "type: magnetic}}}", "microphone, gps, imu or magnetometer"),
        ("recipe.yaml", "colour.yaml", "step 'resize' works on camera and depth, not on magn"),
        ("{mag: {type: magnetometer}}", "{mag: {type: imu}}", "vehicle 'real' has no magnetometer"),
    ],
)
def test_a_fault_in_a_sensor_of_a_plugin_is_reported_at_its_place(
    folder: Path, good: str, bad: str, said: str
) -> None:
    (folder / "colour.yaml").write_text(
        RECIPE.replace("    merge", "    transform: [{resize: {to: real}}]\n    merge")
    )
    path = folder / "campaign.yaml"
    path.write_text(CAMPAIGN.replace(good, bad, 1))
    checked = program(folder, "validate", "campaign.yaml")
    assert checked.returncode == 2
    assert said in checked.stderr


def test_a_reading_that_the_plugin_refuses_is_not_mixed(folder: Path) -> None:
    strong = "vehicles.twin.sensors.mag.strength_ut=500"
    program(folder, "run", "campaign.yaml", "--set", strong, "--out", "out")
    (path,) = folder.glob("out/*/*/*/wil/1/result.json")
    (mixed,) = json.loads(path.read_text())["mixing"]["combinations"]
    assert mixed["faults"]["twin out_of_range"] > 10
    assert json.loads(path.read_text())["note"] == "field 20 0", "the real reading alone"


def test_a_reading_that_the_plugin_refuses_proves_nothing_where_none_is_mixed(
    folder: Path,
) -> None:
    changes = ("--set", "modes=[sim]", "--set", "vehicles.twin.sensors.mag.strength_ut=500")
    program(folder, "run", "campaign.yaml", *changes, "--out", "out")
    (path,) = folder.glob("out/*/*/*/sim/1/result.json")
    result = json.loads(path.read_text())
    assert result["verdict"] == "INVALID"
    assert "mag of twin: a field of 500 uT is none of the earth" in result["reason"]
