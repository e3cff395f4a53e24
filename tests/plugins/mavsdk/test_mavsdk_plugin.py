"""What the program knows of mavsdk before it imports it."""

from wil_campaign.plugins.mavsdk.ids import OWN_SYSTEM
from wil_campaign.plugins.mavsdk.plugin import drivers


def test_the_id_that_no_vehicle_may_have_is_the_one_that_it_sends_with() -> None:
    assert [one.system_id for one in drivers()] == [OWN_SYSTEM]
