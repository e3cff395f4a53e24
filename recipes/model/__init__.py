"""The model: recipes, steps and their registry, and the readings that steps work on."""
