"""Messages between an embedded vehicle's process and its parent: truth and motion capture, events.

One message is one UDP datagram on loopback. Times are CLOCK_MONOTONIC, which all processes of a
machine share. seq counts up by one per datagram of a sender.
"""

import math

from wil_campaign.foundation.processes.codec import Finite, MessageCodec, ProcessMessage
from wil_campaign.vehicles.poses.truth import TruthSample
from wil_campaign.vehicles.readings import PoseReading


class TruthMessage(ProcessMessage, frozen=True):
    """Feed message: the vehicle's truth."""

    seq: int
    sample: TruthSample


class MocapMessage(ProcessMessage, frozen=True):
    """Feed message: a motion capture reading; the receiver adds arrival time and vehicle."""

    seq: int
    reading: PoseReading


class WorldEventMessage(ProcessMessage, frozen=True):
    """Feed message: an event of the world, by its name."""

    seq: int
    name: str
    t_s: Finite


class FaultMessage(ProcessMessage, frozen=True):
    """Feed message: a fault to inject, as text."""

    seq: int
    fault: str


FromVehicle = TruthMessage | MocapMessage
ToVehicle = WorldEventMessage | FaultMessage
from_vehicle: MessageCodec[FromVehicle] = MessageCodec(FromVehicle)
to_vehicle: MessageCodec[ToVehicle] = MessageCodec(ToVehicle)


def is_feed_message_finite(message: FromVehicle) -> bool:
    """Return whether all numbers of a feed message's pose, and its time, are finite."""
    match message:
        case TruthMessage(_, sample):
            forces = (*sample.rates_frd_rad_s, *sample.specific_force_frd_m_s2, *sample.thrusts_n)
            pose, more = sample.pose, sum((*sample.velocity_ned_m_s, sample.t_s, *forces))
        case MocapMessage(_, reading):
            pose, more = reading.pose, sum((*(reading.velocity_ned_m_s or ()), reading.t_s))
    return math.isfinite(sum((*pose.position_ned_m, *pose.q_wxyz, more)))
