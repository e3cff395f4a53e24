"""The MAVLink ids of mavsdk, which is a ground station by its own defaults."""

OWN_SYSTEM, OWN_COMPONENT = 245, 190
