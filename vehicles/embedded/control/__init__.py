"""The control laws of the embedded autopilots, compiled: from estimate and target to thrusts."""
