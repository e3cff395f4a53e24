"""Options of a command that plugins add by a hook."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields, is_dataclass, make_dataclass
from inspect import signature
from typing import Annotated, Any, ParamSpec, Protocol, TypeVar

from cyclopts import Parameter

from wil_campaign.installed_plugins import NamedAddition, absent_additions, plugin_additions

P = ParamSpec("P")
T = TypeVar("T")


class OptionAddition(NamedAddition, Protocol):
    """What a hook returns that adds an option."""

    @property
    def help(self) -> str:
        """Return the help of the option."""
        ...


@dataclass(frozen=True, kw_only=True)
class PluginOptions:
    """What a user gives by the options of plugins, which are its fields."""


NO_OPTIONS = PluginOptions()


def takes_options(
    hook: Callable[[], Sequence[OptionAddition]], parameter: str, kind: Any, *, but: str = ""
) -> Callable[[Callable[P, T]], Callable[P, T]]:
    """Give a parameter of a command an option for each addition by a hook. but: for all others.

    kind: of the values; None, or False, where an option is not given. An addition of an absent
    plugin has an option as well, by which it is refused. Raises BadInput for an option that the
    command has already.
    """
    default = False if kind is bool else None

    def give(command: Callable[P, T]) -> Callable[P, T]:
        known = plugin_additions(hook, own=_own_options(command))
        texts = {name: option.help for name, option in known.items()}
        texts |= absent_additions(hook)
        options = make_dataclass(
            "Options",
            [
                (name, Annotated[kind, Parameter(help=text, negative=())], default)
                for name, text in texts.items()
                if name != but
            ],
            bases=(PluginOptions,),
            frozen=True,
            kw_only=True,
            namespace={"__module__": __name__},
        )
        Parameter(name="*")(options)
        function: Any = command
        function.__annotations__[parameter] = options
        function.__kwdefaults__[parameter] = options()
        return command

    return give


def _own_options(command: Callable[..., object]) -> set[str]:
    """Return the names of a command's options, those that it has of other hooks included."""
    names: set[str] = set()
    for name, parameter in signature(command).parameters.items():
        values = fields(parameter.default) if is_dataclass(parameter.default) else ()
        names.update([one.name for one in values] or [name])
    return {name.strip("_") for name in names}


def given_options(options: PluginOptions) -> dict[str, Any]:
    """Return the values of the options that a user gives, by name."""
    return {
        name: one for name, one in asdict(options).items() if one is not None and one is not False
    }
