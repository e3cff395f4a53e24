"""The driver: connects to a vehicle, identifies it, flies it, and reports its state."""

from wil_campaign.vehicles.driver.driver import Driver

__all__ = ["Driver"]
