"""What the plugin detector adds; its functions and classes are names of `wil_campaign.api`, too."""

from wil_campaign.hooks import RecipeStep, implements


@implements
def recipe_steps() -> tuple[RecipeStep, ...]:
    """Return the step of a neural network that detects objects."""
    return (
        RecipeStep(
            "isolate_detections", "wil_campaign.plugins.detector.isolation:isolate_detections"
        ),
    )
