"""Delivery: images to viewers and programs, and injected messages to the autopilot."""
