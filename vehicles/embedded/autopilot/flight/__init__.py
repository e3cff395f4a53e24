"""How an emulated autopilot flies: behaviours, missions, telemetry of its state."""
