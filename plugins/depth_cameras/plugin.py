"""What the plugin depth_cameras adds."""

from wil_campaign.hooks import SensorSource, implements


@implements
def sources() -> tuple[SensorSource, ...]:
    """Return the sources of depth images."""
    return (
        SensorSource(
            "rtp",
            "rtp://HOST:PORT (depth images, 16 bits)",
            "wil_campaign.plugins.depth_cameras.rtp_depth:open_rtp_depth",
            "wil_campaign.plugins.depth_cameras.rtp_depth:rtp_depth_fault",
            is_file=False,
        ),
        SensorSource(
            "realsense",
            "realsense://SERIAL (a RealSense depth camera)",
            "wil_campaign.plugins.depth_cameras.realsense:open_realsense",
            "wil_campaign.plugins.depth_cameras.realsense:realsense_fault",
            is_file=False,
        ),
    )
