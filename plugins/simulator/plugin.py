"""What the plugin simulator adds."""

from wil_campaign.hooks import ImageSourceKind, implements


@implements
def image_sources() -> tuple[ImageSourceKind, ...]:
    """Return the source of images that is a simulator."""
    opens = "wil_campaign.plugins.simulator.simulator_check:simulator_images"
    return (ImageSourceKind("simulator", opens),)
