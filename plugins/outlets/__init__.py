"""Outlets: images of a run for viewers and programs, and a ground station that is sent contacts."""
