"""The mixing pipeline: mixes the readings of both worlds by a recipe."""
