"""The command line: what goes to standard output, to standard error, and the exit code."""

import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest

from wil_campaign.orchestrator.cli import main
from wil_campaign.orchestrator.cli.text_table import table_lines

ROOT = Path(__file__).parents[4]


@dataclass(frozen=True)
class Outcome:
    code: int
    out: str
    err: str


class Cli:
    def __init__(self, capsys: pytest.CaptureFixture[str]) -> None:
        self._capsys = capsys

    def __call__(self, *arguments: str) -> Outcome:
        code = main(arguments)
        said = self._capsys.readouterr()
        return Outcome(code, said.out, said.err)


@pytest.fixture
def cli(
    forked_workers: None, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> Cli:
    monkeypatch.chdir(ROOT)
    monkeypatch.delenv("WIL_DEBUG", raising=False)
    return Cli(capsys)


@pytest.fixture
def gate(tmp_path: Path) -> Path:
    """A copy of the shipped gate campaign, to be spoilt."""
    for folder in ("campaigns", "worlds", "recipes"):
        (tmp_path / folder).mkdir()
        shutil.copy(ROOT / folder / "gate.yaml", tmp_path / folder / "gate.yaml")
    shutil.copytree(ROOT / "campaigns" / "autonomies", tmp_path / "campaigns" / "autonomies")
    path = tmp_path / "campaigns" / "gate.yaml"
    path.write_text(path.read_text().replace("autonomies/gate.py:GateAutonomy", "gate"))
    return path


def test_validate_tells_what_a_good_file_holds(cli: Cli, tmp_path: Path) -> None:
    xml = tmp_path / "paper.xml"
    xml.write_text(
        '<recipe_file><AS_sensors><Camera id="c"/></AS_sensors>'
        '<combine id="c"><merge> prioritize_overlay.py </merge></combine></recipe_file>'
    )
    files = ("campaigns/gate.yaml", "worlds/gate.yaml", "recipes/gate.yaml", str(xml))
    outcome = cli("validate", *files)
    assert outcome.code == 0
    assert outcome.err == ""
    campaign, world, recipe, papers = outcome.out.splitlines()
    assert campaign.startswith("campaigns/gate.yaml: campaign 'gate', 20 runs (2 cases x 2 modes")
    assert world == "worlds/gate.yaml: a world of 2 objects"
    assert recipe == "recipes/gate.yaml: a recipe of 1 combination"
    assert papers == f"{xml}: a recipe of 1 combination"


def test_validate_shows_every_problem_with_its_line(cli: Cli, gate: Path) -> None:
    gate.write_text(gate.read_text().replace("vehicles:", "vehicels:"))
    world = gate.parents[1] / "worlds" / "gate.yaml"
    world.write_text(world.read_text().replace("room:", "rom:"))
    before = sorted(gate.parents[1].rglob("*"))
    outcome = cli("validate", str(gate))
    assert outcome.code == 2
    assert outcome.out == ""
    lines = outcome.err.splitlines()
    assert lines[0].endswith("unknown key 'vehicels'; did you mean 'vehicles'?")
    assert lines[1] == "    vehicels:"
    assert lines[2] == "    ^"
    assert any("unknown key 'rom'; did you mean 'room'?" in line for line in lines)
    assert lines[-1] == "2 problems in 2 files"
    assert sorted(gate.parents[1].rglob("*")) == before


def test_a_campaign_with_a_live_outlet_flies_on_the_wall_clock_alone(cli: Cli, gate: Path) -> None:
    gate.write_text(gate.read_text() + "deliver: [{rtp: '127.0.0.1:5600'}]\n")
    good = cli("validate", str(gate))
    assert good.code == 0
    assert good.out.endswith("; wall clock, for rtp 127.0.0.1:5600\n")
    assert cli("validate", str(gate), "--clock", "wall").code == 0
    last = len(gate.read_text().splitlines())
    for command in (("validate", str(gate)), ("run", str(gate), "--out", str(gate.parent))):
        bad = cli(*command, "--clock", "virtual")
        assert bad.code == 2
        said = "rtp 127.0.0.1:5600 runs in real time: use --clock wall"
        assert f"{gate}:{last}:11: {said}" in bad.err
    shared = cli("run", str(gate), "--out", str(gate.parent), "--jobs", "2")
    assert shared.code == 2
    assert "--jobs 2: runs of this campaign would share rtp 127.0.0.1:5600" in shared.err


def test_mavsdk_flies_on_the_wall_clock_and_no_other(cli: Cli, gate: Path) -> None:
    gate.write_text(
        gate.read_text().replace("profile: cage\n", "profile: cage\n    driver: mavsdk\n")
    )
    line = gate.read_text().splitlines().index("    driver: mavsdk") + 1
    good = cli("validate", str(gate))
    assert (good.code, good.err) == (0, "")
    assert good.out.endswith("; wall clock, for the driver mavsdk of real\n")
    said = "the driver mavsdk of real runs in real time: use --clock wall"
    for command in (("validate", str(gate)), ("run", str(gate), "--out", str(gate.parent))):
        for clock in ("virtual", "scaled"):
            bad = cli(*command, "--clock", clock)
            assert bad.code == 2
            assert f"{gate}:{line}:5: {said}" in bad.err


def test_an_unknown_driver_and_the_system_id_of_a_driver_are_refused(cli: Cli, gate: Path) -> None:
    text = gate.read_text()
    gate.write_text(text.replace("profile: cage\n", "profile: cage\n    driver: mavsd\n"))
    bad = cli("validate", str(gate))
    assert bad.code == 2
    assert "must be mavlink or mavsdk" in bad.err
    ours = "profile: cage\n    driver: mavsdk\n    system_id: 245\n"
    gate.write_text(text.replace("profile: cage\n", ours))
    bad = cli("validate", str(gate))
    assert bad.code == 2
    assert "the driver mavsdk uses system id 245 itself; give the vehicle another" in bad.err


@pytest.mark.parametrize("content", [b"", b"\x7fELF\x00", b"[1, 2]", b"a: [", b"\xff\xfe"])
def test_validate_survives_files_that_are_no_campaign(
    cli: Cli, tmp_path: Path, content: bytes
) -> None:
    path = tmp_path / "x.yaml"
    path.write_bytes(content)
    outcome = cli("validate", str(path), str(tmp_path / "none.yaml"))
    assert outcome.code == 2
    assert "Traceback" not in outcome.err
    assert outcome.err.endswith("2 problems in 2 files\n")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["valdate"], "Did you mean"),
        (["plan"], "file"),
        (["plan", "x", "--sed", "4"], "--sed"),
        (["plan", "x", "--seed", "four"], "four"),
        (["list", "things"], "things"),
        (["validate"], "at least one file"),
    ],
)
def test_usage_errors_are_reported_on_standard_error(
    cli: Cli, arguments: Sequence[str], said: str
) -> None:
    outcome = cli(*arguments)
    assert (outcome.code, outcome.out) == (2, "")
    assert said.lower() in outcome.err.lower()


