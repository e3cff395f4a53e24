"""The emulated PX4."""
