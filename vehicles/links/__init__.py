"""Links that carry MAVLink bytes: in memory and UDP, behind one interface."""
