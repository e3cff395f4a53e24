"""Checks that the identified vehicles are different ones."""

import itertools
from collections.abc import Iterable

from wil_campaign.orchestrator.state.run_state import FlightError
from wil_campaign.orchestrator.state.vehicle_context import VehicleContext
from wil_campaign.vehicles.driver.session.identity import same_vehicle


def require_distinct_vehicles(contexts: Iterable[VehicleContext]) -> None:
    """Refuse one vehicle on two links. Raises FlightError."""
    for context, other in itertools.combinations(contexts, 2):
        if same_vehicle(context.driver.identity, other.driver.identity):
            raise FlightError(
                f"{context.name} and {other.name} are the same vehicle: both report the uid "
                f"{context.driver.identity.uid}; check the addresses of their links"
            )
