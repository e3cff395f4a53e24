"""The body of the embedded vehicle: physics, battery, estimator, controller; no MAVLink."""
