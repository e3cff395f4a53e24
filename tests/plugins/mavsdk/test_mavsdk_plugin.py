"""What the program knows of mavsdk before it imports it."""

from wil_campaign.plugins.mavsdk.ids import OWN_SYSTEM
from wil_campaign.plugins.mavsdk.plugin import drivers


def test_the_reserved_system_id_is_the_one_that_mavsdk_sends_with() -> None:
    assert [driver.system_id for driver in drivers()] == [OWN_SYSTEM]
