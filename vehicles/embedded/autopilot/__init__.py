"""Emulated autopilots that behave over MAVLink as PX4 1.18 and ArduCopter 4.7 do.

Pure: MAVLink messages and estimates in, messages and thrusts out; no sockets, no clock.
"""
