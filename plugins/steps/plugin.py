"""What the plugin steps adds."""

from wil_campaign.hooks import RecipeStep, implements


@implements
def recipe_steps() -> tuple[RecipeStep, ...]:
    """Return steps of recipes."""
    return (
        RecipeStep(
            "subtract_background",
            "wil_campaign.plugins.steps.filter.background:subtract_background",
        ),
        RecipeStep("matte", "wil_campaign.plugins.steps.filter.mattes:matte"),
        RecipeStep("remove_outliers", "wil_campaign.plugins.steps.filter.outliers:remove_outliers"),
        RecipeStep("median", "wil_campaign.plugins.steps.filter.outliers:median"),
        RecipeStep("value_range", "wil_campaign.plugins.steps.filter.ranges:value_range"),
        RecipeStep("decimate", "wil_campaign.plugins.steps.filter.ranges:decimate"),
        RecipeStep("isolate_region", "wil_campaign.plugins.steps.filter.regions:isolate_region"),
        RecipeStep("isolate_depth", "wil_campaign.plugins.steps.filter.regions:isolate_depth"),
        RecipeStep("isolate_sector", "wil_campaign.plugins.steps.filter.regions:isolate_sector"),
        RecipeStep("isolate_box", "wil_campaign.plugins.steps.filter.regions:isolate_box"),
        RecipeStep("aggregate", "wil_campaign.plugins.steps.merge.aggregation:aggregate"),
        RecipeStep("concatenate", "wil_campaign.plugins.steps.merge.points:concatenate"),
        RecipeStep("replace", "wil_campaign.plugins.steps.merge.replacement:replacement"),
        RecipeStep("color_space", "wil_campaign.plugins.steps.transform.colors:color_space"),
        RecipeStep("match_photometry", "wil_campaign.plugins.steps.transform.colors:MATCHES"),
        RecipeStep("axes", "wil_campaign.plugins.steps.transform.frames:axes"),
        RecipeStep("attitude", "wil_campaign.plugins.steps.transform.frames:attitude"),
        RecipeStep("offset", "wil_campaign.plugins.steps.transform.frames:offset"),
        RecipeStep("remount", "wil_campaign.plugins.steps.transform.frames:remount"),
        RecipeStep("fill_depth", "wil_campaign.plugins.steps.transform.holes:fill_depth"),
        RecipeStep("geodetic", "wil_campaign.plugins.steps.transform.places:geodetic"),
        RecipeStep("local", "wil_campaign.plugins.steps.transform.places:local"),
        RecipeStep("to_points", "wil_campaign.plugins.steps.transform.places:to_points"),
        RecipeStep("resample", "wil_campaign.plugins.steps.transform.timing:resample"),
        RecipeStep("delay", "wil_campaign.plugins.steps.transform.timing:delay"),
        RecipeStep("units", "wil_campaign.plugins.steps.transform.units:units"),
    )
