"""The embedded vehicle: JSBSim quadrotor, sensors, estimator, and an autopilot that speaks MAVLink."""
