"""The body of the embedded vehicle: physics, battery, estimator; no MAVLink."""
