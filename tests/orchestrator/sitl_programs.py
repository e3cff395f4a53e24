"""Stand-ins for the autopilots' own simulations: their command lines, our embedded vehicle.

Run as a program: `python -m tests.orchestrator.sitl_programs ardupilot|px4 ARGUMENT...`.
"""

import os
import stat
import sys
from pathlib import Path

from wil_campaign.vehicles.embedded.emulations import load_kernels
from wil_campaign.vehicles.embedded.process.embedded_process import main as fly
from wil_campaign.vehicles.embedded.process.process_settings import ProcessSettings

ROOT = Path(__file__).parents[2]
_PROGRAM = """#!/bin/sh
PYTHONPATH={root} exec {python} -m tests.orchestrator.sitl_programs {kind} "$@"
"""


def make_arducopter(folder: Path) -> Path:
    """Make a program that is started as arducopter is, beneath the parameters of its tree."""
    make_tree(folder)
    return _make(folder / "arducopter", "ardupilot")


def make_tree(folder: Path) -> None:
    """Make the parameter files of ArduPilot's source tree: without any, it is not launched."""
    tree = folder / "Tools" / "autotest" / "default_params"
    tree.mkdir(parents=True, exist_ok=True)
    (tree / "copter.parm").write_text("")


def make_px4_build(folder: Path) -> Path:
    """Make a build folder whose bin/px4 is started as PX4 is."""
    build = folder / "px4_sitl_default"
    rc = build / "etc" / "init.d-posix" / "rcS"
    rc.parent.mkdir(parents=True)
    rc.write_text("")
    (build / "bin").mkdir()
    _make(build / "bin" / "px4", "px4")
    return build


def _make(file: Path, kind: str) -> Path:
    file.write_text(_PROGRAM.format(root=ROOT, python=sys.executable, kind=kind))
    file.chmod(file.stat().st_mode | stat.S_IXUSR)
    return file


def _say(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def _reached(asked: float) -> float:
    """Return what pace a simulator comes to: of more than real time not all."""
    return asked if asked == 1.0 else 0.9 * asked


def _ardupilot(arguments: list[str]) -> ProcessSettings:
    given = dict(zip(arguments[::2], arguments[1::2], strict=True))
    port = 5760 + 10 * int(given["--instance"])
    latitude, longitude, altitude, _ = map(float, given["--home"].split(","))
    _say(f"SERIAL0 on TCP port {port}")
    _say(f"asked for {float(given['--speedup']):g} times real time")
    files = [Path(file) for file in given.get("--defaults", "").split(",") if file]
    rows = [row.split() for file in files for row in file.read_text().splitlines()]
    return ProcessSettings(
        autopilot="ardupilot",
        link=f"tcpin://127.0.0.1:{port}",
        seed=5,
        running_s=39.0,
        speed=_reached(float(given["--speedup"])),
        system_id=int(given["--sysid"]),
        latitude_deg=latitude,
        longitude_deg=longitude,
        altitude_m=altitude,
        parameters={name: float(value) for name, value in rows},
    )


def _px4_parameters(instance: int) -> dict[str, float]:
    """Return what rcS sets, in its order: the environment's, its own, the hook's."""
    given = {
        name.removeprefix("PX4_PARAM_"): float(value)
        for name, value in os.environ.items()
        if name.startswith("PX4_PARAM_")
    }
    if "PX4_SIM_SPEED_FACTOR" in os.environ:
        speed = float(os.environ["PX4_SIM_SPEED_FACTOR"])
        given |= {"COM_DL_LOSS_T": 10.0 * speed, "COM_OF_LOSS_T": speed}
    given["MAV_SYS_ID"] = instance + 1.0
    for folder in os.environ["PATH"].split(":"):
        hook = Path(folder) / "px4-rc.simulator"
        if hook.is_file():
            rows = [row.split() for row in hook.read_text().splitlines()]
            return given | {row[2]: float(row[3]) for row in rows if row[:2] == ["param", "set"]}
    return given


def _px4(arguments: list[str]) -> ProcessSettings:
    instance = int(arguments[arguments.index("-i") + 1])
    parameters = _px4_parameters(instance)
    _say("INFO  [px4] Startup script returned successfully")
    return ProcessSettings(
        autopilot="px4",
        link=f"udpout://127.0.0.1:{14540 + instance}",
        seed=6,
        speed=_reached(float(os.environ["PX4_SIM_SPEED_FACTOR"])),
        system_id=int(parameters.pop("MAV_SYS_ID")),
        latitude_deg=float(os.environ["PX4_HOME_LAT"]),
        longitude_deg=float(os.environ["PX4_HOME_LON"]),
        altitude_m=float(os.environ["PX4_HOME_ALT"]),
        parameters=parameters,
    )


if __name__ == "__main__":
    load_kernels()  # before it says that it listens, for then it is given seconds to answer
    build = {"ardupilot": _ardupilot, "px4": _px4}[sys.argv[1]]
    sys.exit(fly([build(sys.argv[2:]).model_dump_json()]))