def test_a_usage_error_says_what_is_needed_and_where_the_help_is(cli: Cli) -> None:
    assert cli("run").err == "wil-campaign run needs FILE.\nnext: wil-campaign run --help\n"
    assert cli("mix", "x.yaml", "--out", "y.png").err.startswith("wil-campaign mix needs --real.")
    option = cli("run", "x.yaml", "--case").err
    assert "--case requires an argument" in option
    assert option.endswith("next: wil-campaign run --help\n")
    assert cli("rn").err.endswith("next: wil-campaign --help\n")


def test_without_a_command_the_help_is_an_error(cli: Cli) -> None:
    outcome = cli()
    assert (outcome.code, outcome.out) == (2, "")
    assert "validate" in outcome.err


def test_the_help_has_four_sections_and_each_command_in_one(cli: Cli) -> None:
    text = cli("--help").out
    titles = ["Start: a campaign", "Fly ", "Look at what was flown", "Operate what flies"]
    places = [text.index(f"─ {title}") for title in titles]
    assert places == sorted(places)
    starts, flies, looks, _ = (text[a:b] for a, b in zip(places, [*places[1:], None], strict=True))
    assert "│ init" in starts
    assert "│ run " in flies
    assert "│ report" in looks
    assert text.count("│ abort") == 1


def test_help_of_each_command_is_at_hand(cli: Cli) -> None:
    assert "validate" in cli("--help").out
    for command in ("validate", "plan", "list"):
        outcome = cli(command, "--help")
        assert outcome.code == 0
        assert command in outcome.out
    assert cli("--version").out.strip()


