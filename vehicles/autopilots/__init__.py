"""What differs between PX4 and ArduCopter, one class each; pure."""
