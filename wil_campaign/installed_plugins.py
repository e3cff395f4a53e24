"""The plugins of this installation: those that ship in wil_campaign.plugins, and other people's.

Shipped are the folders of wil_campaign/plugins/ with a module `plugin`. Other distributions name
theirs in the group `wil_campaign` of their entry points. Both are registered with pluggy.
"""

import importlib
import sys
import traceback
from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from contextlib import redirect_stdout, suppress
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Protocol, TypeVar

import pluggy

from wil_campaign import core_plugin, hooks

SHIPPED: Mapping[str, Mapping[str, tuple[str, ...]]] = {
    "ardupilot": {"autopilots": ("ardupilot",), "launches": ("ardupilot",)},
    "calibration": {"commands": ("calibrate",)},
    "cameras": {"image_sources": ("rtsp", "rtp", "v4l2", "images", "video", "mcap")},
    "ci": {"announcers": ("ci",), "problem_formats": ("sarif", "codequality")},
    "cluster": {"commands": ("bench", "bench check", "bench serve"), "engines": ("ray",)},
    "console": {"commands": ("console", "watch", "fence"), "live_views": ("console",)},
    "depth_cameras": {"sources": ("rtp", "realsense")},
    "detector": {"recipe_steps": ("isolate_detections",)},
    "doctor": {"commands": ("doctor",)},
    "encounters": {"oracles": ("distance", "encounter")},
    "firmware": {"launches": ("px4",)},
    "flight_oracles": {
        "case_hints": ("limits",),
        "oracles": ("estimator", "battery", "modes", "speed", "attitude", "twin_divergence"),
    },
    "foxglove": {"live_views": ("foxglove",)},
    "hints": {"case_hints": ("unlikely",)},
    "impaired_links": {"link_layers": ("links",), "run_observers": ("links",)},
    "injection": {"run_observers": ("inject",)},
    "lidar": {
        "recipe_steps": ("resample_beams",),
        "sensor_types": ("lidar", "lidar_points", "rangefinder"),
    },
    "logs": {"starters": ("log",)},
    "mavsdk": {"drivers": ("mavsdk",)},
    "meshes": {"mesh_formats": (".obj", ".stl", ".glb", ".gltf", ".dae", ".ply")},
    "microphone": {
        "recipe_steps": ("band_pass", "decimate_sound", "add"),
        "sensor_types": ("microphone",),
    },
    "mocap": {"motion_captures": ("udp", "zmq")},
    "mqtt": {
        "commands": ("sign",),
        "operator_channels": ("mqtt",),
        "run_options": ("broker",),
    },
    "navigation": {"sensor_types": ("gps", "imu")},
    "observer": {
        "campaign_keys": ("observer",),
        "commands": ("film",),
        "run_sections": ("observer",),
    },
    "offline": {"commands": ("mix", "replay")},
    "outlets": {"run_observers": ("deliver", "ground_station")},
    "paper_xml": {"recipe_formats": (".xml",)},
    "programs": {"autonomy_kinds": ("program",)},
    "pytest": {},  # which pytest finds by its own entry points
    "python": {},  # whose names `import wil_campaign` has
    "readings": {"sources": ("zmq", "mcap")},
    "ros2": {
        "autonomy_kinds": ("ros2",),
        "commands": ("export",),
        "recording_formats": ("ros2",),
        "starter_options": ("ros2",),
    },
    "redundant_links": {"link_layers": ("spare_links",)},
    "run_images": {"report_images": ("card", "gif")},
    "search": {"campaign_keys": ("search",), "commands": ("search",)},
    "signed_links": {"link_layers": ("signing",)},
    "simulator": {"image_sources": ("simulator",)},
    "standalone": {"commands": ("vehicle",)},
    "start": {"commands": ("init", "schema", "list")},
    "statistics": {
        "commands": ("plan", "gap", "compare", "history"),
        "report_sections": ("statistics",),
    },
    "steps": {
        "recipe_steps": (
            "subtract_background",
            "matte",
            "remove_outliers",
            "median",
            "value_range",
            "decimate",
            "isolate_region",
            "isolate_depth",
            "isolate_sector",
            "isolate_box",
            "aggregate",
            "concatenate",
            "replace",
            "color_space",
            "match_photometry",
            "axes",
            "attitude",
            "offset",
            "remount",
            "fill_depth",
            "geodetic",
            "local",
            "to_points",
            "resample",
            "delay",
            "units",
        ),
    },
    "stream_links": {"links": ("tcpin", "tcpout", "serial")},
    "stl": {"case_hints": ("formulas",), "oracles": ("stl",)},
    "step_response": {"vehicle_checks": ("fly",)},
}
"""By shipped plugin and hook: the names that it adds, to say what an absent one is needed for."""

