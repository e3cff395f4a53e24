"""The embedded ArduCopter: its modes, failsafes, telemetry and parameters."""
