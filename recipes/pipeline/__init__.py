"""The mixing pipeline: a recipe and the readings of both worlds in, the mixture out."""
