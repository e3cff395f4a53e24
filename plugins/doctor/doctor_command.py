"""`wil-campaign doctor`: checks programs, ports, permissions and orphans of this machine."""

import json
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from wil_campaign.foundation.files.own_folders import home_folder
from wil_campaign.foundation.files.paths import is_folder
from wil_campaign.hooks import operator_channels, vehicle_checks
from wil_campaign.installed_plugins import load_plugin_object, plugin_additions
from wil_campaign.orchestrator.cli.plugin_options import (
    NO_OPTIONS,
    PluginOptions,
    given_options,
    takes_options,
)
from wil_campaign.orchestrator.cli.standard_streams import write_stderr, write_stdout
from wil_campaign.orchestrator.state.parameter_backups import NoHomeError, parameter_backup_folder
from wil_campaign.plugins.doctor import installed, links, machine, ports, programs
from wil_campaign.plugins.doctor.findings import Finding, findings_text
from wil_campaign.plugins.doctor.vehicle_check import check_vehicle
from wil_campaign.plugins.firmware.launch_records import find_orphaned_launches
from wil_campaign.plugins.stream_links.serial_port import likely_serial_ports as serial_ports
from wil_campaign.safety.guard.process.orphaned_processes import guard_records
from wil_campaign.safety.guard.process.runtime_folder import runtime_folders, unsafe_folders
from wil_campaign.worlds.jit import find_kernel_cache

REFUSED, TROUBLE = 2, 3


@takes_options(vehicle_checks, "checks", bool)
def doctor(
    *files: Path,
    out_: Annotated[Path, Parameter(name="--out")] = Path("results"),
    json_: Annotated[bool, Parameter(name="--json", negative=())] = False,
    vehicle: str | None = None,
    checks: PluginOptions = NO_OPTIONS,
    arm_real: Annotated[bool, Parameter(negative=())] = False,
) -> int:
    """Check installed packages, ports, autopilots, brokers, clocks and permissions.

    Exits with 3 when something prevents every campaign, or those named, from flying. With --vehicle
    it checks that vehicle only.

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
    arm_real
        Consent to arming the vehicle.
    """
    wanted = given_options(checks)
    if vehicle is not None or wanted:
        if files:
            write_stderr("--vehicle checks one vehicle and no files; leave the campaign files out")
            return REFUSED
        return check_vehicle(vehicle, wanted, arm_real=arm_real, results=out_, as_json=json_)
    findings = [*_findings(out_), *links.campaign_link_findings(files)]
    if json_:
        write_stdout(
            json.dumps([asdict(finding) for finding in findings], indent=2, ensure_ascii=False)
        )
    else:
        write_stdout(findings_text(findings))
    return TROUBLE if any(finding.grade == "trouble" for finding in findings) else 0


def _findings(results: Path) -> Iterable[Finding]:
    """Yield all findings of `doctor`."""
    yield from installed.python_finding()
    yield from installed.package_findings()
    yield from installed.plugin_findings()
    yield from installed.driver_findings()
    yield from programs.autopilot_program_findings(home_folder())
    for channel in plugin_additions(operator_channels).values():
        yield from load_plugin_object(channel.machine)()
    yield from ports.usual_port_findings()
    yield from machine.serial_port_findings(serial_ports())
    yield from machine.clock_findings(
        machine.wakes_late_s(),
        stalled_s=machine.stalls_s(),
        synchronised=machine.clock_synchronised(),
        now=machine.clock_utc(),
    )
    scheduling, in_memory = machine.granted_to_guard()
    yield from machine.guard_privileges(scheduling, in_memory=in_memory)
    yield from machine.kernel_cache_finding(find_kernel_cache())
    yield from machine.socket_folder_finding()
    yield from machine.disk_finding(results)
    yield from _orphans(results)


def _orphans(results: Path) -> Iterable[Finding]:
    """Yield doctor's findings about orphaned processes and parameter backups."""
    launches = find_orphaned_launches(results) if is_folder(results) else ()
    for text in unsafe_folders():
        yield Finding(machine.LEFT, "trouble", f"{text}; remove it")
    guards = tuple(record for folder in runtime_folders() for record in guard_records(folder))
    backups = None
    try:
        backups = parameter_backup_folder()
    except NoHomeError as error:
        yield Finding(machine.LEFT, "note", str(error))
    yield from machine.orphan_findings(launches, guards, backups)
