"""The embedded vehicle: a simulated quadrotor, its sensors, and an emulated MAVLink autopilot.

Import from its modules (`vehicle`, `config`, `profile`, `feed`): physics and MAVLink are slow to
import, and loading a profile needs neither.
"""
