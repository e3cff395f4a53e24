"""What the plugin lidar adds."""

from wil_campaign.hooks import RecipeStep, SensorKind, implements


@implements
def sensor_types() -> tuple[SensorKind, ...]:
    """Return the types of sensors that measure ranges by beams."""
    return (
        SensorKind("lidar", "wil_campaign.plugins.lidar.lidar:LIDAR"),
        SensorKind("lidar_points", "wil_campaign.plugins.lidar.lidar_points:LIDAR_POINTS"),
        SensorKind("rangefinder", "wil_campaign.plugins.lidar.rangefinder:RANGEFINDER"),
    )


@implements
def recipe_steps() -> tuple[RecipeStep, ...]:
    """Return the step that works on scans alone."""
    return (
        RecipeStep("resample_beams", "wil_campaign.plugins.lidar.resample_beams:resample_beams"),
    )
