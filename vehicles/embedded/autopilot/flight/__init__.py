"""How an emulated autopilot flies: behaviours, missions, state and telemetry."""
