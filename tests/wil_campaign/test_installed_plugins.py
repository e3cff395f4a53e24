"""Plugins: found, listed, refused by name, and none is needed to fly."""

import dataclasses
import importlib
import json
import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest

from tests.orchestrator.hover import WORLD, write_hover
from tests.orchestrator.reading.flown_campaign import flights, write_flown
from tests.safety.guard.remote_rigs import guard_config
from tests.test_house import ROOT
from wil_campaign import RecordedReading, Recording, hooks, installed_plugins
from wil_campaign.api import Masked
from wil_campaign.campaigns.schema import campaign_model
from wil_campaign.campaigns.schema.autonomy import autonomy_model
from wil_campaign.installed_plugins import (
    SHIPPED,
    absent_additions,
    installed_plugins_by_name,
    load_plugin_object,
    plugin_additions,
    third_party_modules,
)
from wil_campaign.orchestrator.cli import main
from wil_campaign.orchestrator.installation import flown_plugins
from wil_campaign.orchestrator.report.campaign_report import write_report
from wil_campaign.plugins.doctor.installed import plugin_findings
from wil_campaign.recipes.model.registry import StepContext, registered_steps
from wil_campaign.safety.guard.process.guard_config import GuardConfig
from wil_campaign.safety.oracles.registry import oracle_kinds
from wil_campaign.vehicles.autopilots.registry import autopilot_strategies
from wil_campaign.vehicles.embedded.emulations import emulations
from wil_campaign.vehicles.links import link_conditions
from wil_campaign.vehicles.links.link_factory import LinkRequest, open_link
from wil_campaign.vehicles.links.link_strings import LinkAddressError, parse_link
from wil_campaign.vehicles.readings import kinds

HOOKS = {
    "announcers",
    "autonomy_kinds",
    "autopilots",
    "campaign_keys",
    "case_hints",
    "commands",
    "drivers",
    "engines",
    "image_sources",
    "launches",
    "link_layers",
    "links",
    "live_views",
    "mesh_formats",
    "motion_captures",
    "operator_channels",
    "oracles",
    "problem_formats",
    "recipe_formats",
    "recipe_steps",
    "recording_formats",
    "report_images",
    "report_sections",
    "run_observers",
    "run_options",
    "run_sections",
    "sensor_types",
    "sources",
    "starter_options",
    "starters",
    "vehicle_checks",
}
CORE = ("orchestrator", "vehicles", "recipes", "campaigns", "safety", "worlds", "wil_campaign")
THIRD = """
from wil_campaign.hooks import AutopilotKind, implements

@implements
def autopilots():
    return (AutopilotKind("third", strategy="wil_sonar:Third", emulation=""),)
"""
OF_MESH = "objects: {{shelf: {{shape: {{mesh: {{file: {}}}}}, pose: {{north_m: 4, east_m: 2}}}}}}\n"
HYDROPHONE = """
from dataclasses import dataclass

from wil_campaign.hooks import LinkKind, LinkLayerKind, implements
from wil_campaign.vehicles.links.link_conditions import LinkLayer

@implements
def links():
    return (LinkKind("sonar", "device", "wil_sonar:opened"),)

@implements
def link_layers():
    return (LinkLayerKind("water", "wil_sonar:Water"),)

def opened(request):
    return request

@dataclass(frozen=True)
class Water(LinkLayer):
    depth_m: float
    name: str = "water"

    def over(self, links, site):
        return [(link, self.depth_m, site.system_id) for link in links]
"""
SONAR = '''
from wil_campaign.hooks import Command, implements


@implements
def commands():
    return (Command("ping", "wil_sonar:ping", "Send a ping."),)


def ping(times: int = 1) -> int:
    """Send a ping."""
    print("ping " * times)
    return 5
'''
FARM = """
from contextlib import contextmanager

from wil_campaign.hooks import Engine, implements


@implements
def engines():
    names = ("wil_sonar:check", "wil_sonar:start", "wil_sonar:start")
    return (Engine("farm", "farm://NAME", *names),)


def check(text):
    from wil_campaign.orchestrator.campaign.workers.run_engine import EngineError

    if text != "farm://a":
        raise EngineError(f"--engine {text}: there is no such farm", 2)


@contextmanager
def start(campaign, options, cleared, **_):
    print("on", options.engine)
    yield cleared
"""
Install = Callable[[str], None]
PLUGIN = "plugin sonar (wil-sonar 1.2)"


def put_distribution(folder: Path, name: str, point: str, files: Mapping[str, str]) -> None:
    """Install a distribution with one plugin beneath a folder of the path, as pip does."""
    facts = folder / f"wil_{name}-1.2.dist-info"
    facts.mkdir()
    (facts / "METADATA").write_text(f"Metadata-Version: 2.1\nName: wil-{name}\nVersion: 1.2\n")
    (facts / "entry_points.txt").write_text(f"[wil_campaign]\n{name} = {point}\n")
    for file, source in files.items():
        (folder / file).parent.mkdir(exist_ok=True)
        (folder / file).write_text(source)


def fly(words: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
    """Fly by a program of its own: a fork server of ours knows no plugin that came later."""
    return subprocess.run(  # noqa: S603 - our own interpreter
        [sys.executable, "-P", "-m", "wil_campaign", "run", *words],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(folder), str(ROOT)])},
        capture_output=True,
        text=True,
        check=False,
    )


def forget_plugins() -> None:
    installed_plugins._registered.cache_clear()
    campaign_model.cache_clear()
    autonomy_model.cache_clear()
    oracle_kinds.cache_clear()
    registered_steps.cache_clear()
    autopilot_strategies.cache_clear()
    link_conditions._layers.cache_clear()
    emulations.cache_clear()
    for known in (kinds.sensor_specs, kinds.reading_types, kinds.faults_of_types, kinds._names):
        known.cache_clear()
    kinds._traits.cache_clear()


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Install]:
    """Return a function that installs a distribution with a plugin, whose source is given."""

    def write(source: str) -> None:
        put_distribution(tmp_path, "sonar", "wil_sonar", {"wil_sonar.py": source})
        monkeypatch.syspath_prepend(tmp_path)
        monkeypatch.delitem(sys.modules, "wil_sonar", raising=False)
        forget_plugins()

    yield write
    forget_plugins()


