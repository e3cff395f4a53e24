"""What the plugin depth_cameras adds."""

from wil_campaign.hooks import SensorSource, implements

_FOLDER = "wil_campaign.plugins.depth_cameras"


@implements
def sources() -> tuple[SensorSource, ...]:
    """Return the sources of depth images."""
    return (
        SensorSource(
            "rtp",
            "rtp://HOST:PORT (depth images, 16 bits)",
            f"{_FOLDER}.rtp_depth:open_rtp_depth",
            f"{_FOLDER}.rtp_depth:rtp_depth_fault",
            is_file=False,
        ),
        SensorSource(
            "realsense",
            "realsense://SERIAL (a RealSense depth camera)",
            f"{_FOLDER}.realsense:open_realsense",
            f"{_FOLDER}.realsense:realsense_fault",
            is_file=False,
        ),
    )
