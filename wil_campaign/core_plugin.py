"""What the core itself adds by the hooks: a part of it is registered by its line here."""

from wil_campaign.hooks import (
    AutopilotKind,
    LinkKind,
    OracleKind,
    RecipeStep,
    SensorKind,
    implements,
)


@implements
def autopilots() -> tuple[AutopilotKind, ...]:
    """Return the core's autopilot."""
    return (
        AutopilotKind(
            "px4",
            strategy="wil_campaign.vehicles.autopilots.px4:Px4",
            emulation="wil_campaign.vehicles.embedded.autopilot.px4.px4:Px4",
        ),
    )


@implements
def links() -> tuple[LinkKind, ...]:
    """Return the core's kinds of links."""
    return (
        LinkKind("udpin", "socket", "wil_campaign.vehicles.links.udp:udp_link"),
        LinkKind("udpout", "socket", "wil_campaign.vehicles.links.udp:udp_link"),
        LinkKind("memory", "", "wil_campaign.vehicles.links.memory:refuse"),
    )


@implements
def oracles() -> tuple[OracleKind, ...]:
    """Return the core's kinds of oracles."""
    return (
        OracleKind("geofence", "wil_campaign.safety.oracles.area:geofence"),
        OracleKind("area", "wil_campaign.safety.oracles.area:area"),
        OracleKind("altitude", "wil_campaign.safety.oracles.area:altitude"),
        OracleKind("collision", "wil_campaign.safety.oracles.contact:collision"),
        OracleKind("clearance", "wil_campaign.safety.oracles.contact:clearance"),
        OracleKind("reached_position", "wil_campaign.safety.oracles.goal:reached_position"),
        OracleKind("time_limit", "wil_campaign.safety.oracles.goal:time_limit"),
        OracleKind("reached", "wil_campaign.safety.oracles.reached:reached"),
        OracleKind("touchdown", "wil_campaign.safety.oracles.touchdown:touchdown"),
        OracleKind("vehicle_fault", "wil_campaign.safety.oracles.vehicle_health:vehicle_fault"),
        OracleKind("link", "wil_campaign.safety.oracles.vehicle_health:link"),
        OracleKind("landed", "wil_campaign.safety.oracles.vehicle_health:landed"),
    )


@implements
def recipe_steps() -> tuple[RecipeStep, ...]:
    """Return the core's steps of recipes."""
    return (
        RecipeStep("isolate_color", "wil_campaign.recipes.steps.filter.isolation:isolate_color"),
        RecipeStep(
            "isolate_objects", "wil_campaign.recipes.steps.filter.isolation:isolate_objects"
        ),
        RecipeStep("overlay", "wil_campaign.recipes.steps.merge.overlays:overlay"),
        RecipeStep("use", "wil_campaign.recipes.steps.own:OWN_STEPS"),
        RecipeStep("resize", "wil_campaign.recipes.steps.transform.geometry:resize"),
        RecipeStep("crop", "wil_campaign.recipes.steps.transform.geometry:crop"),
        RecipeStep("camera_model", "wil_campaign.recipes.steps.transform.geometry:camera_model"),
        RecipeStep("register", "wil_campaign.recipes.steps.transform.geometry:register"),
    )


@implements
def sensor_types() -> tuple[SensorKind, ...]:
    """Return the core's types of sensors."""
    return (
        SensorKind("camera", "wil_campaign.vehicles.sensors.lens:CAMERA"),
        SensorKind("depth", "wil_campaign.vehicles.sensors.depth:DEPTH"),
        SensorKind("pose", "wil_campaign.vehicles.sensors.pose:POSE"),
    )