@pytest.fixture
def broken(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise RuntimeError("a bug of ours")

    monkeypatch.setattr("wil_campaign.plugins.statistics.plan_command.load_campaign", fail)


@pytest.mark.usefixtures("broken")
def test_an_error_of_ours_is_a_sentence_and_a_file(
    cli: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    outcome = cli("plan", "x.yaml")
    assert outcome.code == 3
    assert "internal error: RuntimeError: a bug of ours" in outcome.err
    assert "Traceback" not in outcome.err
    (log,) = tmp_path.iterdir()
    assert str(log) in outcome.err
    assert "Traceback" in log.read_text()


@pytest.mark.usefixtures("broken")
def test_an_error_of_ours_is_shown_when_asked_for(
    cli: Cli, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("WIL_DEBUG", "1")
    outcome = cli("plan", "x.yaml")
    assert outcome.code == 3
    assert "Traceback" in outcome.err


@pytest.mark.parametrize("code", [None, 0, 1, "done"])
def test_an_exit_beneath_a_command_is_an_internal_error(
    cli: Cli, monkeypatch: pytest.MonkeyPatch, code: object
) -> None:
    # As of a plugin in flight: it would be the campaign's exit code, and 0 a green one.
    def leave(_: object) -> None:
        raise SystemExit(code)

    monkeypatch.setattr("wil_campaign.orchestrator.cli._call_command", leave)
    got = cli("validate", "x.yaml")
    assert got.code == 3
    assert "internal error: SystemExit" in got.err


def test_an_interrupt_is_130(cli: Cli, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("wil_campaign.plugins.statistics.plan_command.load_campaign", interrupt)
    got = cli("plan", "x.yaml")
    assert (got.code, got.err) == (130, "interrupted\n")


def test_help_imports_nothing_heavy_and_a_command_not_what_the_run_server_has() -> None:
    code = (
        "import sys; from wil_campaign.orchestrator.cli import main; code = main(['--help']);"
        "heavy = {'numpy', 'pydantic', 'cv2', 'numba', 'jsbsim', 'yaml'};"
        "print(sorted(heavy & set(sys.modules)), code, file=sys.stderr);"
        "code = main(['run', '--help']);"
        "ours = 'wil_campaign.orchestrator.run.';"
        "heavy = {'numba', 'scipy', ours + 'flight', ours + 'perception'};"
        "print(sorted(heavy & set(sys.modules)), code, file=sys.stderr)"
    )
    done = subprocess.run(  # noqa: S603 - our own interpreter
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert done.stderr.splitlines() == ["[] 0", "[] 0"]


def test_the_module_exits_as_main_returns() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "wil_campaign", "validate", "none.yaml"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("none.yaml: cannot be read")


def test_a_reader_that_goes_away_is_no_traceback() -> None:
    command = f"{sys.executable} -m wil_campaign list oracles --json | true"
    done = subprocess.run(  # noqa: S602 - our own interpreter
        command, shell=True, cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert "Traceback" not in done.stderr
    assert "BrokenPipe" not in done.stderr


def test_tables_line_up_and_are_never_cut() -> None:
    shown = table_lines(("name", "n"), [("a", 1), ("x" * 200, 100)])
    assert shown.splitlines()[0] == "name" + " " * 200 + "n"
    assert [len(line) for line in shown.splitlines()[1:]] == [205, 205, 205]
    assert "\x1b" not in table_lines(("name",), [("\x1b[31mred",)])
    assert table_lines(("name", "n"), []) == "name  n\n----  -"


def test_a_ground_station_cannot_follow_virtual_time(cli: Cli, tmp_path: Path) -> None:
    link = "udpout://127.0.0.1:14550"
    virtual = ("run", "campaigns/gate.yaml", "--out", str(tmp_path), "--clock", "virtual")
    outcome = cli(*virtual, "--gcs", link)
    assert (outcome.code, outcome.out) == (2, "")
    assert f"the ground station at {link} runs in real time: use --clock wall" in outcome.err
    outcome = cli(*virtual, "--gcs", "rael=" + link)
    assert outcome.code == 2
    assert "unknown key 'rael'; did you mean 'real'?" in outcome.err
