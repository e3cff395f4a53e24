"""The flight of a run: takeoff, goal, landing, oracles, recording, result."""