def test_a_plugin_adds_a_kind_of_links_and_what_links_go_through(install: Install) -> None:
    with pytest.raises(LinkAddressError, match="cannot be read"):
        parse_link("sonar:///dev/hydrophone:9600")
    install(HYDROPHONE)
    address = parse_link("sonar:///dev/hydrophone:9600")
    assert str(address) == "sonar:///dev/hydrophone:9600"
    with pytest.raises(LinkAddressError, match=r"did you mean sonar:///dev/hydrophone:9600\?"):
        parse_link("sonr:///dev/hydrophone:9600")
    link: Any = open_link(address, signed=True)
    assert link == LinkRequest(address, signed=True)
    water = load_plugin_object("wil_sonar:Water")(depth_m=40.0)
    sent = guard_config(Path("/run"), conditions=link_conditions.LinkConditions(air=(water,)))
    conditions = GuardConfig.unpacked(sent.packed()).vehicles["real"].conditions
    assert conditions.air == (water,)
    site = link_conditions.LinkSite(system_id=7)
    through: Any = link_conditions.link_under_conditions([link], conditions, utc_s=0.0, site=site)
    assert through.link == (link, 40.0, 7)


def test_the_table_of_what_ships_is_what_the_plugins_add() -> None:
    """By it a tree without a plugin names the plugin."""
    shipped = {one.name: one.adds for one in installed_plugins_by_name() if one.origin == "shipped"}
    assert shipped == SHIPPED
    assert set(shipped) == {path.parent.name for path in (ROOT / "plugins").glob("*/__init__.py")}


@pytest.mark.parametrize("hook", sorted(HOOKS))
def test_all_that_a_shipped_plugin_names_is_there(hook: str) -> None:
    additions: Mapping[str, Any] = plugin_additions(getattr(hooks, hook))
    for addition in additions.values():
        for value in dataclasses.asdict(addition).values():
            if isinstance(value, str) and re.fullmatch(r"[\w.]+:\w+", value):
                assert load_plugin_object(value) is not None, value


def test_each_hook_is_tested_here() -> None:
    manager, _ = installed_plugins._registered()
    named = {name for name in vars(manager.hook) if not name.startswith("_")}
    assert named == HOOKS


def test_no_module_of_the_core_names_a_plugin() -> None:
    """import-linter sees imports alone; the core could also name a module in a string.

    `wil_campaign` and its `api` have public names of plugins, whose types checkers have to see.
    """
    found = [
        path.relative_to(ROOT)
        for folder in CORE
        for path in (ROOT / folder).rglob("*.py")
        if not path.is_relative_to(ROOT / "wil_campaign" / "plugins")
        and path not in {ROOT / "wil_campaign" / name for name in ("__init__.py", "api.py")}
        and "wil_campaign.plugins." in path.read_text("utf-8")
    ]
    assert found == []


def test_the_program_starts_without_what_its_plugins_do() -> None:
    code = "import sys; from wil_campaign.orchestrator.cli import build_app; build_app(); "
    code += "print(*sys.modules)"
    done = subprocess.run(  # noqa: S603 - our own interpreter
        [sys.executable, "-P", "-c", code], capture_output=True, text=True, check=True
    )
    found = set(done.stdout.split())
    ours = {name for name in found if name.startswith("wil_campaign.plugins.")}
    assert ours == {
        f"wil_campaign.plugins.{name}{end}" for name in SHIPPED for end in ("", ".plugin")
    }
    assert not found & {"numpy", "pydantic", "cv2", "yaml", "asyncio", "importlib.metadata"}


def test_a_plugin_of_another_distribution_is_listed_and_its_command_runs(
    install: Install, capsys: pytest.CaptureFixture[str]
) -> None:
    install(SONAR)
    assert main(["list", "plugins", "--json"]) == 0
    rows = {row["name"]: row for row in json.loads(capsys.readouterr().out)}
    assert rows["sonar"] == {"name": "sonar", "origin": "wil-sonar 1.2", "adds": "commands: ping"}
    assert rows["calibration"]["origin"] == "shipped"
    assert main(["ping", "--times", "2"]) == 5
    assert "ping ping" in capsys.readouterr().out


def test_what_a_plugin_prints_at_its_import_is_in_no_document(
    install: Install, capsys: pytest.CaptureFixture[str]
) -> None:
    install(f"{SONAR}\nprint('sonar 1.2')\n")
    assert main(["list", "plugins", "--json"]) == 0
    said = capsys.readouterr()
    assert "sonar" in {row["name"] for row in json.loads(said.out)}
    assert said.err == "sonar 1.2\n"


