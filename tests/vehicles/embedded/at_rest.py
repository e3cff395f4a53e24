"""A body at rest on the ground."""

from wil_campaign.vehicles.embedded.physics.states import BodyMotion

AT_REST = BodyMotion(
    (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, -9.80665)
)
