"""Clocks: vehicle clocks on the run clock, and loops that follow a simulation's time."""
