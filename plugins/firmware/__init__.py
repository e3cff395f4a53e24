"""Firmware that is launched: found, watched, and ended for certain; PX4's."""
