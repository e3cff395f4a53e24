"""The command backends of a driver, by the name in a campaign: our own frames, or a plugin's."""

from wil_campaign.hooks import drivers
from wil_campaign.installed_plugins import load_plugin_object, plugin_additions
from wil_campaign.vehicles.driver.command_backend import CommandBackend, FrameBackend

OWN_FRAMES = "mavlink"


def command_backend_of(driver: str, *, name: str) -> CommandBackend:
    """Return the command backend of a driver; name: of the vehicle, for messages."""
    if driver == OWN_FRAMES:
        return FrameBackend()
    backend: CommandBackend = load_plugin_object(plugin_additions(drivers)[driver].backend)(
        name=name
    )
    return backend
