"""The sources of readings that the plugin opens for campaigns."""

from pathlib import Path

from wil_campaign.plugins.readings.topic_readings import TopicReadings
from wil_campaign.plugins.readings.zmq_readings import ZmqReadings
from wil_campaign.vehicles.sources.source_request import SourceRequest


def fault(address: str, kind: str) -> str:  # noqa: ARG001  # checked by the core's schema
    """Return nothing: every type of sensors has a message."""
    return ""


def published(request: SourceRequest) -> ZmqReadings:
    """Return the readings of a ZeroMQ publisher."""
    return ZmqReadings(
        address=request.address,
        sensor=request.sensor,
        kind_of=request.kind,
        side=request.side,
        mount=request.mount,
        camera=request.camera,
        topic=request.topic,
        latency_s=request.latency_s,
        open_s=request.open_s,
        stall_s=request.stall_s,
    )


def recorded(request: SourceRequest) -> TopicReadings:
    """Return the readings of a topic of an MCAP file."""
    return TopicReadings(
        path=Path(request.address),
        kind=request.kind,
        topic=request.topic or None,
        mount=request.mount,
        camera=request.camera,
    )
