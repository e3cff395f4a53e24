"""The embedded vehicle: a JSBSim quadrotor, its sensors, and an autopilot that speaks MAVLink.

Import from its modules (`vehicle`, `config`, `profile`, `feed`): physics and MAVLink are slow to
import, and a profile must be had without them.
"""
