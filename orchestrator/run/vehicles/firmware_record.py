"""The firmware of a run's vehicles, from their identities and parameters."""

from collections.abc import Iterable

from wil_campaign.orchestrator.run_results.result_parts import FlownFirmware
from wil_campaign.orchestrator.state.run_setup import RunSetup
from wil_campaign.orchestrator.state.vehicle_context import VehicleContext
from wil_campaign.vehicles.errors import VehicleError

_EMULATED, _SIMULATION = "emulated", "simulation"
"""In place of a board: the embedded vehicle's, which is no firmware, and a firmware's simulation's.
"""


def flown_firmware(
    contexts: Iterable[VehicleContext], setup: RunSetup
) -> tuple[FlownFirmware, ...]:
    """Return the firmware of the vehicles that identified themselves."""
    found = []
    for context in contexts:
        try:
            found.append(firmware_of(context, setup))
        except VehicleError:
            continue
    return tuple(found)


def firmware_of(context: VehicleContext, setup: RunSetup) -> FlownFirmware:
    """Return the firmware of a vehicle. Raises VehicleError before it is identified."""
    identity = context.driver.identity
    digest = context.driver.parameter_digest
    board = _SIMULATION if identity.simulation else identity.board
    if setup.flown(context.name).embedded:
        board = _EMULATED
    return FlownFirmware(
        vehicle=context.name,
        autopilot=identity.autopilot,
        version=identity.version_text,
        git_hash=identity.git_hash,
        board=board or "unknown board",
        uid=identity.uid,
        frame=", ".join(text for text in (identity.vehicle_type, digest.frame) if text),
        parameters=digest.text,
    )
