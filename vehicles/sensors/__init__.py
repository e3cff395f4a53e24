"""Sensor models: readings made from the truth about a vehicle, with noise from datasheets.

A sensor is built once and sampled at its ticks: `sample(truth, t_s, rng)` gives the reading of
that moment. What it answers depends on what it was handed, on the count of its samples and, where
a model says so, on an error that walks or an angle that turns; there is no clock and no I/O.
"""
