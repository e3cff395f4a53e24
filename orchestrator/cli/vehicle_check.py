"""`wil-campaign doctor --vehicle LINK --fly`: compares a simulator with real firmware."""

import math
import tempfile
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from orchestrator.campaign.resuming.attached_vehicles import AttachedVehicle
from orchestrator.cli.arming_consent import (
    REFUSED,
    UNAVAILABLE,
    RefusedError,
    clear_vehicle,
    find_vehicle,
)
from orchestrator.cli.standard_streams import err, out
from orchestrator.cli.text_table import table
from orchestrator.doctor.step_responses import Flown, OperatorAbortError, fly_step_responses
from orchestrator.model.document_writer import to_json
from vehicles.errors import VehicleError
from vehicles.links.link_strings import LinkAddress, LinkAddressError, parse_link
from vehicles.step_response.comparison import FIRMWARES, LIMIT

DIFFERS, ABORTED = 1, 4
_HEADER = ("figure", "vehicle", "firmware", "difference", "")


def check_vehicle(
    link: str | None, *, fly: bool, arm_real: bool, results: Path, as_json: bool
) -> int:
    """Identify the vehicle at a link, and fly it; print the result; return the exit code."""
    try:
        address = _address(link)
        if not fly:
            found = find_vehicle(address)
            out(to_json(_identity(found)).rstrip() if as_json else found)
            return 0
        found = clear_vehicle(address, purpose="a flight of step responses", arm_real=arm_real)
        folder = _new_folder(results / "doctor")
        err(f"the vehicle flies for three minutes, 4 m forward and 3 m up; frames go to {folder}")
        flown = fly_step_responses(found, address, folder=folder, progress=err)
    except (RefusedError, VehicleError) as error:
        err(error)
        return _exit_code(error)
    except OSError as error:
        err(f"{results}: cannot be written: {error.strerror or error}; --out gives another folder")
        return UNAVAILABLE
    out(to_json(_document(found, flown)).rstrip() if as_json else _as_text(found, flown))
    return DIFFERS if flown.beyond else 0


def _address(link: str | None) -> LinkAddress:
    """Return the address of the vehicle to be checked. Raises LinkAddressError."""
    if link is None:
        raise LinkAddressError("--fly: name the simulator by --vehicle LINK")
    address = parse_link(link)
    if address.kind == "memory":
        raise LinkAddressError("--vehicle memory://: no other process can use this link")
    return address


def _exit_code(error: Exception) -> int:
    """Return the exit code of a check that an error ended."""
    if isinstance(error, RefusedError):
        return error.code
    if isinstance(error, LinkAddressError):
        return REFUSED
    return ABORTED if isinstance(error, OperatorAbortError) else UNAVAILABLE


def _new_folder(parent: Path) -> Path:
    """Return a new folder for a flight's log of frames. Raises OSError."""
    parent.mkdir(parents=True, exist_ok=True)
    return Path(tempfile.mkdtemp(prefix=f"{datetime.now(UTC):%Y%m%dT%H%M%SZ}-", dir=parent))


def _as_text(found: AttachedVehicle, flown: Flown) -> str:
    """Return the measured figures and event orders as a table with a conclusion."""
    rows: list[tuple[str, str, str, str, str]] = []
    for row in flown.figures:
        least, most = row.firmware
        off = f"{row.off:+.0%}" if math.isfinite(row.off) else "not reached"
        value = "-" if row.flown is None else f"{row.flown:g}"
        rows.append(
            (f"{row.segment} {row.name}", value, f"{least:g} to {most:g}", off, _mark(row.beyond))
        )
    for order in flown.orders:
        seen = " > ".join(order.flown) if order.beyond else "the same"
        expected = " > ".join(order.firmware)
        differs = "another order" if order.beyond else ""
        rows.append((f"order: {order.name}", seen, expected, differs, _mark(order.beyond)))
    firmware = FIRMWARES[found.identity.autopilot]
    name = f"{found.identity.autopilot} {found.identity.version_text}"
    if flown.beyond:
        end = f"{name} differs from {firmware} in {flown.beyond} of {flown.total}"
    else:
        end = f"{name} flies as {firmware}: {flown.total} of {flown.total} within {LIMIT:.0%}"
    return f"{table(_HEADER, rows)}\n{end}"


def _mark(beyond: bool) -> str:
    return "out" if beyond else "in"


def _document(found: AttachedVehicle, flown: Flown) -> dict[str, Any]:
    """Return the JSON document of a flight; a difference that is infinite is null."""
    return {
        "vehicle": _identity(found),
        "firmware": FIRMWARES[found.identity.autopilot],
        "limit": LIMIT,
        "beyond": flown.beyond,
        "total": flown.total,
        "figures": [
            {
                "segment": row.segment,
                "name": row.name,
                "value": row.flown,
                "least": row.firmware[0],
                "most": row.firmware[1],
                "difference": row.off if math.isfinite(row.off) else None,
                "within": not row.beyond,
            }
            for row in flown.figures
        ],
        "orders": [
            {
                "name": order.name,
                "value": order.flown,
                "firmware": order.firmware,
                "within": not order.beyond,
            }
            for order in flown.orders
        ],
    }


def _identity(found: AttachedVehicle) -> dict[str, Any]:
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
