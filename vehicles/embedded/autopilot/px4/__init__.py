"""The embedded PX4: its modes, failsafes, telemetry and parameters."""
