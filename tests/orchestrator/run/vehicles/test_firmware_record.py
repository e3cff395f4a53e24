"""The firmware of vehicles as they fly: identity, frame, a digest of parameters, and `accept`."""

import json
from pathlib import Path

import pytest

from tests.orchestrator.conftest import BRIEF, Fly
from tests.orchestrator.flights import log_of
from wil_campaign.orchestrator.cli import main
from wil_campaign.orchestrator.run_results.result_parts import FlownFirmware

ARDUPILOT = "vehicles.twin.autopilot=ardupilot"


def flown(fly_run: Fly, *sets: str) -> FlownFirmware:
    result, _ = fly_run(mode="sim", sets=(*sets, *BRIEF))
    (firmware,) = result.firmware
    return firmware


@pytest.mark.parametrize(
    ("sets", "says", "parameter"),
    [
        ((), ("px4", "1.18", "quadrotor, SYS_AUTOSTART 10040"), "MPC_XY_CRUISE=4.5"),
        ((ARDUPILOT,), ("ardupilot", "4.7", "quadrotor, FRAME_CLASS 1"), "WPNAV_SPEED_DN=140"),
    ],
    ids=["px4", "ardupilot"],
)
def test_the_firmware_and_a_digest_of_its_parameters(
    fly_run: Fly, sets: tuple[str, ...], says: tuple[str, ...], parameter: str
) -> None:
    one = flown(fly_run, *sets)
    assert (one.vehicle, one.autopilot, one.board) == ("twin", says[0], "emulated")
    assert one.version.startswith(says[1])
    assert one.frame.startswith(says[2])
    assert one.uid
    assert one.parameters
    again = flown(fly_run, *sets)
    assert again == one
    name, value = parameter.split("=")
    other = flown(fly_run, *sets, f"vehicles.twin.params={{{name}: {value}}}")
    assert other.parameters
    assert other.parameters != one.parameters
    assert other.kind == one.kind


def test_a_vehicle_with_another_version_than_accepted_does_not_arm(fly_run: Fly) -> None:
    result, folder = fly_run(mode="sim", sets=("accept={firmware: {twin: 1.16.0}}",))
    assert result.verdict == "ERROR"
    assert "twin firmware: it runs px4 1.18.0" in result.reason
    assert "and accept.firmware requires 1.16.0" in result.reason
    assert not any(line.get("kind") == "armed" for line in log_of(folder))
    assert [one.version for one in result.firmware] == ["1.18.0-beta"]


def test_the_accepted_version_flies(fly_run: Fly) -> None:
    result, _ = fly_run(mode="sim", sets=("accept={firmware: {twin: '1.18'}}", *BRIEF))
    assert [one.outcome for one in result.preflight if one.check == "firmware"] == ["ok"]


def test_the_firmware_that_flew_is_in_the_manifest_and_the_report(tmp_path: Path) -> None:
    root = Path(__file__).parents[4]
    main(
        ["run", str(root / "campaigns/gate.yaml"), "--case", "large", "--mode", "sim"]
        + ["--repetitions", "1", "--clock", "virtual", "--out", str(tmp_path), "--json"]
        + [f"--set={text}" for text in (*BRIEF, "controls={}")]
    )
    (manifest,) = tmp_path.glob("gate/*/campaign.json")
    (firmware,) = json.loads(manifest.read_text())["firmware"]
    assert (firmware["vehicle"], firmware["version"]) == ("twin", "1.18.0-beta")
    page = (manifest.parent / "report.html").read_text()
    assert "firmware of twin</dt><dd><bdi>px4 1.18.0-beta" in page
