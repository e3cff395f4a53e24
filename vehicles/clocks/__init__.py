"""Clocks of vehicles on the run clock: time synchronisation and a steady pace."""
