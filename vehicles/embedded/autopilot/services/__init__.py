"""MAVLink services that both autopilots offer: commands, parameters, missions, logs, streams."""
