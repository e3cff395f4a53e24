from wil_campaign.hooks import OracleKind, SensorKind, SensorSource, implements


@implements
def oracles():
    return [OracleKind("calm", "wil_lab.lab:calm")]


@implements
def sources():
    return [SensorSource("echo", "echo://METRES", "wil_lab.lab:Echo", "wil_lab.lab:fault", True)]


@implements
def sensor_types():
    return [SensorKind("magnetometer", "wil_lab.magnetometer:MAGNETOMETER")]
