"""Telemetry rates that a radio carries."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wil_campaign.vehicles.autopilots.autopilot import TelemetryRates
from wil_campaign.vehicles.autopilots.registry import autopilot_named
from wil_campaign.vehicles.telemetry_fit import (
    SHARE_DOWN,
    RadioTooSlowError,
    fitted_telemetry_rates,
    telemetry_bytes_s,
)

PX4 = autopilot_named("px4")
WANTED = TelemetryRates()


def test_a_fast_link_gets_the_wanted_rates() -> None:
    assert fitted_telemetry_rates(PX4, WANTED, radio_bit_s=1e6) == WANTED


def test_a_telemetry_radio_gets_fewer_positions_and_all_of_the_rest() -> None:
    rates = fitted_telemetry_rates(PX4, WANTED, radio_bit_s=57_600 * 0.8)
    assert 15.0 <= rates.position_hz < 30.0
    assert rates.attitude_hz == rates.position_hz
    assert (rates.status_hz, rates.state_hz) == (WANTED.status_hz, WANTED.state_hz)
    assert fitted_telemetry_rates(
        PX4, WANTED, radio_bit_s=57_600 * 0.8, signed=True
    ).position_hz < (rates.position_hz)


def test_a_radio_that_is_too_slow_is_refused() -> None:
    with pytest.raises(RadioTooSlowError, match=r"a radio of 9.6 kbit/s carries \d positions"):
        fitted_telemetry_rates(PX4, WANTED, radio_bit_s=9_600)


@given(
    radio_bit_s=st.floats(1e3, 1e7),
    autopilot=st.sampled_from(["px4", "ardupilot"]),
    signed=st.booleans(),
)
def test_fitted_telemetry_takes_no_more_than_its_share(
    radio_bit_s: float, autopilot: str, signed: bool
) -> None:
    strategy = autopilot_named(autopilot)
    try:
        rates = fitted_telemetry_rates(strategy, WANTED, radio_bit_s=radio_bit_s, signed=signed)
    except RadioTooSlowError:
        return
    taken = telemetry_bytes_s(strategy, rates, signed=signed)
    assert taken * 8.0 <= SHARE_DOWN * radio_bit_s
    assert rates.position_hz >= 10.0


def test_a_ground_truth_comes_as_often_as_positions_and_takes_its_share() -> None:
    wanted = TelemetryRates(truth_hz=50.0)
    rates = fitted_telemetry_rates(PX4, wanted, radio_bit_s=100_000.0)
    assert rates.truth_hz == rates.position_hz < 50.0
    assert (
        rates.position_hz < fitted_telemetry_rates(PX4, WANTED, radio_bit_s=100_000.0).position_hz
    )
    taken = telemetry_bytes_s(PX4, rates, signed=False)
    assert taken * 8.0 <= SHARE_DOWN * 100_000.0
    assert fitted_telemetry_rates(PX4, WANTED, radio_bit_s=57_600.0).truth_hz == 0.0
