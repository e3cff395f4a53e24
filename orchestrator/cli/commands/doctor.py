"""`wil-campaign doctor`: checks programs, ports, permissions and orphans of this machine."""

import json
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from orchestrator.cli.standard_streams import err, out
from orchestrator.cli.vehicle_check import check_vehicle
from orchestrator.doctor import installed, links, machine, ports, programs
from orchestrator.doctor.findings import Finding, as_text
from orchestrator.state.parameter_backups import parameter_backup_folder
from safety.guard.process.orphaned_processes import records
from safety.guard.process.runtime_folder import runtime_folders, unsafe_folders
from vehicles.launch.launch_records import find_orphans
from vehicles.links.serial_port import ports as serial_ports

REFUSED, TROUBLE = 2, 3


def doctor(
    *files: Path,
    out_: Annotated[Path, Parameter(name="--out")] = Path("results"),
    json_: Annotated[bool, Parameter(name="--json", negative=())] = False,
    vehicle: str | None = None,
    fly: Annotated[bool, Parameter(negative=())] = False,
    arm_real: Annotated[bool, Parameter(negative=())] = False,
) -> int:
    """Check installed packages, ports, autopilots, brokers, clocks and permissions.

    Exits with 3 when something prevents every campaign, or those named, from flying. With --vehicle
    it checks that vehicle only; with --fly it exits with 1 when the vehicle differs from the
    firmware that the embedded vehicles emulate.

    Parameters
    ----------
    files
        Campaign files, whose links are opened for a moment as well. Nothing is sent on them.
    out_
        The folder where results are to go.
    json_
        Print one JSON document.
    vehicle
        The link to a vehicle, as udpin://127.0.0.1:14540, to be identified.
    fly
        Fly that vehicle, which must be a simulator, through step responses in real time (about
        three minutes), and compare its figures and the order of its events with the firmware's.
    arm_real
        Consent to arming the vehicle.
    """
    if vehicle is not None or fly:
        if files:
            err("--vehicle and --fly check a vehicle only; leave the campaign files out")
            return REFUSED
        return check_vehicle(vehicle, fly=fly, arm_real=arm_real, results=out_, as_json=json_)
    findings = [*_findings(out_), *links.campaign_links(files)]
    if json_:
        out(json.dumps([asdict(one) for one in findings], indent=2, ensure_ascii=False))
    else:
        out(as_text(findings))
    return TROUBLE if any(one.grade == "trouble" for one in findings) else 0


def _findings(results: Path) -> Iterable[Finding]:
    """Yield all findings of `doctor`."""
    yield from installed.python()
    yield from installed.packages()
    yield from installed.drivers()
    yield from installed.foreign_packages()
    yield from programs.autopilots(Path.home())
    yield from programs.brokers()
    yield from ports.usual_ports()
    yield from machine.serial(serial_ports())
    yield from machine.clock(
        machine.wakes_late_s(), synchronised=machine.clock_synchronised(), now=machine.utc()
    )
    scheduling, in_memory = machine.granted_to_guard()
    yield from machine.guard_privileges(scheduling, in_memory=in_memory)
    yield from machine.disk(next(one for one in (results, *results.parents) if one.is_dir()))
    yield from _orphans(results)


def _orphans(results: Path) -> Iterable[Finding]:
    """Yield doctor's findings about orphaned processes and parameter backups."""
    launches = find_orphans(results) if results.is_dir() else ()
    for text in unsafe_folders():
        yield Finding(machine.LEFT, "trouble", f"{text}; remove it")
    guards = tuple(record for folder in runtime_folders() for record in records(folder))
    yield from machine.orphans(launches, guards, parameter_backup_folder())
