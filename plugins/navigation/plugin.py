"""What the plugin navigation adds."""

from wil_campaign.hooks import SensorKind, implements


@implements
def sensor_types() -> tuple[SensorKind, ...]:
    """Return the types of sensors of navigation; the pose is the core's."""
    return (
        SensorKind("gps", "wil_campaign.plugins.navigation.gps:GPS"),
        SensorKind("imu", "wil_campaign.plugins.navigation.imu:IMU"),
    )
