"""Oracles of how near a vehicle and an object come to each other, and for how long."""
