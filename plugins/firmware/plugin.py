"""What the plugin firmware adds."""

from wil_campaign.hooks import LaunchKind, implements


@implements
def launches() -> tuple[LaunchKind, ...]:
    """Return the launch of PX4."""
    return (LaunchKind("px4", "wil_campaign.plugins.firmware.px4_launch:Px4LaunchPart"),)
