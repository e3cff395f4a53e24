"""What the plugin ardupilot adds."""

from wil_campaign.hooks import AutopilotKind, LaunchKind, implements


@implements
def autopilots() -> tuple[AutopilotKind, ...]:
    """Return ArduPilot."""
    return (
        AutopilotKind(
            "ardupilot",
            strategy="wil_campaign.plugins.ardupilot.strategy:ArduCopter",
            emulation="wil_campaign.plugins.ardupilot.copter.copter:ArduCopter",
            injection="wil_campaign.plugins.ardupilot.injection_rules:ARDUPILOT",
        ),
    )


@implements
def launches() -> tuple[LaunchKind, ...]:
    """Return the launch of ArduPilot."""
    return (LaunchKind("ardupilot", "wil_campaign.plugins.ardupilot.launch:ArduPilotLaunchPart"),)
