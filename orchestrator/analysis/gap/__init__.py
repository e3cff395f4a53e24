"""The gap between modes: distances of flights, split by where they arise."""
