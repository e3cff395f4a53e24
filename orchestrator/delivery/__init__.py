"""Delivery: mixed readings to whoever perceives, and injected things to the autopilot."""
