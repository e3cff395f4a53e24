"""Launching real processes: they start, end for certain, and what goes wrong is said in words."""

import asyncio
import os
import signal
import socket
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from tests.plugins.firmware.launched_vehicle import LaunchedVehicle
from wil_campaign.foundation.processes.identity import ProcessId, boot_id
from wil_campaign.plugins.ardupilot.launch import ArduPilotLaunch
from wil_campaign.plugins.firmware.launch_plan import LaunchPort
from wil_campaign.plugins.firmware.launch_records import (
    RECORD,
    LaunchRecord,
    find_orphaned_launches,
)
from wil_campaign.plugins.firmware.prepared_launch import (
    PreparedLaunch,
    is_port_free,
    receive_instance,
)
from wil_campaign.plugins.firmware.px4_launch import Px4Launch
from wil_campaign.vehicles.launch import LaunchError, LaunchHome

HOME = LaunchHome(47.4, 8.5, 488.0, 90.0)


def _vehicle(sims: Any, binary: Path, name: str = "real", **options: Any) -> LaunchedVehicle:
    launch = ArduPilotLaunch(binary=binary, home=HOME)
    folder = sims.folder / name
    return LaunchedVehicle(launch=launch, folder=folder, system_id=3, locks=sims.locks, **options)


async def test_ardupilot_runs_and_ends(sims: Any) -> None:
    binary = sims.program(sims.ardupilot)
    async with _vehicle(sims, binary) as vehicle:
        assert vehicle.link.kind == "tcpout"
        port = vehicle.link.port
        assert (port - 5760) % 10 == 0
        # Nobody has connected so far: the first client is the only one that it hears.
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        writer.close()
        assert (sims.folder / "real" / "eeprom.bin").exists()
        pid = sims.pid_of(binary)
        assert ProcessId.of(pid) is not None
        arguments = sims.arguments(pid)
        assert arguments[arguments.index("--sysid") + 1] == "3"
        assert arguments[arguments.index("--home") + 1] == "47.4000000,8.5000000,488.00,90.0"
    assert sims.gone(pid, 0.0)
    assert "Waiting for connection" in vehicle.output.read_text()
    assert is_port_free(LaunchPort(port, "tcp"))
    assert not sims.files(RECORD)
    del reader


def test_parameters_of_the_campaign_are_there_when_it_boots(sims: Any, tmp_path: Path) -> None:
    binary = sims.program(sims.ardupilot)
    (tmp_path / "own.parm").write_text("")
    params = (("AVOID_MARGIN", 1.25), ("PRX1_TYPE", 2.0))
    launch = ArduPilotLaunch(binary=binary, defaults=(tmp_path / "own.parm",), params=params)
    folder = tmp_path / "twin"
    with PreparedLaunch(launch=launch, folder=folder, system_id=3, locks=sims.locks) as prepared:
        argv = prepared.plan.argv
        given = argv[argv.index("--defaults") + 1].split(",")
        # Later files win: the campaign's is the last.
        assert given == [str(tmp_path / "own.parm"), str(folder / "campaign.parm")]
        assert (folder / "campaign.parm").read_text() == "AVOID_MARGIN 1.25\nPRX1_TYPE 2\n"
    px4 = Px4Launch(image="x", params=(("EKF2_EV_CTRL", 15.0), ("MPC_XY_VEL_MAX", 0.1)))
    # PX4 sets its system id and some time-outs itself, after those of the environment.
    assert px4._hook(2) == (
        "param set MAV_SYS_ID 2\n"
        "param set EKF2_EV_CTRL 15\n"
        "param set MPC_XY_VEL_MAX 0.1\n"
        '. "${R}etc/init.d-posix/px4-rc.simulator"\n'
    )


def test_without_parameter_files_those_of_its_tree_are_taken(sims: Any, tmp_path: Path) -> None:
    """A real ArduCopter 4.7 without any has FRAME_CLASS 0, and says so until it is given up."""
    binary = sims.program(sims.ardupilot, name="build/sitl/bin/arducopter")
    tree = sims.folder / "Tools" / "autotest" / "default_params"
    for name in ("hexa", "hexa-dji"):
        (tree / f"copter-{name}.parm").touch()

    def files(frame: str) -> list[str]:
        launch = ArduPilotLaunch(binary=binary, frame=frame)
        argv = launch.plan(instance=0, system_id=1, folder=tmp_path).argv
        return [Path(one).name for one in argv[argv.index("--defaults") + 1].split(",")]

    assert files("quad") == ["copter.parm"]
    assert files("hexa-dji:@ROMFS/x.json") == [
        "copter.parm", "copter-hexa.parm", "copter-hexa-dji.parm",
    ]  # fmt: skip