_CORE = "wil_campaign"
"""The name by which the core's own lists are registered; it is no plugin that anyone lists."""
_REMEDY = "mend it, or uninstall it"
_ORIGIN = "shipped"
_FOLDER = "wil_campaign.plugins"


class NamedAddition(Protocol):
    """What a hook returns: it has a name of its own."""

    @property
    def name(self) -> str:
        """Return the name by which a user calls it."""
        ...


Addition = TypeVar("Addition", bound=NamedAddition)


@dataclass(frozen=True, slots=True)
class Plugin:
    """A plugin. origin: "shipped", or the distribution with its version.

    adds: by hook the names of what it adds.
    """

    name: str
    origin: str
    adds: Mapping[str, tuple[str, ...]]


def plugin_additions(
    hook: Callable[[], Sequence[Addition]], own: Container[str] = ()
) -> Mapping[str, Addition]:
    """Return by name what all plugins add by a hook of wil_campaign.hooks. own: names of the core.

    Raises BadInput for a plugin that cannot be imported or used, or adds what another one has.
    """
    found: dict[str, Addition] = {}
    for plugin, addition in _additions(hook):
        if addition.name in own or addition.name in found:
            message = f"{hook.__name__}(): '{addition.name}' is there already"
            raise _fault(plugin, _registered()[1][plugin], message)
        found[addition.name] = addition
    return found


def loaded_additions(hook: Callable[[], Sequence[Addition]], field: str) -> Mapping[str, Any]:
    """Return by name what all additions of a hook name by one of their fields, imported.

    The core's own come first; without those where it is empty. Raises BadInput as
    `plugin_additions` does.
    """
    plugin_additions(hook)
    found: dict[str, Any] = {}
    for plugin, addition in _additions(hook):
        place = getattr(addition, field)
        if not place:
            continue
        try:
            found[addition.name] = load_plugin_object(place)
            _require_name(found[addition.name], addition)
        except (Exception, SystemExit) as error:
            message = f"{hook.__name__}(): {place} cannot be used: {_words(error)}"
            raise _fault(plugin, _registered()[1][plugin], message) from error
    return found


def _require_kind(found: Sequence[object], kind: type) -> None:
    """Raise TypeError for what a hook gives that is of another kind than its own."""
    if others := {type(one).__name__ for one in found if not isinstance(one, kind)}:
        raise TypeError(f"it gives {', '.join(sorted(others))}, not {kind.__name__}")


def require_derived(given: object, base: type, what: str) -> None:
    """Raise TypeError where what the part of a plugin has is no class derived from a base."""
    if not (isinstance(given, type) and issubclass(given, base)):
        name = getattr(given, "__name__", repr(given))
        raise TypeError(f"{what}: {name} is not derived from {base.__name__}")


def _require_name(part: Any, addition: NamedAddition) -> None:
    """Raise ValueError for a part, or one of several, with another name than its hook says.

    Raises TypeError for an abstract class, and for what has no name.
    """
    name, kind = addition.name, type(addition).__name__
    for each in part if isinstance(part, tuple) else (part,):
        if not hasattr(each, "name"):
            given = getattr(type(each), "__name__", "")
            says = f"wil_campaign.hooks.{kind} says what it has to be"
            raise TypeError(f"a {given} has no name: {says}")
        if lacks := getattr(each, "__abstractmethods__", ()):
            raise TypeError(f"it lacks {', '.join(sorted(lacks))}")
        if each.name != name:
            raise ValueError(f"it is named '{each.name}', not '{name}'")


