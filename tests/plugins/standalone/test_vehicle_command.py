"""`wil-campaign vehicle`: what it refuses, and what it gives to the process of the vehicle."""

from pathlib import Path

import pytest

from wil_campaign.orchestrator.cli import main
from wil_campaign.plugins.standalone import vehicle_command as command
from wil_campaign.vehicles.embedded.process.process_settings import ProcessSettings

WORLD = """\
schema: wil/world/1
origin: {latitude_deg: 46.5, longitude_deg: 7.5, altitude_m: 500}
objects:
  box: {shape: {box: {size_m: [1, 1, 1]}}, pose: {north_m: 3, up_m: 1}}
"""


@pytest.fixture
def flown(monkeypatch: pytest.MonkeyPatch) -> list[ProcessSettings]:
    """Take the settings instead of flying them."""
    given: list[ProcessSettings] = []

    def take(settings: ProcessSettings, _: object) -> int:
        given.append(settings)
        return 0

    monkeypatch.setattr(command, "run_process", take)
    return given


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--param", "MIS_TAKEOF_ALT=3"), "did you mean 'MIS_TAKEOFF_ALT'?"),
        (("--param", "MIS_TAKEOFF_ALT=high"), "must be NAME=VALUE with a number"),
        (("--param", "MIS_TAKEOFF_ALT"), "must be NAME=VALUE with a number"),
        (("--profile", "caeg"), "no profile 'caeg'"),
        (("--speed", "0"), "--speed: "),
        (("--running", "nan"), "--running: "),
        (("--seed", "-1"), "--seed: "),
        (("--running", "-1"), "--running: "),
        (("--system-id", "300"), "--system-id: "),
        (("--link", "udp:14550"), "udp:14550"),
        (("--world", "nowhere.yaml"), "nowhere.yaml"),
        (("--fault", "moter@12"), "--fault 'moter@12' is not a fault; there are kill, mute, "),
        (("--fault", "motor@soon"), "--fault 'motor@soon' is not a fault"),
        (("--fault", "mute@1+2", "--fault", "camera stop"), "no camera; give --camera"),
        (("--video", "127.0.0.1:5600"), "no camera; give --camera"),
        (("--mocap", "5570"), "--mocap 5570: must be HOST:PORT"),
        (("--mocap", "127.0.0.1:70000"), "--mocap 127.0.0.1:70000: must be HOST:PORT"),
        (("--camera",), "--camera: give --world FILE too"),
        (("--camera", "--world", "WORLD", "--video", "5600"), "--video '5600' must be HOST:PORT"),
        (("--camera", "--world", "WORLD", "--video", "a:5601"), "RTP needs an even port"),
        (("--camera", "--world", "WORLD", "--video", "a:70000"), "must be HOST:PORT"),
    ],
)
def test_a_wrong_argument_is_reported_before_anything_flies(
    flown: list[ProcessSettings],
    capsys: pytest.CaptureFixture[str],
    arguments: tuple[str, ...],
    said: str,
    tmp_path: Path,
) -> None:
    world = tmp_path / "world.yaml"
    world.write_text(WORLD)
    given = [str(world) if argument == "WORLD" else argument for argument in arguments]
    assert main(["vehicle", "px4", *given]) == 2
    assert said in capsys.readouterr().err
    assert not flown


def test_the_arguments_of_the_command_reach_the_vehicle(
    flown: list[ProcessSettings], tmp_path: Path
) -> None:
    world = tmp_path / "world.yaml"
    world.write_text(WORLD)
    assert (
        main(["vehicle", "px4", "--param", "MIS_TAKEOFF_ALT=3", "--speed", "4", "--running", "60"])
        == 0
    )
    faults = ("--fault", "motor@12", "--fault", "pose_source freeze@3+2")
    assert main(["vehicle", "ardupilot", "--world", str(world), "--system-id", "7", *faults]) == 0
    px4, copter = flown
    assert (px4.link, px4.speed, px4.running_s) == ("udpout://127.0.0.1:14540", 4.0, 60.0)
    assert px4.parameters == {"MIS_TAKEOFF_ALT": 3.0}
    assert px4.faults == ()
    assert copter.faults == ("motor 0 0.0@12", "pose_source freeze@3+2")
    assert (copter.link, copter.system_id) == ("tcpin://127.0.0.1:5760", 7)
    assert (copter.latitude_deg, copter.altitude_m) == (46.5, 500.0)
    assert copter.contact_world is not None
    assert "box" in copter.contact_world.argument
