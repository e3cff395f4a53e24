"""`wil-campaign doctor --vehicle LINK`: identifies a vehicle, or has a plugin check it."""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from wil_campaign.foundation.files.document_writer import to_json
from wil_campaign.hooks import vehicle_checks
from wil_campaign.installed_plugins import absent_additions, load_plugin_object, plugin_additions
from wil_campaign.orchestrator.campaign.resuming.attached_vehicles import AttachedVehicle
from wil_campaign.orchestrator.cli.arming_consent import (
    REFUSED,
    UNAVAILABLE,
    FlightRefusedError,
    find_vehicle_to_arm,
)
from wil_campaign.orchestrator.cli.standard_streams import write_stderr, write_stdout
from wil_campaign.vehicles.errors import VehicleError
from wil_campaign.vehicles.links.link_strings import LinkAddress, LinkAddressError, parse_link


def check_vehicle(
    link: str | None, checks: Iterable[str], *, arm_real: bool, results: Path, as_json: bool
) -> int:
    """Identify the vehicle at a link, and check it; print the result; return the exit code.

    checks: of plugins, by name.
    """
    names = [*checks]
    if len(names) > 1:
        write_stderr(f"--{names[0]} and --{names[1]}: one check at a time")
        return REFUSED
    for name in names:
        if why := absent_additions(vehicle_checks).get(name):
            write_stderr(why)
            return REFUSED
        check: Callable[..., int] = load_plugin_object(plugin_additions(vehicle_checks)[name].check)
        return check(link, arm_real=arm_real, results=results, as_json=as_json)
    try:
        found = find_vehicle_to_arm(vehicle_address(link or ""))
    except (FlightRefusedError, VehicleError) as error:
        write_stderr(error)
        return check_exit_code(error)
    write_stdout(to_json(identity_document(found)).rstrip() if as_json else found)
    return 0


def vehicle_address(link: str) -> LinkAddress:
    """Return the address of the vehicle to be checked. Raises LinkAddressError."""
    address = parse_link(link)
    if address.kind == "memory":
        raise LinkAddressError("--vehicle memory://: no other process can use this link")
    return address


def check_exit_code(error: Exception) -> int:
    """Return the exit code of a check that an error ended before the vehicle flew."""
    if isinstance(error, FlightRefusedError):
        return error.code
    return REFUSED if isinstance(error, LinkAddressError) else UNAVAILABLE


def identity_document(found: AttachedVehicle) -> dict[str, Any]:
    """Return the identity of an attached vehicle as plain values."""
    identity = found.identity
    return {
        "link": found.address,
        "autopilot": identity.autopilot,
        "version": identity.version_text,
        "type": identity.vehicle_type,
        "system_id": identity.system_id,
        "git_hash": identity.git_hash,
        "simulation": identity.simulation,
        "armed": found.armed,
    }
