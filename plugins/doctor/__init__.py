"""Checks whether a machine can fly campaigns, with a remedy for each problem."""
