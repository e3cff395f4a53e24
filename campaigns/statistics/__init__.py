"""Statistics of flights: proportions with their intervals, and the sequential test."""
