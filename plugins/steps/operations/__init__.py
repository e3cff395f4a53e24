"""Calculations of steps: photometry, interpolation, quantities, units."""
