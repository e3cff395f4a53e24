"""What the plugin step_response adds."""

from wil_campaign.hooks import VehicleCheck, implements


@implements
def vehicle_checks() -> tuple[VehicleCheck, ...]:
    """Return the flight of step responses."""
    return (
        VehicleCheck(
            "fly",
            "wil_campaign.plugins.step_response.vehicle_flight:fly_vehicle",
            "Fly that vehicle, which must be a simulator, through step responses in real time "
            "(about three minutes), and compare its figures and the order of its events with the "
            "firmware's. Exits with 1 when it differs from the firmware that the embedded vehicles "
            "emulate.",
        ),
    )
