"""The accuracy that an estimator reports: standard deviations from the covariance of ODOMETRY."""

import math
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.driver.estimate_accuracy import accuracy_in

# Of PX4 1.18 in flight (the reference trace), cut to what differs from zero.
FLOWN = {0: 0.04095, 6: 0.04078, 11: 0.08344, 15: 3.236e-4, 18: 1.918e-4, 20: 6.009e-3}


def odometry(variances: dict[int, float]) -> Any:
    """Return an ODOMETRY with such elements in its pose covariance."""
    covariance = [variances.get(index, 0.0) for index in range(21)]
    return mavlink.MAVLink_odometry_message(
        0, 1, 1, 0.0, 0.0, 0.0, (1.0, 0.0, 0.0, 0.0), *(0.0,) * 6, covariance, [0.0] * 21, 0, 8, 0
    )


def test_the_accuracy_is_the_standard_deviation_of_the_worst_axis() -> None:
    found = accuracy_in(odometry(FLOWN), 12.5)
    assert found == pytest.approx((12.5, 0.28886, 0.077518), rel=1e-4)


@pytest.mark.parametrize(
    "variances",
    [
        {},
        {0: math.nan},
        FLOWN | {0: math.nan},
        FLOWN | {20: math.inf},
        FLOWN | {11: -0.1},
        {0: 0.04, 6: 0.04, 11: 0.08},
        {15: 3e-4, 18: 2e-4, 20: 6e-3},
    ],
    ids=["unset", "unknown", "nan", "infinite", "negative", "position alone", "attitude alone"],
)
def test_an_accuracy_that_is_not_stated_in_full_is_unknown(variances: dict[int, float]) -> None:
    assert accuracy_in(odometry(variances), 12.5) is None
