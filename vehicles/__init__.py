"""Vehicles: readings, links, MAVLink, autopilots, drivers, the embedded vehicle, cameras, perception."""
