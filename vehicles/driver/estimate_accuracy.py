"""An estimator's own accuracy in metres and radians, from the covariance in ODOMETRY."""

import math
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.driver.session.session import MavlinkSession

_POSITION_VARIANCES = (0, 6, 11)
_ATTITUDE_VARIANCES = (15, 18, 20)
"""Indices of the diagonal in the 21 numbers of the upper triangle of a 6 by 6 matrix, row by row
(x, y, z, roll, pitch, yaw): pose_covariance of MAVLink's ODOMETRY."""


class ReportedAccuracy(NamedTuple):
    """An estimator's accuracy as it reports it: one standard deviation of its worst axis.

    arrived_s: time of arrival, run clock. attitude_rad: of its worst angle, mostly the heading.
    """

    arrived_s: float
    position_m: float
    attitude_rad: float


def accuracy_in(message: Any, arrived_s: float) -> ReportedAccuracy | None:
    """Return the accuracy in an ODOMETRY; None when it has none.

    In MAVLink, NaN as the first element means unknown. Zeros on all axes mean unset.
    """
    covariance = message.pose_covariance
    position = [covariance[index] for index in _POSITION_VARIANCES]
    attitude = [covariance[index] for index in _ATTITUDE_VARIANCES]
    if not all(math.isfinite(one) and one >= 0.0 for one in (*position, *attitude)):
        return None
    if not (any(position) and any(attitude)):
        return None
    return ReportedAccuracy(arrived_s, math.sqrt(max(position)), math.sqrt(max(attitude)))


class EstimateAccuracy:
    """Keeps the newest accuracy that a vehicle's estimator reported."""

    def __init__(self, *, session: MavlinkSession) -> None:
        self.newest: ReportedAccuracy | None = None
        session.on(mavlink.MAVLINK_MSG_ID_ODOMETRY, self._receive)

    def _receive(self, message: Any, arrived_s: float) -> None:
        self.newest = accuracy_in(message, arrived_s)
