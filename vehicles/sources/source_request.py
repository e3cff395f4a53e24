"""What a plugin's source of readings is asked for."""

from dataclasses import dataclass

from wil_campaign.vehicles.readings import Source
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose


@dataclass(frozen=True, slots=True, kw_only=True)
class SourceRequest:
    """A sensor whose readings a source is asked for.

    address: as the campaign has it, with the scheme. sensor: its name in the source. kind: its type
    ("gps"). side: the vehicle whose it is. mount: the sensor's pose in the body's FRD frame.
    camera: the model of a depth camera; None of others. rate_hz: its rate; None for any. topic: of
    the address; "" for none. latency_s: sampling to arrival of the quickest. open_s, stall_s: how
    long to wait for the first and each further reading.
    """

    address: str
    sensor: str
    kind: str
    side: Source
    mount: Pose
    camera: Intrinsics | None = None
    rate_hz: float | None
    topic: str
    latency_s: float
    open_s: float
    stall_s: float
