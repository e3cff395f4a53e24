"""Builds the errors of a vehicle that does not become ready, or does not arm."""

from wil_campaign.vehicles.driver.identified_vehicle import IdentifiedVehicle
from wil_campaign.vehicles.driver.session.conditions import ConditionWaiter
from wil_campaign.vehicles.errors import ArmRefusedError, CommandError, NotReadyError

_TEXT_WITHIN_S = 0.5
"""How long after a refusal the STATUSTEXT with its reason may arrive."""


def not_ready_error(
    vehicle: IdentifiedVehicle, what: str, reasons: tuple[str, ...], circumstances: str
) -> NotReadyError:
    """Return the error of a vehicle that is not ready; what: the start of its message."""
    texts = vehicle.status.last_texts()
    reasons = (*reasons, *vehicle.autopilot.refusal_reasons(texts))
    return NotReadyError(
        f"{what}: {'; '.join(reasons)}{circumstances}", reasons=reasons, texts=texts
    )


async def arm_refused_error(
    vehicle: IdentifiedVehicle, name: str, changes: ConditionWaiter, error: CommandError
) -> ArmRefusedError:
    """Return the error of a vehicle that refused to arm, with the reasons that it gives."""

    def reasons() -> tuple[str, ...]:
        return vehicle.autopilot.refusal_reasons(vehicle.status.last_texts())

    await changes.until(lambda: bool(reasons()), _TEXT_WITHIN_S)
    why = f": {'; '.join(reasons())}" if reasons() else ""
    return ArmRefusedError(
        f"{name}: arming was refused{why} ({error})", result=error.result, reasons=reasons()
    )
