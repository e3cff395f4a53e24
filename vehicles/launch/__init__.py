"""Simulated autopilots that we start ourselves: found, watched, and ended for certain."""
