"""Steps that merge the readings of both worlds."""
