"""The stages of a flight, of pair and actors: ready, armed, takeoff, at height, goal, landed."""
