"""ArduPilot: what flies, emulates and launches ArduCopter."""