def installed_plugins_by_name() -> tuple[Plugin, ...]:
    """Return all plugins, by name. Raises BadInput as `plugin_additions` does."""
    manager, origins = _registered()
    adds: dict[str, dict[str, tuple[str, ...]]] = {name: {} for name in origins}
    for name in manager.hook.__dict__:
        if not name.startswith("_"):
            plugin_additions(getattr(hooks, name))
            for plugin, addition in _additions(getattr(hooks, name)):
                adds[plugin][name] = (*adds[plugin].get(name, ()), addition.name)
    names = sorted(name for name in origins if name != _CORE)
    return tuple(Plugin(name, origins[name], adds[name]) for name in names)


def third_party_plugins() -> Mapping[str, str]:
    """Return by name the plugins that do not ship with this program: distribution and version."""
    origins = _registered()[1]
    return {name: origins[name] for name in sorted(origins) if origins[name] != _ORIGIN}


def third_party_modules() -> Mapping[str, Any]:
    """Return by name the outermost module of each plugin that does not ship with this program."""
    found = {name: _registered()[0].get_plugin(name) for name in third_party_plugins()}
    names = {name: getattr(one, "__name__", type(one).__module__) for name, one in found.items()}
    return {name: sys.modules[text.partition(".")[0]] for name, text in names.items()}


def plugin_of_module(module: str) -> str:
    """Return the plugin of another distribution that a module is of, with it; "" for none."""
    outermost = {one.__name__: name for name, one in third_party_modules().items()}
    name = outermost.get(module.partition(".")[0], "")
    return f"plugin {name} ({third_party_plugins()[name]})" if name else ""


def plugin_that_adds(hook: Callable[[], Sequence[NamedAddition]], name: str) -> str:
    """Return the plugin of another distribution that adds a name, with it; "" for none."""
    for plugin, addition in _additions(hook):
        if addition.name == name and plugin in third_party_plugins():
            return f"plugin {plugin} ({third_party_plugins()[plugin]})"
    return ""


def plugin_at_fault(error: BaseException) -> str:
    """Return the plugin of another distribution that raised, or called what did; "" for none."""
    if not third_party_plugins():
        return ""
    for frame, _ in traceback.walk_tb(error.__traceback__):
        if plugin := plugin_of_module(str(frame.f_globals.get("__name__", ""))):
            return plugin
    return ""


def whose_fault_text(plugin: str) -> str:
    """Return what a message of a fault ends with: the plugin, and the remedy; "" for none."""
    return f"; {plugin}: {_REMEDY}" if plugin else ""


def absent_additions(hook: Callable[[], Sequence[NamedAddition]]) -> Mapping[str, str]:
    """Return by name what shipped plugins add that are not installed: whose it is, the remedy."""
    return {
        name: missing_plugin_text(name, plugin)
        for plugin, adds in SHIPPED.items()
        if plugin not in _registered()[1]
        for name in adds.get(hook.__name__, ())
    }


def missing_plugin_text(name: str, plugin: str) -> str:
    """Return that a name is of a shipped plugin that is not installed, and the remedy."""
    return f"'{name}' is of {_without(plugin)}"


def needed_plugin_text(what: str, error: BaseException) -> str:
    """Return that something needs a shipped plugin, which an import did not find; else ""."""
    module = error.name or "" if isinstance(error, ModuleNotFoundError) else ""
    plugin = module.removeprefix(f"{_FOLDER}.").partition(".")[0]
    return f"{what} needs {_without(plugin)}" if plugin in {*SHIPPED} - {*_shipped_names()} else ""


def _without(plugin: str) -> str:
    return (
        f"the plugin {plugin}, which is not installed: pip install --force-reinstall --no-deps "
        "SOURCE (the wheel or checkout of this program: docs/installing.md)"
    )


def load_plugin_object(function: str) -> Any:
    """Return what `module:name` names, imported."""
    module, _, name = function.partition(":")
    return getattr(importlib.import_module(module), name)


def _additions(hook: Callable[[], Sequence[Addition]]) -> Iterator[tuple[str, Addition]]:
    """Yield the plugin and each thing that it adds by a hook, in the order of registration."""
    manager, origins = _registered()
    kind: type = hook.__annotations__["return"].__args__[0]
    for hookimpl in getattr(manager.hook, hook.__name__).get_hookimpls():
        try:
            found: tuple[Addition, ...] = tuple(hookimpl.function())
            _require_kind(found, kind)
        except (Exception, SystemExit) as error:
            message = f"{hook.__name__}() fails: {_words(error)}"
            raise _fault(hookimpl.plugin_name, origins[hookimpl.plugin_name], message) from error
        for addition in found:
            yield hookimpl.plugin_name, addition


