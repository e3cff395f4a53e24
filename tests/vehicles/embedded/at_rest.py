"""A body at rest on the ground."""

from wil_campaign.vehicles.embedded.physics.states import Motion

AT_REST = Motion(
    (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, -9.80665)
)
