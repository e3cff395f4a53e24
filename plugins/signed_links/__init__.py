"""Signed links: MAVLink 2 signing of what goes to a vehicle and comes from it."""