def test_an_arducopter_without_a_frame_is_not_started(sims: Any) -> None:
    binary = sims.program(sims.ardupilot)
    (sims.folder / "Tools" / "autotest" / "default_params" / "copter.parm").unlink()
    with pytest.raises(LaunchError, match=r"FRAME_CLASS is 0 and it never arms; name that file"):
        ArduPilotLaunch(binary=binary).check()
    ArduPilotLaunch(binary=binary, params=(("FRAME_CLASS", 1.0),)).check()


async def test_two_launched_vehicles_share_no_port(sims: Any) -> None:
    binary = sims.program(sims.ardupilot)
    async with (
        _vehicle(sims, binary) as real,
        _vehicle(sims, binary, "twin") as twin,
    ):
        assert real.link.port != twin.link.port


def _px4_build(sims: Any, body: str) -> Path:
    binary: Path = sims.program(body, name="build/bin/px4")
    build = binary.parent.parent
    rcs = build / "etc" / "init.d-posix" / "rcS"
    rcs.parent.mkdir(parents=True)
    rcs.touch()
    return build


async def test_px4_runs_from_a_build(sims: Any) -> None:
    build = _px4_build(sims, sims.px4)
    launch = Px4Launch(build=build, pace=2.0, home=HOME)
    vehicle = LaunchedVehicle(
        launch=launch, folder=sims.folder / "twin", system_id=7, locks=sims.locks
    )
    async with vehicle:
        assert vehicle.link.kind == "udpin"
        assert 14540 <= vehicle.link.port <= 14549
        pid = sims.pid_of(build / "bin" / "px4")
        environment = sims.environment(pid)
        for wanted in (
            "PX4_SIM_MODEL=sihsim_quadx", "PX4_SIM_SPEED_FACTOR=2",
            "PX4_HOME_LAT=47.4000000", "PX4_HOME_YAW=90.0",
        ):  # fmt: skip
            assert wanted in environment
        assert any(one.startswith(f"PATH={sims.folder / 'twin'}:") for one in environment)
        assert "MAV_SYS_ID 7" in (sims.folder / "twin" / "px4-rc.simulator").read_text()
        assert sims.works_in(pid) == sims.folder / "twin"


@pytest.mark.parametrize(
    ("body", "ready_s", "words"),
    [
        ("print('loading'); print('segmentation is near', flush=True); os.abort()", 60.0,
         r"(?s)ended with signal 6.*segmentation is near"),
        ("sys.exit(3)", 60.0, "ended with exit code 3; it last printed:\nit printed nothing"),
        ("print('Vehicle model (kite) not found', flush=True); time.sleep(600)", 60.0,
         r"does not start: Vehicle model \(kite\) not found"),
        ("print('bind failed on port 5760 - Address already in use', flush=True); time.sleep(600)",
         60.0, "does not start: bind failed on port 5760"),
        ("print('ERROR: no sensors', flush=True); time.sleep(600)", 10.0,
         r"not ready after 10 s: ERROR: no sensors .*output\.txt"),
        ("time.sleep(600)", 10.0, "not ready after 10 s: it printed nothing"),
    ],
)  # fmt: skip
async def test_a_failed_start_is_reported_and_gives_the_instance_back(
    sims: Any, body: str, ready_s: float, words: str
) -> None:
    binary: Path = sims.program(body)
    with pytest.raises(LaunchError, match=words):
        await _vehicle(sims, binary, ready_s=ready_s).__aenter__()
    assert sims.gone(sims.pid_of(binary))
    # The instance is given back.
    receive_instance(ArduPilotLaunch(binary=binary), locks=sims.locks).close()


