"""The modes of PX4 by their numbers."""

import pytest

from wil_campaign.vehicles.embedded.autopilot.px4.px4_modes import Px4Mode, px4_mode


@pytest.mark.parametrize("mode", list(Px4Mode))
def test_px4_modes_are_found_by_their_numbers(mode: Px4Mode) -> None:
    assert px4_mode(mode.custom_mode >> 16 & 0xFF, mode.custom_mode >> 24) is mode


def test_unknown_px4_modes_are_none() -> None:
    assert px4_mode(4, 0) is None
    assert px4_mode(99, 0) is None
