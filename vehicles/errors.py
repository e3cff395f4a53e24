"""The errors of vehicles: one root, and messages that say what, where and what to do."""

NO_JSBSIM = (
    "an embedded vehicle is simulated by JSBSim, which is not installed here (it has no package "
    "for Linux on ARM): give the vehicle `physics: compiled`, attach or launch it, or pip "
    "install jsbsim"
)
"""Why there is no embedded vehicle on this machine, and what to do."""


class VehicleError(Exception):
    """The base of errors of vehicles, their links and autopilots."""


class AnchorError(VehicleError):
    """The vehicle's frame cannot be anchored in the world: too few estimates, or it moves."""


class IdentifyError(VehicleError):
    """No fitting vehicle was identified on the link; says what was received instead."""


class NotReadyError(VehicleError):
    """The vehicle did not become ready to arm; `reasons` and `texts` say why."""

    def __init__(self, message: str, *, reasons: tuple[str, ...], texts: tuple[str, ...]) -> None:
        super().__init__(message)
        self.reasons = reasons
        self.texts = texts


class CommandError(VehicleError):
    """A command was refused; `command` and `result` carry MAVLink's names."""

    def __init__(self, message: str, *, command: str, result: str) -> None:
        super().__init__(message)
        self.command = command
        self.result = result


class CommandTimeoutError(CommandError):
    """A command was not acknowledged after all repetitions."""


class ArmRefusedError(CommandError):
    """Arming was refused; `reasons` are the autopilot's own texts."""

    def __init__(self, message: str, *, result: str, reasons: tuple[str, ...]) -> None:
        super().__init__(message, command="MAV_CMD_COMPONENT_ARM_DISARM", result=result)
        self.reasons = reasons


class StateTimeoutError(VehicleError):
    """A commanded state (a mode, armed, disarmed) was not reached in time."""


class ParameterError(VehicleError):
    """A parameter does not exist, or did not take the value."""