def test_a_missing_program_or_docker_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    binary = tmp_path / "arducopter"
    with pytest.raises(LaunchError, match=r"there is no program .*arducopter"):
        ArduPilotLaunch(binary=binary).check()
    binary.touch()
    with pytest.raises(LaunchError, match="chmod"):
        ArduPilotLaunch(binary=binary).check()
    with pytest.raises(LaunchError, match="is a folder"):
        ArduPilotLaunch(binary=tmp_path).check()
    with pytest.raises(LaunchError, match="there is no build folder"):
        Px4Launch(build=tmp_path / "none").check()
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(LaunchError, match="docker is not installed"):
        Px4Launch(image="px4io/px4-sitl:v1.18.0").check()
    with pytest.raises(ValueError, match="give one"):
        Px4Launch()


async def test_a_scratch_folder_is_new(sims: Any) -> None:
    (sims.folder / "real").mkdir()
    with pytest.raises(LaunchError, match="File exists"):
        await _vehicle(sims, sims.program("pass")).__aenter__()


async def test_dying_in_flight_is_reported(sims: Any) -> None:
    binary = sims.program(sims.ardupilot)
    told: asyncio.Queue[LaunchError] = asyncio.Queue()
    async with _vehicle(sims, binary, on_end=told.put_nowait):
        os.kill(sims.pid_of(binary), signal.SIGSEGV)
        async with asyncio.timeout(60.0):
            error = await told.get()
    assert "ended with signal 11" in str(error)
    assert "Waiting for connection" in str(error)


STUBBORN = """
signal.signal(signal.SIGTERM, signal.SIG_IGN)
child = subprocess.Popen([sys.executable, "-S", "-c",
    "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); time.sleep(600)"],
    start_new_session=True)
open(sys.argv[0] + ".child", "w").write(str(child.pid))
"""


async def test_a_process_that_ignores_sigterm_or_fled_ends_too(sims: Any) -> None:
    binary = sims.program(STUBBORN + sims.ardupilot)
    async with _vehicle(sims, binary, grace_s=0.3):
        pids = [sims.pid_of(binary), int(sims.beside(binary, "child"))]
        sims.mourned += pids
        assert all(ProcessId.of(pid) is not None for pid in pids)
    assert all(sims.gone(pid) for pid in pids)


OWNER = """
import asyncio, os, sys
from pathlib import Path
from wil_campaign.plugins.ardupilot.launch import ArduPilotLaunch
from tests.plugins.firmware.launched_vehicle import LaunchedVehicle

async def main(binary, folder, locks):
    launch = ArduPilotLaunch(binary=Path(binary))
    vehicle = LaunchedVehicle(launch=launch, folder=Path(folder), system_id=1, locks=Path(locks))
    async with vehicle:
        print(vehicle.pid, flush=True)
        await asyncio.sleep(600)

asyncio.run(main(*sys.argv[1:]))
"""


def _owner(binary: Path, folder: Path, locks: Path) -> tuple[subprocess.Popen[str], int]:
    owner = subprocess.Popen(  # noqa: S603 - our own program
        [sys.executable, "-c", OWNER, str(binary), str(folder), str(locks)],
        stdout=subprocess.PIPE,
        text=True,
    )
    assert owner.stdout is not None
    return owner, int(owner.stdout.readline())


def _kill(owner: subprocess.Popen[str]) -> None:
    owner.kill()
    owner.wait()
    assert owner.stdout is not None
    owner.stdout.close()


def test_all_end_when_we_are_killed(sims: Any) -> None:
    binary = sims.program(sims.ardupilot)
    owner, supervisor = _owner(binary, sims.folder / "real", sims.locks)
    _kill(owner)
    assert sims.gone(sims.pid_of(binary))
    assert sims.gone(supervisor)
    assert find_orphaned_launches(sims.folder) == ()


def test_orphans_are_found_named_and_ended(sims: Any) -> None:
    # The worst: owner and supervisor are killed at once, and what the simulator started lives on.
    binary = sims.program(STUBBORN + sims.ardupilot)
    folder = sims.folder / "real"
    owner, supervisor = _owner(binary, folder, sims.locks)
    child = int(sims.beside(binary, "child"))
    sims.mourned += [supervisor, child]
    assert find_orphaned_launches(sims.folder) == (), "its owner lives"
    os.kill(supervisor, signal.SIGKILL)
    _kill(owner)
    assert sims.gone(sims.pid_of(binary)), "the kernel ends it with its supervisor"
    (found,) = find_orphaned_launches(sims.folder)
    assert found.label == "ArduPilot SITL"
    (survivor,) = found.survivors()
    assert survivor == ProcessId.of(child)
    assert Path(found.folder) == folder
    assert survivor.end() == "ended by SIGKILL"
    assert sims.gone(child)
    assert find_orphaned_launches(sims.folder) == ()