def test_runs_fly_by_an_engine_of_another_distribution(
    install: Install, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    install(FARM)
    words = ["run", str(write_hover(tmp_path)), "--mode", "sim", "--out", str(tmp_path / "out")]
    assert main([*words, "--engine", "farm://b"]) == 2
    assert "--engine farm://b: there is no such farm" in capsys.readouterr().err
    assert main([*words, "--engine", "rai"]) == 2
    said = capsys.readouterr().err
    assert "--engine rai: must be local, ray or ray://HOST:PORT, farm://NAME" in said
    assert main([*words, "--engine", "farm://a", "--store", "s3://b/p"]) == 2
    assert "--store: --engine farm://a uses none; leave --store out" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    assert main([*words, "--engine", "farm://a"]) == 0
    assert "on farm://a" in capsys.readouterr().out
    (manifest,) = (tmp_path / "out").rglob("campaign.json")
    (text,) = json.loads(manifest.read_text())["plugins"].values()
    assert re.fullmatch("wil-sonar 1.2, code [0-9a-f]{16}", text)


def test_a_plugin_that_is_edited_is_another_one_for_results(install: Install) -> None:
    """Installed from a folder to be edited there, it keeps its version."""
    install(SONAR)
    was = flown_plugins()
    path = Path(str(third_party_modules()["sonar"].__file__))
    path.write_text(f"{path.read_text()}\nLIMIT = 2\n")
    assert was.keys() == {"sonar"}
    assert flown_plugins() != was


CHECK = """
from wil_campaign.hooks import VehicleCheck, implements


@implements
def vehicle_checks():
    return (VehicleCheck("ping", "wil_sonar:ping", "Ping it."),)


def ping(link, *, arm_real, results, as_json):
    print("pinged", link, arm_real, results, as_json)
    return 1
"""


def test_a_command_of_a_plugin_that_fails_is_named(
    install: Install, capsys: pytest.CaptureFixture[str]
) -> None:
    """It was an internal error of the program alone."""
    install(SONAR.replace("return 5", 'raise OSError("no water")'))
    assert main(["ping"]) == 3
    said = capsys.readouterr().err.splitlines()[0]
    assert said == f"internal error: OSError: no water; {PLUGIN}: mend it, or uninstall it"


@pytest.mark.parametrize("returned", ["'it failed'", "True", "1.0"])
def test_a_command_of_a_plugin_that_returns_no_exit_code_is_named(
    install: Install, capsys: pytest.CaptureFixture[str], returned: str
) -> None:
    """Text was exit code 0, and True was 1."""
    install(SONAR.replace("return 5", f"return {returned}"))
    assert main(["ping"]) == 3
    said = f"command ping returned {returned}, which is no exit code"
    assert capsys.readouterr().err.startswith(f"internal error: TypeError: {said}; {PLUGIN}: mend")


def test_a_command_of_a_plugin_that_cannot_be_imported_is_named(
    install: Install, capsys: pytest.CaptureFixture[str]
) -> None:
    install(SONAR.replace('"wil_sonar:ping"', '"wil_sonra:ping"'))
    assert main(["ping"]) == 3
    said = "internal error: ModuleNotFoundError: No module named 'wil_sonra' (command ping)"
    assert capsys.readouterr().err.startswith(f"{said}; {PLUGIN}: mend it, or uninstall it")


@pytest.mark.parametrize("name", ["my-view", "my view", "class", ""])
def test_a_live_view_whose_name_is_no_word_is_named(tmp_path: Path, name: str) -> None:
    """It was an internal error of every `run`."""
    source = ONE_FILE.replace('"window"', f'"{name}"')
    put_distribution(tmp_path, "sonar", "wil_sonar", {"wil_sonar.py": source})
    shown = fly(["--help"], tmp_path)
    assert shown.returncode == 2
    said = (
        f"{PLUGIN}: live_views() fails: ValueError: {name!r} is no name of an option: one word of"
    )
    assert shown.stderr.startswith(f"{said} letters, digits and _; mend it, or uninstall it")


@pytest.mark.parametrize("name", ["mode", "out", "no_arm", "json", "broker"])
def test_a_live_view_with_the_name_of_an_option_of_run_is_named(tmp_path: Path, name: str) -> None:
    """It took the option's place, or was not there, without a word."""
    source = ONE_FILE.replace('"window"', f'"{name}"')
    put_distribution(tmp_path, "sonar", "wil_sonar", {"wil_sonar.py": source})
    shown = fly(["--help"], tmp_path)
    assert shown.returncode == 2
    said = f"plugin sonar (wil-sonar 1.2): live_views(): '{name}' is there already; mend it, or"
    assert shown.stderr.startswith(said)


def test_a_check_of_another_distribution_is_an_option_of_doctor(
    install: Install, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    install(CHECK)
    # Its options are those of the plugins that were there when it was imported.
    monkeypatch.delitem(sys.modules, "wil_campaign.plugins.doctor.doctor_command", raising=False)
    link = ["doctor", "--vehicle", "udpin://127.0.0.1:14540"]
    assert main([*link, "--ping", "--out", "there"]) == 1
    assert "pinged udpin://127.0.0.1:14540 False there False" in capsys.readouterr().out
    assert main([*link, "--ping", "--fly"]) == 2
    assert "--fly and --ping: one check at a time" in capsys.readouterr().err


SECTIONS = """
from wil_campaign.hooks import ReportSection, Section, implements


@implements
def report_sections():
    names = ("depths", "deaf", "gone")
    return [ReportSection(name, f"wil_sonar:{name}") for name in names]


def depths(folder, campaign):
    shown = f"<p>depths of {campaign.name}</p>"
    return Section(shown, ("no echo",), {"depths.json": "[7]"}, f"7 m in {folder.name}")


def deaf(folder, campaign):
    raise OSError("no sound")


def gone(folder, campaign):
    raise SystemExit(0)
"""


def test_a_file_beside_the_report_that_cannot_be_written_is_named(
    install: Install, tmp_path: Path
) -> None:
    """On a full disk "report.html was not written" stood beside a whole report.html."""
    folder = write_flown(tmp_path / "a", flights("a", "sim", "PP"), with_motion=False)
    install(SECTIONS)
    (folder / "depths.json").mkdir()
    found = write_report(folder)
    assert "depths of" in found.path.read_text("utf-8")
    assert "depths.json cannot be written: Is a directory" in found.problems


def test_a_plugin_adds_a_section_to_the_report(install: Install, tmp_path: Path) -> None:
    """One that fails is left out and named; the page is whole without it."""
    folder = write_flown(tmp_path / "a", flights("a", "sim", "PP"), with_motion=False)
    plain = write_report(folder).path.read_text("utf-8")
    install(SECTIONS)
    found = write_report(folder, out=tmp_path / "other.html")
    assert not (folder / "depths.json").exists()
    assert found == write_report(folder, out=tmp_path / "other.html")
    assert write_report(folder).problems[-3:] == (
        "no echo",
        "the section deaf is left out: OSError: no sound",
        "the section gone is left out: SystemExit: 0",
    )
    assert found.texts == ("7 m in a",)
    assert (folder / "depths.json").read_text("utf-8") == "[7]"
    page = (folder / "report.html").read_text("utf-8")
    assert re.sub("Page written [^.]*", "", page.replace("<p>depths of gate</p>", "")) == re.sub(
        "Page written [^.]*", "", plain
    )


RUN_SECTIONS = """
from wil_campaign.hooks import RunSection, Section, implements


@implements
def run_sections():
    return [RunSection("depth", "wil_sonar:depth"), RunSection("deaf", "wil_sonar:deaf")]


def depth(folder, run):
    return Section(f"<p>depth of {run.name} in {folder.name}</p>", ("no echo",))


def deaf(folder, run):
    raise OSError("no sound")
"""


def test_a_plugin_adds_a_section_to_the_page_of_each_run(install: Install, tmp_path: Path) -> None:
    """One that fails is left out and named, with its run."""
    folder = write_flown(tmp_path / "a", flights("a", "sim", "PP"))
    install(RUN_SECTIONS)
    found = write_report(folder, workers=1)
    page = found.path.read_text("utf-8")
    assert re.findall("<p>depth of .*?</p>", page) == [
        f"<p>depth of a/sim/{number} in a</p>" for number in (1, 2)
    ]
    assert found.problems[-2:] == (
        "a/sim/2: no echo",
        "a/sim/2: the section deaf is left out: OSError: no sound",
    )


def test_the_text_of_a_section_is_printed_after_the_verdicts(
    install: Install, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    install(SECTIONS)
    assert main(["run", str(write_hover(tmp_path)), "--out", str(tmp_path / "out")]) == 0
    lines = capsys.readouterr().out.splitlines()
    (folder,) = (tmp_path / "out").glob("*/*")
    assert lines.index(f"7 m in {folder.name}") < lines.index(f"results: {folder}")


ANNOUNCER = """
from wil_campaign.hooks import Announcer, ProblemFormat, implements


@implements
def announcers():
    return [Announcer("horn", "wil_sonar:faults", "wil_sonar:verdicts")]


@implements
def problem_formats():
    return [ProblemFormat("count", "wil_sonar:count", "Write how many faults there are.")]


def faults(problems, warnings):
    print(f"{len(problems)} faults")


def verdicts(campaign, summary, folder, *, arm):
    print(f"{campaign.name} {summary.accepted} {arm} in {folder.name}")
    raise OSError("hoarse")


def count(problems, warnings):
    return str(len(problems))
"""


def test_a_plugin_tells_how_commands_ended_and_may_fail(
    install: Install,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    install(ANNOUNCER)
    # Its options are those of the plugins that were there when it was imported.
    commands = "wil_campaign.orchestrator.cli.commands"
    monkeypatch.delitem(sys.modules, f"{commands}.validate", raising=False)
    file = write_hover(tmp_path)
    assert main(["run", str(file), "--out", str(tmp_path / "out")]) == 0
    shown = capsys.readouterr()
    (folder,) = (tmp_path / "out").glob("*/*")
    assert f"hover True True in {folder.name}\n" in shown.out
    assert "horn announces nothing: OSError: hoarse" in shown.err
    # As a command line of a library does when all went well: the campaign did not.
    path = Path(str(third_party_modules()["sonar"].__file__))
    path.write_text(path.read_text().replace('OSError("hoarse")', "SystemExit(0)"))
    importlib.reload(third_party_modules()["sonar"])
    words = ["run", str(file), "--out", str(tmp_path / "out")]
    assert main([*words, "--set", "oracles.altitude={max_m: 0.1}"]) == 1
    assert "horn announces nothing: SystemExit: 0" in capsys.readouterr().err
    file.write_text(file.read_text() + "one: 1\ntwo: 2\n")
    assert main(["validate", str(file), "--count", str(tmp_path / "n")]) == 2
    assert capsys.readouterr().out == "2 faults\n"
    assert (tmp_path / "n").read_text() == "2"
    assert main(["plan", str(file)]) == 2
    assert capsys.readouterr().out == "2 faults\n"


OBSERVER = """
from wil_campaign.hooks import RunObserver, implements


@implements
def run_observers():
    return [RunObserver("ping", "wil_ping:field", "wil_ping:setup", "wil_ping:observe")]
"""
PING = """
from dataclasses import dataclass

from wil_campaign.campaigns.setup.case_setup import ObserverSetup
from wil_campaign.orchestrator.state.observer import Observer


@dataclass(frozen=True)
class PingSetup(ObserverSetup):
    hz: int

    def problems(self, files, setup, mode, /):
        if mode == "sim" and self.hz > 90:
            yield files.campaign.problem(("ping",), "is too loud")

    def needing_wall_clock(self):
        if self.hz == 7:
            yield ("ping",), "a sonar"


class Pings(Observer):
    def __init__(self, hz):
        self.hz, self.vehicles = hz, []

    def attach(self, contexts):
        self.vehicles = [one.name for one in contexts]

    async def before_arming(self, unbooted, /):
        return f"pings {self.vehicles} at {self.hz} Hz"


def field():
    return int | None, None


def setup(given, campaign, part, problems):
    return None if given is None else PingSetup(given)


def observe(setup, given, events):
    return Pings(given.hz)
"""


def test_a_plugin_observes_the_runs_of_a_campaign_that_has_its_key(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    files = {"wil_pings.py": OBSERVER, "wil_ping.py": PING}
    put_distribution(tmp_path, "pings", "wil_pings", files)
    monkeypatch.syspath_prepend(tmp_path)
    forget_plugins()
    words = [str(write_hover(tmp_path)), "--set"]
    try:
        assert main(["validate", *words, "ping=91"]) == 2
        assert "ping=91: is too loud" in capsys.readouterr().err
        assert main(["validate", *words, "ping=7", "--clock", "virtual"]) == 2
        assert "a sonar runs in real time" in capsys.readouterr().err
    finally:
        forget_plugins()
    out = tmp_path / "out"
    run = [sys.executable, "-P", "-m", "wil_campaign", "run", *words, "ping=90", "--out", str(out)]
    subprocess.run(  # noqa: S603 - our own interpreter; a fork server of ours knows no such plugin
        [*run, "--repetitions", "1"],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), str(ROOT)])},
        check=True,
    )
    (path,) = out.glob("*/*/default/sim/1/result.json")
    steps = {one["step"]: one["text"] for one in json.loads(path.read_text())["before_arming"]}
    assert steps["external"] == "pings ['twin'] at 90 Hz"


KIND = """
from wil_campaign.hooks import AutonomyKind, implements


@implements
def autonomy_kinds():
    functions = ("wil_sonar:field", "wil_sonar:setup", "wil_sonar:runner")
    return [AutonomyKind("bat", "its name", *functions)]


def field():
    return str | None, None
"""


def test_a_plugin_adds_a_kind_of_autonomy_beside_a_class(
    install: Install, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    install(KIND)
    words = ["validate", str(write_hover(tmp_path)), "--set"]
    assert main([*words, "autonomy={with: {}}"]) == 2
    said = capsys.readouterr().err
    assert (
        "give use: (a class) or program: (a command line) or ros2: (a node) or bat: (its name)"
        in said
    )
    assert main([*words, "autonomy={use: still.py:Still, bat: b}"]) == 2
    assert "has no effect with a bat" in capsys.readouterr().err
    assert main([*words, "autonomy={program: [ls], bat: b}"]) == 2
    assert "has no effect with a program" in capsys.readouterr().err


ONE_FILE = """
from contextlib import contextmanager
from dataclasses import replace

from pydantic import Field

from wil_campaign.api import (
    LimitOracle,
    RangefinderReading,
    SidedParameters,
    Windowed,
    oracle,
    step,
)
from wil_campaign.hooks import LiveView, OracleKind, RecipeStep, SensorSource, implements


@implements
def oracles():
    return [OracleKind("calm", "wil_sonar:calm")]


@implements
def recipe_steps():
    return [RecipeStep("dim", "wil_sonar:dim")]


@implements
def sources():
    return [SensorSource("echo", "echo://METRES", "wil_sonar:Echo", "wil_sonar:fault", True)]


@implements
def live_views():
    return [LiveView("window", "wil_sonar:window", "Say what flies.")]


class CalmParameters(Windowed):
    max_m_s: float = Field(gt=0, description="fastest climb or sink rate")


class Calm(LimitOracle):
    motion = frozenset({"velocity"})

    def on_pose(self, sample):
        rate = abs(sample.velocity_ned_m_s[2])
        return self.judge_margin(sample.t_s, rate, 3.0 - rate, lambda: f"climbs at {rate:.2f} m/s")


@oracle("calm", "climbs and sinks no faster than max_m_s", CalmParameters)
def calm(terms, parameters, context):
    return Calm(terms, unit="m/s", limit=parameters.max_m_s)


class DimParameters(SidedParameters):
    \"\"\"to: what is left of the light, 0 to 1.\"\"\"

    to: float


@step("dim", stage="transform", sensors=("camera",), parameters=DimParameters)
def dim(parameters, context):
    \"\"\"Take light off an image.\"\"\"

    def operator(work, other):
        image = (work.reading.image_bgr * parameters.to).astype("uint8")
        return replace(work, reading=replace(work.reading, image_bgr=image))

    return operator


def fault(address, kind):
    return "" if kind == "rangefinder" else f"an echo is no {kind}"


class Echo:
    unusable = 0

    def __init__(self, request):
        self.name, self.request, self.t_s = request.address, request, 0.0

    def open(self):
        self.range_m = float(self.name.removeprefix("echo://"))

    def next(self):
        self.t_s += 1 / self.request.rate_hz
        what = {"source": self.request.side, "range_m": self.range_m, "mount": self.request.mount}
        return RangefinderReading(self.t_s, self.t_s, seq=0, range_min_m=0.1, range_max_m=9, **what)

    def close(self):
        pass


@contextmanager
def window(address, say, *, folder=None, program=None):
    say(f"window at {address}")
    yield
"""


def test_a_plugin_of_one_file_flies_in_the_gate(
    install: Install, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """An oracle, a step, a source and a live view; its step leaves no light for the gate."""
    install(ONE_FILE)
    transform = "[{resize: {to: real}}, {register: {pose: real}}, {dim: {to: 0}}]"
    sets = [
        "oracles.calm={max_m_s: 3}",
        f"recipe.combine.0.transform={transform}",
        "vehicles.real.sensors.down={type: rangefinder, rate_hz: 20, source: 'echo://1.5'}",
    ]
    words = [
        "--case",
        "large",
        "--mode",
        "wil",
        "--repetitions",
        "1",
        "--out",
        str(tmp_path / "out"),
    ]
    for one in sets:
        words += ["--set", one]
    gate = str(ROOT / "campaigns" / "gate.yaml")
    shown = fly([gate, *words, "--window", ":7"], tmp_path)
    assert shown.returncode == 3, shown.stderr
    assert "window at :7" in shown.stdout + shown.stderr
    assert "the mixture never showed gate" in shown.stdout
    assert re.search(r"real down \(file\): \d{3} delivered, 0 dropped", shown.stdout)
    (result,) = (json.loads(path.read_text()) for path in (tmp_path / "out").glob("**/result.json"))
    calm = next(
        one for one in result["oracles"] if one["name"] == "calm" and one["vehicle"] == "real"
    )
    assert (calm["verdict"], calm["limit"]) == ("PASS", 3.0)
    assert main(["schema", str(tmp_path / "schemas")]) == 0
    schemas = {path.name: path.read_text() for path in (tmp_path / "schemas").glob("*.json")}
    assert '"calm": {' in schemas["campaign.schema.json"]
    assert '"dim": {' in schemas["recipe.schema.json"]
    assert main(["list", "plugins"]) == 0
    adds = "live views: window; oracles: calm; recipe steps: dim; sources: echo"
    assert re.search(rf"sonar +wil-sonar 1\.2 +{adds}", capsys.readouterr().out)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (('"wil_sonar:calm"', '"wil_sonar:clam"'), "oracles(): wil_sonar:clam cannot be used: "),
        (('"calm", "wil', '"quiet", "wil'), "it is named 'calm', not 'quiet'; mend it"),
        (('"calm"', '"collision"'), "oracles(): 'collision' is there already; mend it"),
        (('"dim"', '"resize"'), "recipe_steps(): 'resize' is there already; mend it"),
        (
            ('@oracle("calm", "climbs and sinks no faster than max_m_s", CalmParameters)', ""),
            "a function has no name: wil_campaign.hooks.OracleKind says what it has to be; mend",
        ),
        (
            ("CalmParameters(Windowed)", "CalmParameters"),
            "oracle 'calm': CalmParameters is not derived from OracleParameters; mend it",
        ),
        (
            ('stage="transform"', 'stage="transfrom"'),
            "step 'dim': stage is 'transfrom', not one of transform, filter, merge; mend it",
        ),
        (
            ('("camera",)', '("camera")'),
            "step 'dim': sensors is 'camera', not ('camera',); mend it",
        ),
        (
            ("DimParameters(SidedParameters)", "DimParameters"),
            "step 'dim': DimParameters is not derived from StepParameters; mend it",
        ),
    ],
)
def test_a_part_that_cannot_be_used_is_named_once(
    install: Install, capsys: pytest.CaptureFixture[str], change: tuple[str, str], said: str
) -> None:
    install(ONE_FILE.replace(*change))
    assert main(["validate", str(ROOT / "campaigns" / "gate.yaml")]) == 2
    shown = capsys.readouterr().err
    assert shown.startswith("plugin sonar (wil-sonar 1.2): ")
    assert said in shown
    assert shown.count("plugin sonar") == 1


@pytest.mark.parametrize(
    ("source", "said"),
    [
        (
            "import nowhere_to_be_found",
            "cannot be used: ModuleNotFoundError: No module named 'nowhere_to_be_found'; mend",
        ),
        (
            SONAR.replace("def commands", "def comands"),
            "cannot be used: there is no hook 'comands'; did you mean 'commands'?; mend it, or ",
        ),
        (
            SONAR.replace("@implements\n", ""),
            "cannot be used: none of its functions is a hook's: they stand under @implements; ",
        ),
        (
            SONAR.replace("return (Command", "return (1 / 0, Command"),
            "commands() fails: ZeroDivisionError: division by zero; ",
        ),
        (
            SONAR.replace('"ping"', '"run"', 1),
            "commands(): 'run' is there already; mend it, or ",
        ),
        (
            SONAR.replace('"ping"', '"replay"', 1),
            "commands(): 'replay' is there already; mend it, or ",
        ),
        (
            OBSERVER.replace('"ping"', '"goal"'),
            "run_observers(): 'goal' is there already; mend it, or ",
        ),
        (
            OBSERVER.replace('"ping"', '"search"'),
            "run_observers(): 'search' is there already; mend it, or ",
        ),
        (
            KIND.replace('"bat"', '"use"'),
            "autonomy_kinds(): 'use' is there already; mend it, or ",
        ),
        (
            THIRD,
            "autopilots() fails: ValueError: 'third' has no emulation; mend it, or ",
        ),
        ("raise SystemExit(0)", "cannot be used: SystemExit: 0; mend it, or "),
        (
            SONAR.replace("return (Command", "return exit() or (Command"),
            "commands() fails: SystemExit: None; mend it, or ",
        ),
        (
            SONAR.replace('"Send a ping.")', '"Send a ping.", "nowhere")'),
            "commands() fails: ValueError: section is 'nowhere', not start, fly, look, operate; ",
        ),
        (
            SONAR.replace(
                'return (Command("ping", "wil_sonar:ping", "Send a ping."),', "return (7,"
            ),
            "commands() fails: TypeError: it gives int, not Command; mend it, or ",
        ),
    ],
    ids=[
        *("import", "hook", "unmarked", "fails", "core's", "plugin's", "key", "plugin's key"),
        *("autonomy's key", "autopilot", "exits", "hook exits", "section", "other kind"),
    ],
)
def test_a_plugin_that_cannot_be_used_is_named(
    install: Install, capsys: pytest.CaptureFixture[str], source: str, said: str
) -> None:
    install(source)
    assert main(["validate", str(ROOT / "campaigns" / "gate.yaml")]) == 2
    shown = capsys.readouterr().err
    assert shown.startswith(f"plugin sonar (wil-sonar 1.2): {said}")
    assert shown.splitlines()[1:] in ([], ["1 problem in 1 file"])


@pytest.mark.parametrize("command", ["abort", "hold", "resume"])
def test_vehicles_are_landed_whatever_a_plugin_is(
    install: Install, tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str
) -> None:
    """`abort` was refused, with 2, once a plugin that cannot be imported was installed."""
    nothing_flies = tmp_path / "nothing-flies"
    words = [command, str(nothing_flies)]
    code = main(words)
    said = capsys.readouterr()
    assert str(nothing_flies) in said.err + said.out
    install("raise RuntimeError('boom')")
    assert main(words) == code
    now = capsys.readouterr()
    assert now.out == said.out
    why = "plugin sonar (wil-sonar 1.2): cannot be used: RuntimeError: boom; mend it, or uninstall"
    assert now.err == f"{why} it\n{said.err}"


def test_a_plugin_with_the_name_of_another_one_is_named_in_a_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """It was followed by the list of all plugins, 9 kB."""
    put_distribution(tmp_path, "lidar", "wil_sonar", {"wil_sonar.py": SONAR})
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "wil_sonar", raising=False)
    forget_plugins()
    try:
        assert main(["list", "plugins"]) == 2
    finally:
        forget_plugins()
    said = "plugin lidar (wil-lidar 1.2): its name is there already, of "
    said += "wil_campaign.plugins.lidar.plugin; mend it, or uninstall it\n"
    assert capsys.readouterr().err == said


