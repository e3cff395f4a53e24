"""What the plugin mocap adds."""

from wil_campaign.hooks import MotionCaptureKind, implements


@implements
def motion_captures() -> tuple[MotionCaptureKind, ...]:
    """Return the kinds of motion capture."""
    place = "wil_campaign.plugins.mocap.capture_inputs"
    return (
        MotionCaptureKind("udp", f"{place}:udp_capture"),
        MotionCaptureKind("zmq", f"{place}:zmq_capture"),
    )
