"""Autonomies that are programs of the user's: they fly by MAVLink, and are sent video."""
