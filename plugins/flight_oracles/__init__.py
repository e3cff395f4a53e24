"""Limits on motion, battery, estimator, modes, and on the distance of the pair: oracles."""