@pytest.mark.parametrize(
    ("change", "listed"), [(('"calm"', '"collision"'), 2), (('"wil_sonar:calm"', '"gone:calm"'), 0)]
)
def test_doctor_finds_a_plugin_that_no_campaign_flies_with(
    install: Install, capsys: pytest.CaptureFixture[str], change: tuple[str, str], listed: int
) -> None:
    """Of both, doctor said nothing, and of a name that is there `list plugins` neither."""
    install(ONE_FILE.replace(*change))
    assert main(["list", "plugins"]) == listed
    capsys.readouterr()
    (found,) = plugin_findings()
    assert found.grade == "trouble"
    assert found.text.startswith("plugin sonar (wil-sonar 1.2): oracles(): ")


def test_doctor_names_the_plugins_of_others(install: Install) -> None:
    assert list(plugin_findings()) == []
    install(ONE_FILE)
    (found,) = plugin_findings()
    assert (found.grade, found.text) == ("good", "plugins of others: sonar (wil-sonar 1.2)")


def test_an_unfinished_class_of_a_plugin_is_named(
    install: Install, capsys: pytest.CaptureFixture[str]
) -> None:
    """It was an internal error, whatever the campaign flew."""
    base = "from wil_campaign.vehicles.autopilots.autopilot import Autopilot"
    source = THIRD.replace('emulation=""', 'emulation="wil_sonar:Third"')
    install(f"{base}\n{source}\nclass Third(Autopilot):\n    name = 'third'\n")
    assert main(["validate", str(ROOT / "campaigns" / "gate.yaml")]) == 2
    said = "plugin sonar (wil-sonar 1.2): autopilots(): wil_sonar:Third cannot be used: TypeError: "
    said += "it lacks _heading_mask, fence_parameters, ground_truth, "
    assert capsys.readouterr().err.startswith(said)


