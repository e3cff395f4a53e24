"""Fences: where a vehicle may be, as values, in files, and on the Earth."""
