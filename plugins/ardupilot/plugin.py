"""What the plugin ardupilot adds."""

from wil_campaign.hooks import AutopilotKind, implements


@implements
def autopilots() -> tuple[AutopilotKind, ...]:
    """Return ArduPilot."""
    return (
        AutopilotKind(
            "ardupilot",
            strategy="wil_campaign.plugins.ardupilot.strategy:ArduCopter",
            emulation="wil_campaign.plugins.ardupilot.copter.copter:ArduCopter",
            launch="wil_campaign.plugins.ardupilot.launch:ArduPilotLaunchPart",
            injection="wil_campaign.plugins.ardupilot.injection_rules:ARDUPILOT",
        ),
    )
