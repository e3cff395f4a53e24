"""Autopilots that behave to the outside as PX4 1.18 and ArduCopter 4.7 do. Pure: no I/O, no clock."""
