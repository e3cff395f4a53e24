"""The live feed: what a run shows of itself while it flies, for consoles on this machine."""
