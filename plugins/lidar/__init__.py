"""Lidars, 2-D and 3-D, and rangefinders: models, readings of autopilots, and a step."""
