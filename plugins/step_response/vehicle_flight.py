"""`wil-campaign doctor --vehicle LINK --fly`: compares a simulator with real firmware."""

import math
import tempfile
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from wil_campaign.foundation.files.document_writer import to_json
from wil_campaign.orchestrator.campaign.folder.bench_lock import held_links
from wil_campaign.orchestrator.campaign.folder.campaign_folder import FolderTakenError, OutputError
from wil_campaign.orchestrator.campaign.resuming.attached_vehicles import AttachedVehicle
from wil_campaign.orchestrator.cli.arming_consent import (
    REFUSED,
    UNAVAILABLE,
    FlightRefusedError,
    clear_vehicle,
)
from wil_campaign.orchestrator.cli.standard_streams import write_stderr, write_stdout
from wil_campaign.orchestrator.cli.text_table import table_lines
from wil_campaign.plugins.doctor.vehicle_check import (
    check_exit_code,
    identity_document,
    vehicle_address,
)
from wil_campaign.plugins.step_response.comparison import FIRMWARES, LIMIT
from wil_campaign.plugins.step_response.step_responses import (
    FlownStepResponses,
    OperatorAbortError,
    fly_step_responses,
)
from wil_campaign.vehicles.errors import VehicleError
from wil_campaign.vehicles.links.link_strings import LinkAddress, LinkAddressError
from wil_campaign.worlds.figures import distinct_value_text

DIFFERS, ABORTED = 1, 4
_EXACT_M = 0.1
"""Beyond it, an estimate decides who touches a gate: flights pass it by 0.3 m."""
_HEADER = ("figure", "vehicle", "firmware", "difference", "")


def fly_vehicle(link: str | None, *, arm_real: bool, results: Path, as_json: bool) -> int:
    """Identify the vehicle at a link, and fly it; print the result; return the exit code."""
    try:
        address = _address(link)
        with held_links((address,)):
            found = clear_vehicle(address, purpose="a flight of step responses", arm_real=arm_real)
            _require_figures(found.identity.autopilot)
            folder = _new_folder(results / "doctor")
            write_stderr(
                "the vehicle flies for three minutes, 4 m forward and 3 m up; frames go to "
                f"{folder}"
            )
            flown = fly_step_responses(found, address, folder=folder, progress=write_stderr)
    except (FolderTakenError, OutputError) as error:
        write_stderr(error)
        return UNAVAILABLE
    except (FlightRefusedError, VehicleError) as error:
        write_stderr(error)
        return ABORTED if isinstance(error, OperatorAbortError) else check_exit_code(error)
    except OSError as error:
        write_stderr(
            f"{results}: cannot be written: {error.strerror or error}; --out gives another folder"
        )
        return UNAVAILABLE
    write_stdout(to_json(_document(found, flown)).rstrip() if as_json else _as_text(found, flown))
    return DIFFERS if flown.beyond else 0


def _address(link: str | None) -> LinkAddress:
    """Return the address of the simulator to be flown. Raises LinkAddressError."""
    if link is None:
        raise LinkAddressError("--fly: name the simulator by --vehicle LINK")
    return vehicle_address(link)


def _require_figures(autopilot: str) -> None:
    """Raise RefusedError for an autopilot with whose firmware nothing can be compared."""
    if autopilot not in FIRMWARES:
        known = " and ".join(FIRMWARES)
        message = f"--fly: the figures of {known} are known, not of {autopilot}; leave --fly out"
        raise FlightRefusedError(message, REFUSED)


def _new_folder(parent: Path) -> Path:
    """Return a new folder for a flight's log of frames. Raises OSError."""
    parent.mkdir(parents=True, exist_ok=True)
    return Path(tempfile.mkdtemp(prefix=f"{datetime.now(UTC):%Y%m%dT%H%M%SZ}-", dir=parent))


def _as_text(found: AttachedVehicle, flown: FlownStepResponses) -> str:
    """Return the measured figures and event orders as a table with a conclusion."""
    rows: list[tuple[str, str, str, str, str]] = []
    for row in flown.figures:
        least, most = row.firmware
        off = _percent_text(row.off) if math.isfinite(row.off) else "not reached"
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
    return f"{table_lines(_HEADER, rows)}\n{_estimate_text(flown.estimate_off_m)}\n{end}"


def _estimate_text(off_m: float | None) -> str:
    """Return how far the estimate was from the truth, and what follows for `pose_source`."""
    if off_m is None:
        return "its simulator sent no ground truth: the error of its estimate is unknown"
    judged = "" if off_m < _EXACT_M else "; judge it by its ground truth (pose_source: simulator)"
    off = distinct_value_text(off_m, _EXACT_M)
    return f"its estimate was up to {off} m from its simulator's ground truth{judged}"


def _percent_text(off: float) -> str:
    """Return a signed difference in percent, not rounded to the limit from either side."""
    sign = "-" if off < 0.0 else "+"
    return f"{sign}{distinct_value_text(100.0 * abs(off), 100.0 * LIMIT, digits=0)}%"


def _mark(beyond: bool) -> str:
    return "out" if beyond else "in"


def _document(found: AttachedVehicle, flown: FlownStepResponses) -> dict[str, Any]:
    """Return the JSON document of a flight; a difference that is infinite is null."""
    return {
        "vehicle": identity_document(found),
        "firmware": FIRMWARES[found.identity.autopilot],
        "limit": LIMIT,
        "beyond": flown.beyond,
        "total": flown.total,
        "estimate_off_m": flown.estimate_off_m,
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