@cache
def _registered() -> tuple[pluggy.PluginManager, dict[str, str]]:
    """Return the manager with all plugins registered, and by name where each is from."""
    manager = pluggy.PluginManager(hooks.PROJECT)
    manager.add_hookspecs(hooks)
    manager.register(core_plugin, _CORE)
    origins = {_CORE: _ORIGIN}
    for name in _shipped_names():
        manager.register(importlib.import_module(f"{_FOLDER}.{name}.plugin"), name)
        origins[name] = _ORIGIN
    if any(map(_names_plugins, sys.path)):
        origins |= _register_others(manager)
    return manager, origins


def _shipped_names() -> list[str]:
    """Return the names of the shipped plugins that are installed."""
    spec = find_spec(_FOLDER)
    places = () if spec is None else spec.submodule_search_locations or ()
    return sorted(path.parent.name for place in places for path in Path(place).glob("*/plugin.py"))


def _names_plugins(folder: str) -> bool:
    """Return whether a distribution in a folder of sys.path has entry points of our group.

    importlib.metadata takes ten times as long, 40 ms, to find none.
    """
    group = f"[{hooks.PROJECT}]".encode()
    with suppress(OSError):
        for path in Path(folder or ".").iterdir():
            if path.name.endswith("-info"):
                with suppress(OSError):
                    if group in (path / "entry_points.txt").read_bytes():
                        return True
    return False


def _register_others(manager: pluggy.PluginManager) -> dict[str, str]:
    """Register the plugins of other distributions; return by name where each is from."""
    from importlib.metadata import entry_points  # noqa: PLC0415 - slow, and seldom needed

    origins: dict[str, str] = {}
    for point in entry_points(group=hooks.PROJECT):
        origin = "?" if point.dist is None else f"{point.dist.name} {point.dist.version}"
        if (other := manager.get_plugin(point.name)) is not None:
            message = f"its name is there already, of {getattr(other, '__name__', other)}"
            raise _fault(point.name, origin, message)
        try:
            with redirect_stdout(sys.stderr):  # what a command prints may be a document
                plugin = point.load()
            manager.register(plugin, point.name)
            _require_known_hooks(manager, plugin)
        except (Exception, SystemExit) as error:
            raise _fault(point.name, origin, f"cannot be used: {_words(error)}") from error
        origins[point.name] = origin
    return origins


def _require_known_hooks(manager: pluggy.PluginManager, plugin: object) -> None:
    """Raise UnknownHookError for a function under `implements` of no hook, or a plugin of none."""
    if not manager.get_hookcallers(plugin):
        text = "none of its functions is a hook's: they stand under @implements"
        raise UnknownHookError(text)
    known = {name: one for name, one in vars(manager.hook).items() if not name.startswith("_")}
    for name, hook in known.items():
        if not hook.has_spec():
            from wil_campaign.foundation.files.problems import closest_word  # noqa: PLC0415 - seldom used

            near = closest_word(name, (other for other, one in known.items() if one.has_spec()))
            hint = f"did you mean {near!r}?" if near else "wil_campaign.hooks has them all"
            raise UnknownHookError(f"there is no hook {name!r}; {hint}")


class UnknownHookError(Exception):
    """A plugin has a function of no hook, or none of any; the message says what is meant."""


def _words(error: BaseException) -> str:
    """Return an exception in one line."""
    if isinstance(error, UnknownHookError):
        return str(error)
    if text := needed_plugin_text("it", error):
        return text
    return f"{type(error).__name__}: {' '.join(str(error).split())}"


def _fault(plugin: str, origin: str, message: str) -> Exception:
    """Return the error that a plugin cannot be used: BadInput."""
    from wil_campaign.foundation.files.problems import BadInput, Problem  # noqa: PLC0415 - seldom used

    return BadInput([Problem(f"plugin {plugin} ({origin})", 0, 0, f"{message}; {_REMEDY}")])
