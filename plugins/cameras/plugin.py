"""What the plugin cameras adds."""

from wil_campaign.hooks import ImageSourceKind, implements


@implements
def image_sources() -> tuple[ImageSourceKind, ...]:
    """Return the sources of images that are live cameras, and those that are files."""
    place = "wil_campaign.plugins.cameras.camera_factory"
    return (
        *(ImageSourceKind(kind, f"{place}:live_source") for kind in ("rtsp", "rtp", "v4l2")),
        *(ImageSourceKind(kind, f"{place}:recording") for kind in ("images", "video", "mcap")),
    )
