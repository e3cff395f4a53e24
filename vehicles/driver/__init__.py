"""The driver: connects to a vehicle, identifies it, flies it, and tells what it does."""

from vehicles.driver.driver import Driver

__all__ = ["Driver"]