def test_the_plugin_of_the_page_flies(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    home = ROOT / "docs" / "examples" / "wil-lab"
    files = {
        path.relative_to(home).as_posix(): path.read_text("utf-8")
        for path in home.glob("wil_lab/*.py")
    }
    assert len([line for source in files.values() for line in source.splitlines() if line]) <= 130
    assert 'lab = "wil_lab.plugin"' in (home / "pyproject.toml").read_text("utf-8")
    page = (ROOT / "docs" / "plugins.md").read_text("utf-8")
    assert f"```python\n# wil_lab/plugin.py\n{files['wil_lab/plugin.py']}```" in page
    named = set(re.findall(r"\]\(examples/wil-lab/(.+?\.py)\)", page))
    assert named == set(files) - {"wil_lab/plugin.py"}
    put_distribution(tmp_path, "lab", "wil_lab.plugin", files)
    monkeypatch.syspath_prepend(tmp_path)
    forget_plugins()
    campaign = write_hover(tmp_path)
    down = "sensors: {down: {type: rangefinder, rate_hz: 20, source: 'echo://1.5'}}"
    text = campaign.read_text().replace("px4", f"px4, {down}")
    text = text.replace("{landed: {}}", "{landed: {}, calm: {max_m_s: 3}}")
    wrong = {
        "max_m_s: 3": ("max_km_h: 3", "unknown key 'max_km_h'"),
        "calm: ": ("clam: ", "unknown oracle 'clam'; did you mean 'calm'?"),
        "rangefinder": ("gps", "an echo is no gps"),
        "echo:": ("eco:", "), or echo://METRES"),
    }
    try:
        for good, (bad, said) in wrong.items():
            campaign.write_text(text.replace(good, bad))
            assert main(["validate", str(campaign)]) == 2
            assert re.search(rf"hover\.yaml:\d+:\d+: .*{re.escape(said)}", capsys.readouterr().err)
        down = "source: 'echo://1.5'}"
        campaign.write_text(text.replace(down, f"{down}, mag: {{type: magnetometer}}"))
        out = tmp_path / "out"
        words = ["--repetitions", "1", "--out", str(out)]
        log = tmp_path / "logbook.jsonl"
        flown = fly([str(campaign), *words, "--logbook", str(log)], tmp_path)
        assert flown.returncode == 0, flown.stderr
        assert f"logbook: {log}" in flown.stdout.replace("\n", "")
        assert '"campaign": "hover"' in log.read_text()
        (run,) = (path.parent for path in out.glob("**/result.json"))
        assert main(["readings", str(run)]) == 0
        assert int(capsys.readouterr().out) > 100
        assert main(["readings", str(out)]) == 2
        assert "has no run.mcap" in capsys.readouterr().out
        step = next(one for one in registered_steps() if one.name == "bias")
        reading: Any = next(
            one.reading
            for one in Recording(run / "run.mcap")
            if isinstance(one, RecordedReading) and one.sensor == "mag"
        )
        operate: Any = step.build(step.parameters.model_validate({"north_ut": 5.0}), StepContext())
        assert operate(Masked(reading), None).reading.x_ut == reading.x_ut + 5.0
        (result,) = (json.loads(path.read_text()) for path in out.glob("**/result.json"))
        calm = next(one for one in result["oracles"] if one["name"] == "calm")
        assert (calm["verdict"], calm["limit"], calm["unit"]) == ("PASS", 3.0, "m/s")
        assert 0.1 < calm["actual"] < 3.0
        flown = fly([str(campaign), *words, "--set", "oracles.calm.max_m_s=0.1"], tmp_path)
        assert flown.returncode == 1, flown.stderr
        assert re.search(r"climbs at 0\.\d+ m/s", flown.stdout)
        assert main(["list", "oracles"]) == 0
        assert "calm: climbs and sinks no faster than max_m_s" in capsys.readouterr().out
    finally:
        forget_plugins()


WITHOUT = """
import sys
from importlib.machinery import ModuleSpec
from importlib.util import module_from_spec
from pathlib import Path

__path__ = ["{home}/wil_campaign"]
nothing = ModuleSpec("wil_campaign.plugins", None, is_package=True)
sys.modules["wil_campaign.plugins"] = module_from_spec(nothing)
exec(Path("{home}/wil_campaign/__init__.py").read_text())
"""
"""The program as in a tree without the folder `plugins`, in all of its processes."""
ABSENT = """
import sys
from pathlib import Path
from wil_campaign.orchestrator.cli import main
for words in {words}:
    print(">", *words, flush=True)
    print("=", main(words), flush=True)
import wil_campaign
for folder in Path({out!r}).glob("*/*"):
    print("written:", *((folder / name).exists() for name in ("report.html", "statistics.json")))
for name in ("BadInput", "run", "Recording", "Study", "plan"):
    try:
        print("named:", getattr(wil_campaign, name).__name__)
    except ImportError as error:
        print(error)
"""


WITHOUT_SOME = """
from pathlib import Path
__path__ = [*__path__, "{home}/wil_campaign"]
exec(Path("{home}/wil_campaign/__init__.py").read_text())
"""
LACKING = """
from wil_campaign.orchestrator.cli import main
assert main(["validate", {gate!r}]) == 2
import wil_campaign
for name in ("mix", "search", "load"):
    try:
        print(getattr(wil_campaign, name).__name__)
    except ImportError as error:
        print(error)
"""


def addresses_of_images(folder: Path) -> list[str]:
    """Return an address of each kind of sources of images that a shipped plugin has."""
    kinds = {
        "rtsp": "rtsp://h/a",
        "rtp": "rtp://127.0.0.1:5004",
        "v4l2": "/dev/video9",
        "simulator": "tcp://127.0.0.1:5555",
        "images": str(folder),
        "video": str(folder / "a.mp4"),
        "mcap": str(folder / "a.mcap"),
    }
    for kind in ("video", "mcap"):
        Path(kinds[kind]).touch()
    return [kinds[kind] for kind in shipped("image_sources")]


def write_recipe_of_steps(folder: Path) -> Path:
    """Write a recipe of all steps that shipped plugins have, and return its path."""
    path = folder / "recipe.yaml"
    names = ", ".join(shipped("recipe_steps"))
    path.write_text(
        "schema: wil/recipe/1\nsensors: {camera: {type: camera, rate_hz: 9}}\n"
        f"combine: [{{sensor: camera, transform: [{names}], merge: overlay, publish: [real]}}]\n"
    )
    return path


def write_recipe_of_types(folder: Path) -> Path:
    """Write a recipe of all types of sensors that shipped plugins have, and return its path."""
    path = folder / "types.yaml"
    types = ", ".join(f"{name}: {{type: {name}}}" for name in shipped("sensor_types"))
    path.write_text(
        f"schema: wil/recipe/1\nsensors: {{{types}}}\n"
        "combine: [{sensor: lidar, merge: overlay, publish: [real]}]\n"
    )
    return path


def write_with_mesh(folder: Path, suffix: str) -> Path:
    """Write a campaign in whose world a mesh stands, and return its path."""
    file = write_hover(folder).rename(folder / f"mesh{suffix}.yaml")
    world = folder / f"world{suffix}.yaml"
    world.write_text(WORLD + OF_MESH.format(f"a{suffix}"))
    file.write_text(file.read_text().replace("world.yaml", world.name))
    return file


def shipped(hook: str) -> list[str]:
    """Return the names that shipped plugins add by a hook."""
    return [name for adds in SHIPPED.values() for name in adds.get(hook, ())]


def test_gate_flies_without_any_plugin_and_absent_parts_are_named(tmp_path: Path) -> None:
    """The proof of the CI that the core needs no plugin.

    Its modules have the paths of this checkout, for which kernels are compiled already.
    """
    (tmp_path / "wil_campaign").mkdir()
    (tmp_path / "wil_campaign" / "__init__.py").write_text(WITHOUT.format(home=ROOT))
    gate = str(ROOT / "campaigns" / "gate.yaml")
    one = ["--case", "small", "--mode", "sim", "--repetitions", "1", "--out", str(tmp_path / "out")]
    views = shipped("live_views")
    commands = shipped("commands")
    words = [["validate", gate], ["run", gate, *one]]
    words += map(str.split, commands)
    words += [["run", gate, *one, f"--{view}", ":0"] for view in views]
    keys = shipped("campaign_keys")
    words.append(["validate", str(ROOT / "campaigns" / "search-gate.yaml")])
    words += [["run", gate, *one, "--set", f"{name}={{}}"] for name in keys if name != "search"]
    formats = shipped("recipe_formats")
    words += [["validate", f"recipe{end}"] for end in formats]
    engines = shipped("engines")
    words += [["run", gate, *one, "--engine", f"{name}://127.0.0.1:6379"] for name in engines]
    drivers = shipped("drivers")
    for name in drivers:
        file = write_hover(tmp_path).rename(tmp_path / f"{name}.yaml")
        file.write_text(file.read_text().replace("px4", f"px4, driver: {name}", 1))
        words.append(["validate", str(file)])
    for name in shipped("operator_channels"):
        words.append(["run", gate, *one, "--set", f"operator.{name}.broker=embedded"])
    words += [["run", gate, *one, f"--{name}", "embedded"] for name in shipped("run_options")]
    words += [
        ["run", gate, *one, "--set", f"autonomy={{{name}: [a]}}"]
        for name in shipped("autonomy_kinds")
    ]
    words += [["run", gate, *one, "--set", f"{name}={{}}"] for name in shipped("run_observers")]
    words += [
        ["run", gate, *one, "--set", f"oracles.own={{{name}: a}}"] for name in shipped("oracles")
    ]
    words += [
        ["run", gate, *one, "--set", f"vehicles.real.sensors.camera.source={address}"]
        for address in addresses_of_images(tmp_path)
    ]
    mocap = ("udp://127.0.0.1:5570", "tcp://h:5570")
    words += [["run", gate, *one, "--set", f"vehicles.real.mocap={name}"] for name in mocap]
    captured = "vehicles.real.sensors.place={type: pose, source: '%s'}"
    words += [
        ["run", gate, *one, "--set", captured % name]
        for name in ("tcp://h:5555", "a.mcap", "rtp://h:1", "realsense://1")
    ]
    words += [["validate", str(write_with_mesh(tmp_path, end))] for end in shipped("mesh_formats")]
    words += [
        *(
            ["validate", gate, f"--{name}", str(tmp_path / name)]
            for name in shipped("problem_formats")
        ),
        *(
            ["run", gate, *one, "--set", f"record.also=[{name}]"]
            for name in shipped("recording_formats")
        ),
    ]
    words += [
        ["validate", str(write_recipe_of_steps(tmp_path))],
        ["validate", str(ROOT / "campaigns" / "gate-ardupilot.yaml")],
        *(
            ["run", gate, *one, "--set", f"vehicles.real.link={{launch: {name}}}"]
            for name in shipped("launches")
        ),
        *(
            ["run", gate, *one, "--set", f"vehicles.real.link={name}:///dev/ttyACM0:57600"]
            for name in shipped("links")
        ),
        ["run", gate, *one, "--set", "vehicles.real.spare_links=[udpin://0.0.0.0:14550]"],
        ["run", gate, *one, "--set", "vehicles.real.signing={environment: WIL_KEY}"],
        *(["report", str(tmp_path), f"--{name}"] for name in shipped("report_images")),
        *(
            ["run", gate, *one, "--set", f"vehicles.real.sensors.more={{type: {name}}}"]
            for name in shipped("sensor_types")
        ),
        ["validate", str(write_recipe_of_types(tmp_path))],
    ]
    done = subprocess.run(  # noqa: S603 - our own interpreter
        [sys.executable, "-P", "-c", ABSENT.format(words=words, out=str(tmp_path / "out"))],
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
        check=True,
    )
    codes = [int(line[2:]) for line in done.stdout.splitlines() if line.startswith("= ")]
    assert codes[:2] == [0, 5], done.stdout + done.stderr  # 5: it flew nothing required
    assert re.search(r"small +sim +1/1 ", done.stdout)
    named = [*(name.split()[0] for name in commands), *views, *keys, *formats, *engines, *drivers]
    hooks_of_rest = (
        *("operator_channels", "run_options", "autonomy_kinds", "run_observers", "oracles"),
        *("image_sources", "sources", "mesh_formats", "recipe_steps", "problem_formats"),
        *("recording_formats", "motion_captures", "report_images", "autopilots"),
        *("launches", "links", "link_layers", "sensor_types"),
    )
    named += [name for hook in hooks_of_rest for name in shipped(hook)]
    assert codes[2:] == [2] * (len(words) - 2)
    for name in named:
        assert f"'{name}' is of the plugin " in done.stderr
    # No index has the program: by its name pip found none, or a stranger's.
    assert "which is not installed: pip install --force-reinstall --no-deps SOURCE" in done.stderr
    line = r"search-gate\.yaml:\d+:\d+: 'search' is of the plugin search, which is not installed: "
    assert re.search(line, done.stderr)
    # Of the run: report.html, statistics.json.
    assert "written: True False\nnamed: BadInput\n" in done.stdout
    for name, plugin in (
        *(("run", "python"), ("Recording", "python")),
        *(("Study", "statistics"), ("plan", "statistics")),
    ):
        assert f"'{name}' is of the plugin {plugin}, which is not installed: pip " in done.stdout
    assert re.search(r"types\.yaml:2:\d+: 'microphone' is of the plugin microphone, ", done.stderr)
    assert absent_additions(hooks.commands) == {}


def run_without(plugins: set[str], code: str, folder: Path) -> "subprocess.CompletedProcess[str]":
    """Run Python with the program as in a tree without some plugins."""
    there = folder / "wil_campaign" / "plugins"
    there.mkdir(parents=True)
    for path in (ROOT / "plugins").iterdir():
        if path.name not in plugins:
            (there / path.name).symlink_to(path)
    (folder / "wil_campaign" / "__init__.py").write_text(WITHOUT_SOME.format(home=ROOT))
    return subprocess.run(  # noqa: S603 - our own interpreter
        [sys.executable, "-P", "-c", code],
        env={**os.environ, "PYTHONPATH": str(folder)},
        capture_output=True,
        text=True,
        check=True,
    )


def test_a_command_says_which_other_plugin_it_lacks(tmp_path: Path) -> None:
    """It was an internal error, with a traceback."""
    code = "from wil_campaign.orchestrator.cli import main; assert main(['replay', 'run']) == 2"
    done = run_without({"python"}, code, tmp_path)
    assert done.stderr.startswith(
        "this command needs the plugin python, which is not installed: pip install "
    )


def test_a_plugin_says_which_other_one_it_lacks(tmp_path: Path) -> None:
    """It said: No module named 'wil_campaign.plugins.firmware'."""
    code = LACKING.format(gate=str(ROOT / "campaigns" / "gate.yaml"))
    done = run_without({"firmware", "cameras", "stl"}, code, tmp_path)
    said = "plugin ardupilot (shipped): launches(): "
    said += "wil_campaign.plugins.ardupilot.launch:ArduPilotLaunchPart cannot be used: it needs "
    assert f"{said}the plugin firmware, which is not installed: pip install " in done.stderr
    mix, search, load = done.stdout.splitlines()
    assert mix.startswith("'mix' needs the plugin cameras, which is not installed: pip install ")
    assert search.startswith("'search' needs the plugin stl, which is not installed: pip install ")
    assert load == "load"
