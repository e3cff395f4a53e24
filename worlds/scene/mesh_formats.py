"""Meshes from files: their formats are of plugins, by the suffix of a file's name."""

from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Literal

import numpy as np

from wil_campaign.hooks import MeshFormat, mesh_formats
from wil_campaign.installed_plugins import absent_additions, load_plugin_object, plugin_additions
from wil_campaign.worlds.scene.meshes import FloatArray
from wil_campaign.worlds.scene.shapes import Shape

Unit = Literal["m", "cm", "mm", "in", "ft"]
Axis = Literal["x", "y", "z", "-x", "-y", "-z"]
_KEPT_SHAPES = 8
_Stamp = tuple[int, int, int]
"""Of a file: inode, bytes, and when it was written, nanoseconds."""


class MeshFileError(Exception):
    """A mesh file that cannot be used, and why."""


@dataclass(frozen=True, slots=True)
class MeshAxes:
    """Which axes of a mesh file point up and forward."""

    up: Axis
    forward: Axis

    def frd_from_file(self) -> FloatArray:
        """Return the matrix from a mesh file's axes to forward, right, down."""
        forward, up = _unit(self.forward), _unit(self.up)
        return np.stack([forward, np.cross(forward, up), -up])


def _unit(axis: Axis) -> FloatArray:
    """Return the unit vector of a mesh file's axis name ("-y")."""
    vector = np.zeros(3)
    vector["xyz".index(axis[-1])] = -1.0 if axis.startswith("-") else 1.0
    return vector


def load_mesh_shape(
    path: Path,
    *,
    unit: Unit | None = None,
    scale: float = 1.0,
    axes: MeshAxes | None = None,
    draws_transparent: bool = False,
) -> Shape:
    """Return the shape in a mesh file; its surface is what can be touched.

    unit, axes: None for what the file states, else for metres and for its format's custom.
    draws_transparent: transparent surfaces are drawn as opaque, else refused. Raises MeshFileError
    with the reason when the file is missing, of no known format, or cannot be used as a mesh.
    A file that has not changed since is not read again: each case of a campaign has a world, and
    all of them share one shape.
    """
    form = _format(path)
    if form is None:
        missing = absent_additions(mesh_formats)
        if path.suffix.lower() in missing:
            raise MeshFileError(missing[path.suffix.lower()])
        known = ", ".join([*plugin_additions(mesh_formats), *missing])
        raise MeshFileError(f"'{path.suffix}' is not one of {known}")
    stamps = tuple(map(_stamp, [path, *files_named_by_mesh(path)]))
    return _loaded(
        form.load,
        path,
        stamps=stamps,
        unit=unit,
        scale=scale,
        axes=axes,
        draws_transparent=draws_transparent,
    )


@lru_cache(maxsize=_KEPT_SHAPES)
def _loaded(
    load: str,
    path: Path,
    *,
    stamps: tuple[_Stamp | None, ...],  # noqa: ARG001 - a changed file is another key
    unit: Unit | None,
    scale: float,
    axes: MeshAxes | None,
    draws_transparent: bool,
) -> Shape:
    """Return the shape in a mesh file of these stamps, read once."""
    shape: Shape = load_plugin_object(load)(
        path, unit=unit, scale=scale, axes=axes, draws_transparent=draws_transparent
    )
    return shape


def _stamp(path: Path) -> _Stamp | None:
    """Return what changes when a file of a mesh does; None for one that is not there."""
    with suppress(OSError):
        state = path.stat()
        return state.st_ino, state.st_size, state.st_mtime_ns
    return None


def files_named_by_mesh(path: Path) -> list[Path]:
    """Return the files that a mesh file names and that its reader may read, in their order.

    None of a file that is no mesh or is damaged, which its reader reports.
    """
    form = _format(path)
    named: list[Path] = [] if form is None else load_plugin_object(form.named)(path)
    return named


def _format(path: Path) -> MeshFormat | None:
    """Return the format of a mesh file; None for none that is installed."""
    return plugin_additions(mesh_formats).get(path.suffix.lower())
