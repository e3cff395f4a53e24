"""Statistics of flights: the sequential test."""
