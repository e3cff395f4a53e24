"""The model of recipes: sensors, steps and their registry."""
