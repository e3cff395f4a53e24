"""Vehicles: readings, links, MAVLink, autopilots, drivers, the embedded vehicle, perception."""
