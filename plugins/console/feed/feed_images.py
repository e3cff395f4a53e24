"""Images of the live feed: small JPEGs with the metadata of their readings."""

import cv2

from wil_campaign.plugins.console.feed.feed_messages import ImageView
from wil_campaign.vehicles.readings import CameraReading

_WIDEST_PX = 640
_JPEG = (cv2.IMWRITE_JPEG_QUALITY, 75)


def image_view(run: str, name: str, reading: CameraReading, at_s: float) -> ImageView:
    """Return an image for the live feed, no wider than 640 pixels. at_s: when it is sent."""
    image = reading.image_bgr
    height_px, width_px = image.shape[:2]
    if width_px > _WIDEST_PX:
        size = (_WIDEST_PX, max(1, round(height_px * _WIDEST_PX / width_px)))
        image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    _, jpeg = cv2.imencode(".jpg", image, _JPEG)
    return ImageView(
        run=run,
        name=name,
        seq=reading.seq,
        t_s=reading.t_s,
        age_s=at_s - reading.t_s,
        width_px=width_px,
        height_px=height_px,
        rendered=reading.rendered,
        jpeg=jpeg.tobytes(),
        source=reading.source,
        sensor=reading.sensor,
        arrived_s=reading.arrived_s,
    )
