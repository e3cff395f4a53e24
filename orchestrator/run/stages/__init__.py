"""The stages of a flight: ready, armed, taken off, at height, goal, landed; of pair and actors."""
