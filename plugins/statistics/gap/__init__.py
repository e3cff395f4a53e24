"""The gap between modes: distances of flights, split into perception and actuation."""
