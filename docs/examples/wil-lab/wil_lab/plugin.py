from wil_campaign.hooks import (
    Command,
    LiveView,
    OracleKind,
    RecipeStep,
    SensorKind,
    SensorSource,
    implements,
)


@implements
def oracles():
    return [OracleKind("calm", "wil_lab.lab:calm")]


@implements
def sources():
    return [SensorSource("echo", "echo://METRES", "wil_lab.lab:Echo", "wil_lab.lab:fault", True)]


@implements
def sensor_types():
    return [SensorKind("magnetometer", "wil_lab.magnetometer:MAGNETOMETER")]


@implements
def recipe_steps():
    return [RecipeStep("bias", "wil_lab.extras:bias")]


@implements
def live_views():
    return [LiveView("logbook", "wil_lab.extras:logbook", "FILE: write there what flies.")]


@implements
def commands():
    return [Command("readings", "wil_lab.extras:readings", "Count the readings of a run.")]
