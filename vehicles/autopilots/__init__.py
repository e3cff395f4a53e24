"""The differences between PX4 and ArduCopter, one strategy class each; pure."""
