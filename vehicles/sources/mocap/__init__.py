"""Motion capture: poses of bodies from a tracking system."""
