"""The MAVLink session with one vehicle: link, identity, commands, time."""
