"""The live feed: a run's state, events and images in flight, for consoles on this machine."""
