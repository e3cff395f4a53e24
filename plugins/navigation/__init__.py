"""Sensors of navigation as recipes mix them: GPS receivers and IMUs, modelled or by MAVLink."""
