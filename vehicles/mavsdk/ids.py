"""Who mavsdk is on the wire: a ground station, by its own defaults."""

OWN_SYSTEM, OWN_COMPONENT = 245, 190
