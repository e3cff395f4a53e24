"""What the plugin calibration adds."""

from wil_campaign.hooks import Command, implements


@implements
def commands() -> tuple[Command, ...]:
    """Return the command `calibrate`."""
    return (
        Command(
            "calibrate",
            "wil_campaign.plugins.calibration.calibrate_command:calibrate",
            "Calibrate a real camera with a board.",
            "start",
        ),
    )
