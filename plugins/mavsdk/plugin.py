"""What the plugin mavsdk adds."""

from wil_campaign.hooks import VehicleDriver, implements


@implements
def drivers() -> tuple[VehicleDriver, ...]:
    """Return the driver mavsdk."""
    return (
        VehicleDriver(
            "mavsdk",
            backend="wil_campaign.plugins.mavsdk.mavsdk_backend:MavsdkBackend",
            requirement="mavsdk>=4.1,<5",
            system_id=245,
        ),
    )
