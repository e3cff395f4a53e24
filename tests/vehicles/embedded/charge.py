"""The charge of an emulated battery, set rather than drained."""

from wil_campaign.vehicles.embedded.physics.battery import SimulatedBattery


def set_remaining(battery: SimulatedBattery, remaining: float) -> None:
    """Set what is left, 0 to 1; a small drain brings reading and thrust up to date."""
    battery._used_mah = (1.0 - remaining) * battery._profile.capacity_mah
    battery.drain(0.0, 0.0)
