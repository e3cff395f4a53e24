"""Recipes: how the readings of two worlds become one (transform, filter, merge, publish). Pure."""
