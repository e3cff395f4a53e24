"""What the plugin microphone adds."""

from wil_campaign.hooks import RecipeStep, SensorKind, implements


@implements
def sensor_types() -> tuple[SensorKind, ...]:
    """Return the type of sensors."""
    return (SensorKind("microphone", "wil_campaign.plugins.microphone.microphone:MICROPHONE"),)


@implements
def recipe_steps() -> tuple[RecipeStep, ...]:
    """Return the steps for sound."""
    return (
        RecipeStep("band_pass", "wil_campaign.plugins.microphone.sounds:band_pass"),
        RecipeStep("decimate_sound", "wil_campaign.plugins.microphone.sounds:decimate_sound"),
        RecipeStep("add", "wil_campaign.plugins.microphone.sounds:add"),
    )
