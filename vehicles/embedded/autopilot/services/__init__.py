"""MAVLink services of an emulated autopilot: parameters, missions, fences, logs."""
