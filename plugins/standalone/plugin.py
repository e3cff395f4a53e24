"""What the plugin standalone adds."""

from wil_campaign.hooks import Command, implements


@implements
def commands() -> tuple[Command, ...]:
    """Return the command `vehicle`."""
    return (
        Command(
            "vehicle",
            "wil_campaign.plugins.standalone.vehicle_command:vehicle",
            "Fly an embedded PX4 or ArduCopter alone, for other programs.",
            "fly",
        ),
    )
