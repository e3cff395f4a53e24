"""History of campaigns: one line per flight, and its changes over time."""