def _record(folder: Path, **fields: Any) -> LaunchRecord:
    folder.mkdir(exist_ok=True)
    values: dict[str, Any] = {
        "label": "x", "folder": str(folder), "supervisor": ProcessId.own(),
        "owner": ProcessId(1 << 22, 5), "boot_id": boot_id(), "command": ("x",), "cleanup": (),
    } | fields  # fmt: skip
    record = LaunchRecord(**values)
    record.write()
    return record


def test_an_id_that_was_used_again_is_no_orphan(tmp_path: Path) -> None:
    own = ProcessId.own()
    assert find_orphaned_launches(tmp_path) == ()
    record = _record(tmp_path / "a")
    assert find_orphaned_launches(tmp_path) == (record,)
    assert record.supervisor == ProcessId.of(os.getpid())
    _record(tmp_path / "a", supervisor=ProcessId(own.pid, own.started + 1))
    assert find_orphaned_launches(tmp_path) == ()
    _record(tmp_path / "a", boot_id="another boot")
    assert find_orphaned_launches(tmp_path) == ()
    _record(tmp_path / "a", owner=own)
    assert find_orphaned_launches(tmp_path) == ()


@pytest.mark.parametrize("text", ["", "{", "[]", "{}", '{"supervisor": 3}', "\udcff"])
def test_a_spoilt_record_names_no_process(tmp_path: Path, text: str) -> None:
    (tmp_path / RECORD).write_bytes(text.encode(errors="surrogateescape"))
    assert find_orphaned_launches(tmp_path) == ()


def test_instances_avoid_locks_and_busy_ports(sims: Any) -> None:
    launch = ArduPilotLaunch(binary=sims.folder / "x")
    with (
        receive_instance(launch, locks=sims.locks) as one,
        receive_instance(launch, locks=sims.locks) as two,
    ):
        assert one.number < two.number
        with socket.socket() as taken:
            free = two.number + 1
            while not all(is_port_free(port) for port in launch.ports(free)):
                free += 1
            taken.bind(("127.0.0.1", launch.ports(free)[1].number))
            taken.listen()
            with receive_instance(launch, locks=sims.locks) as three:
                assert three.number > free
    with receive_instance(launch, locks=sims.locks) as again:
        assert again.number == one.number


def test_a_launch_without_a_free_instance_is_an_error(sims: Any) -> None:
    launch = Px4Launch(image="x")
    with ExitStack() as held:

        def take_all() -> None:
            for _ in range(11):
                held.enter_context(receive_instance(launch, locks=sims.locks))

        with pytest.raises(LaunchError, match="all 10 instances are in use"):
            take_all()


DOCKER = """
open(sys.argv[0] + ".args", "a").write(" ".join(sys.argv[1:]) + "\\n")
if sys.argv[1] == "run":
    if "missing" in sys.argv:
        print("docker: Error response from daemon: No such image: missing", flush=True)
        sys.exit(125)
    print("INFO  [px4] Startup script returned successfully", flush=True)
    time.sleep(600)
"""


async def test_px4_in_a_container_through_the_client(
    sims: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    docker = sims.program(DOCKER, name="docker")
    monkeypatch.setenv("PATH", str(docker.parent))
    launch = Px4Launch(image="px4io/px4-sitl:v1.18.0")
    vehicle = LaunchedVehicle(
        launch=launch, folder=sims.folder / "twin", system_id=2, locks=sims.locks
    )
    async with vehicle:
        instance = vehicle.link.port - 14540
    run, remove = sims.beside(docker, "args").splitlines()
    assert run.startswith("run --rm --init --pull never --network host --name wil-px4-")
    assert run.endswith(f"px4io/px4-sitl:v1.18.0 -d -i {instance}")
    assert "-e PATH=/wil:/usr/local/sbin:" in run
    name = run.partition("--name ")[2].split()[0]
    assert remove == f"rm --force {name}"
    missing = LaunchedVehicle(
        launch=Px4Launch(image="missing"),
        folder=sims.folder / "none",
        system_id=2,
        locks=sims.locks,
    )
    with pytest.raises(LaunchError, match="No such image: missing"):
        await missing.__aenter__()
