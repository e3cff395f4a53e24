"""Reads Collada files: every geometry of every node of their scene, or a reason why not.

Khronos, COLLADA 1.4.1, chapter 5. Lines have no surface, and are left out; so are animations,
whose nodes stand as the scene has them.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from wil_campaign.plugins.meshes.formats.collada_materials import ColladaMaterials
from wil_campaign.plugins.meshes.looks import NO_LOOK, FilePart
from wil_campaign.plugins.meshes.mesh_polygons import (
    Integers,
    MeshPolygons,
    check_polygons,
    numbers_in_text,
    polygon_fans,
)
from wil_campaign.plugins.meshes.mesh_support import UnsupportedMeshError, check_place
from wil_campaign.worlds.scene.meshes import FloatArray

_SURFACES = frozenset({"triangles", "polylist", "polygons", "tristrips", "trifans"})
_NO_SURFACES = frozenset({"source", "vertices", "lines", "linestrips", "extra"})
_NUMBERS_OF = {"matrix": 16, "translate": 3, "rotate": 4, "scale": 3}
_READ_INPUTS = frozenset({"POSITION", "TEXCOORD", "COLOR"})
_UNREAD_PLACES = frozenset({"lookat", "skew"})


@dataclass(frozen=True, slots=True, eq=False)
class _Input:
    """What an index of a corner means: a row of values (n, k), by the offset-th of its indices."""

    semantic: str
    set_name: str
    values: FloatArray
    offset: int


@dataclass(frozen=True, slots=True, eq=False)
class _Surface:
    """A list of polygons of a geometry, of one material.

    rows: (n, offsets), indices of each corner. triangles: (m, 3), corners by their row. symbol: of
    the material.
    """

    symbol: str
    rows: Integers
    triangles: Integers
    inputs: tuple[_Input, ...]

    def values(self, semantic: str, set_name: str | None = None) -> FloatArray | None:
        """Return the values at all corners of the triangles, (3 m, k); None for no such input.

        set_name: None for the first of its semantic.
        """
        for one in self.inputs:
            if one.semantic == semantic and set_name in (None, one.set_name):
                return np.asarray(one.values[self.rows[self.triangles.reshape(-1), one.offset]])
        return None


@dataclass(frozen=True, slots=True, eq=False)
class _Collada:
    """A Collada document: its parts by their id."""

    root: ET.Element
    nodes: Mapping[str, ET.Element]
    geometries: Mapping[str, ET.Element]
    materials: ColladaMaterials
    _surfaces: dict[str, list[_Surface]] = field(default_factory=dict)

    def surfaces(self, ident: str) -> list[_Surface]:
        """Return the surfaces of a geometry, read once however often it stands in the scene."""
        if ident not in self._surfaces:
            self._surfaces[ident] = list(_surfaces(self.geometries[ident], self._name(ident)))
        return self._surfaces[ident]

    def _name(self, ident: str) -> str:
        return f"geometry '{(self.geometries[ident].get('name') or ident)[:60]}'"


def read_collada(path: Path, root: ET.Element) -> list[FilePart]:
    """Return the parts of a Collada file: the geometries of its scene's nodes, in their places.

    Raises UnsupportedMeshError for what would be left out or misread, by its node; ValueError and
    others for a damaged file.
    """
    check_collada_assets(root)
    collada = _Collada(
        root,
        _by_id(root.iterfind(".//{*}node")),
        _by_id(root.iterfind("{*}library_geometries/{*}geometry")),
        ColladaMaterials.of(root, path.parent),
    )
    return [
        part
        for node, matrix in _placed_nodes(collada)
        for instance in node.iterfind("{*}instance_geometry")
        for part in _instance(collada, node, instance, matrix)
    ]


def check_collada_assets(root: ET.Element) -> None:
    """Raise UnsupportedMeshError for parts with another unit or axis than the document."""
    whole = root.find("{*}asset")
    for element in root.iter():
        inner = element.find("{*}asset")
        if inner is None or inner is whole:
            continue
        for name, what in (("unit", "unit"), ("up_axis", "axis")):
            if inner.find(f"{{*}}{name}") is not None and _stated(inner, name) != _stated(
                whole, name
            ):
                raise UnsupportedMeshError(
                    f"{_kind(element)} '{element.get('id', '')[:60]}' has its own {what}, "
                    "which is not supported; export the mesh in one unit with one upward axis"
                )


def _stated(asset: ET.Element | None, name: str) -> str:
    found = None if asset is None else asset.find(f"{{*}}{name}")
    if name == "unit":
        return str(float("1" if found is None else found.get("meter", "1")))
    return "Y_UP" if found is None else (found.text or "").strip()


def _by_id(elements: Iterator[ET.Element]) -> dict[str, ET.Element]:
    found: dict[str, ET.Element] = {}
    for element in elements:
        if element.get("id"):
            found.setdefault(element.get("id", ""), element)
    return found


def _kind(element: ET.Element) -> str:
    return element.tag.rpartition("}")[2]


def _node_name(node: ET.Element) -> str:
    return f"node '{(node.get('name') or node.get('id') or 'without a name')[:60]}'"


def _inner(reference: str, what: str) -> str:
    """Return the id that a reference names. Raises UnsupportedMeshError for another file's."""
    if not reference.startswith("#"):
        raise UnsupportedMeshError(
            f"{what} refers to '{reference[:60]}' in another file, which is not supported"
        )
    return reference[1:]


def visual_scene_of(root: ET.Element) -> ET.Element:
    """Return the visual scene that a document shows."""
    instance = root.find("{*}scene/{*}instance_visual_scene")
    if instance is None:
        raise UnsupportedMeshError("it has no scene, which lists the parts that are shown")
    ident = _inner(instance.get("url", ""), "its scene")
    scene = _by_id(root.iterfind("{*}library_visual_scenes/{*}visual_scene")).get(ident)
    if scene is None:
        raise UnsupportedMeshError(f"its scene '{ident[:60]}' does not exist")
    return scene


def _placed_nodes(collada: _Collada) -> Iterator[tuple[ET.Element, FloatArray]]:
    """Yield each node of the scene, those of instances too, with its place (4, 4)."""
    above: list[tuple[ET.Element, FloatArray]] = [
        (node, np.eye(4)) for node in visual_scene_of(collada.root).iterfind("{*}node")
    ]
    waiting = above[::-1]
    while waiting:
        node, matrix = waiting.pop()
        here = matrix @ _matrix(node)
        yield node, here
        inner = []
        for child in node:
            match _kind(child):
                case "node":
                    inner.append((child, here))
                case "instance_node":
                    ident = _inner(child.get("url", ""), _node_name(node))
                    if ident not in collada.nodes:
                        raise UnsupportedMeshError(
                            f"{_node_name(node)} refers to the node '{ident[:60]}', which does not "
                            "exist"
                        )
                    inner.append((collada.nodes[ident], here))
                case "instance_controller":
                    raise UnsupportedMeshError(
                        f"{_node_name(node)} has a controller (a skin or morphing), which is not "
                        "supported; export it with the pose applied"
                    )
                case _:
                    pass
        waiting += inner[::-1]


def _matrix(node: ET.Element) -> FloatArray:
    """Return a node's place in the one above: its transformations, one after another."""
    matrix = np.eye(4)
    for child in node:
        kind = _kind(child)
        if kind in _UNREAD_PLACES and _has_surface(node):
            raise UnsupportedMeshError(
                f"{_node_name(node)} is placed by {kind}, which is not supported; export it with a "
                "matrix"
            )
        if kind in _NUMBERS_OF:
            values = numbers_in_text(child.text or "", np.float64)
            if len(values) != _NUMBERS_OF[kind]:
                raise UnsupportedMeshError(
                    f"{_node_name(node)} has a {kind} of {len(values)} numbers: it is damaged"
                )
            matrix = matrix @ _place(kind, values)
    check_place(matrix, _node_name(node))
    return matrix


def _has_surface(node: ET.Element) -> bool:
    kinds = ("instance_geometry", "instance_node", "instance_controller")
    return any(node.find(f".//{{*}}{kind}") is not None for kind in kinds)


def _place(kind: str, values: FloatArray) -> FloatArray:
    matrix = np.eye(4)
    match kind:
        case "matrix":
            return values.reshape(4, 4)
        case "translate":
            matrix[:3, 3] = values
        case "scale":
            matrix[:3, :3] = np.diag(values)
        case _:
            length = float(np.linalg.norm(values[:3])) or 1.0
            x, y, z = values[:3] / length
            angle = math.radians(values[3])
            cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
            matrix[:3, :3] += math.sin(angle) * cross + (1.0 - math.cos(angle)) * cross @ cross
    return matrix


def _instance(
    collada: _Collada, node: ET.Element, instance: ET.Element, matrix: FloatArray
) -> Iterator[FilePart]:
    name = _node_name(node)
    ident = _inner(instance.get("url", ""), name)
    if ident not in collada.geometries:
        raise UnsupportedMeshError(
            f"{name} refers to the geometry '{ident[:60]}', which does not exist"
        )
    bound = {
        element.get("symbol", ""): element
        for element in instance.iterfind(
            "{*}bind_material/{*}technique_common/{*}instance_material"
        )
    }
    for surface in collada.surfaces(ident):
        if not len(surface.triangles):
            continue
        look, uv_set = NO_LOOK, None
        if surface.symbol:
            look, uv_set = collada.materials.bound(surface.symbol, bound.get(surface.symbol), name)
        points = surface.values("POSITION")
        if points is None or points.shape[1] != len("xyz"):
            raise ValueError("no positions")
        faces = np.arange(len(points), dtype=np.int32).reshape(-1, 3)
        uv = None if look.picture is None else surface.values("TEXCOORD", uv_set)
        yield FilePart(
            vertices=points @ matrix[:3, :3].T + matrix[:3, 3],
            faces=faces if np.linalg.det(matrix[:3, :3]) >= 0.0 else faces[:, ::-1],
            look=look,
            uv=None if uv is None else uv[:, :2],
            colors=surface.values("COLOR"),
        )


def _surfaces(geometry: ET.Element, name: str) -> Iterator[_Surface]:
    mesh = geometry.find("{*}mesh")
    if mesh is None:
        kinds = [_kind(child) for child in geometry if _kind(child) not in ("asset", "extra")]
        raise UnsupportedMeshError(
            f"{name} is not a mesh but {', '.join(kinds)[:40] or 'empty'}, which is not supported"
        )
    sources = {element.get("id", ""): element for element in mesh.iterfind("{*}source")}
    tables: dict[str, FloatArray] = {}

    def table(reference: str) -> FloatArray:
        ident = _inner(reference, name)
        if ident not in sources:
            raise UnsupportedMeshError(f"{name} has no source '{ident[:60]}'")
        if ident not in tables:
            tables[ident] = _table(sources[ident], name)
        return tables[ident]

    for part in mesh:
        kind = _kind(part)
        if kind in _SURFACES:
            inputs = tuple(_inputs(mesh, part, table))
            yield _surface(part, inputs, name)
        elif kind not in _NO_SURFACES:
            raise UnsupportedMeshError(f"{name} has {kind[:40]}, which is not supported")


def _inputs(
    mesh: ET.Element, part: ET.Element, table: Callable[[str], FloatArray]
) -> Iterator[_Input]:
    """Yield the inputs of a surface; those of `vertices` by the index of the vertex."""
    for element in part.iterfind("{*}input"):
        offset, set_name = int(element.get("offset", "0")), element.get("set", "0")
        semantic, source = element.get("semantic", ""), element.get("source", "")
        if semantic == "VERTEX":
            for inner in mesh.iterfind("{*}vertices/{*}input"):
                kind = inner.get("semantic", "")
                if kind in _READ_INPUTS:
                    yield _Input(kind, set_name, table(inner.get("source", "")), offset)
        elif semantic in _READ_INPUTS:
            yield _Input(semantic, set_name, table(source), offset)


def _table(source: ET.Element, name: str) -> FloatArray:
    """Return the values of a source by its accessor, (count, parameters)."""
    array, accessor = source.find("{*}float_array"), source.find(".//{*}accessor")
    if array is None or accessor is None:
        raise UnsupportedMeshError(f"{name} has a source without floating-point numbers")
    values = numbers_in_text(array.text or "", np.float64)
    count, stride = int(accessor.get("count", "0")), int(accessor.get("stride", "1"))
    begin, stated = int(accessor.get("offset", "0")), int(array.get("count", "0"))
    if begin < 0 or count < 0 or stride < 1 or len(values) < stated:
        raise UnsupportedMeshError(
            f"{name} is cut off: {len(values)} of {stated} numbers are there"
        )
    # Some writers count numbers there, not rows.
    count = min(count, max(0, len(values) - begin) // stride)
    named = [bool(element.get("name")) for element in accessor.iterfind("{*}param")]
    # One without a name is left out; writers that name none mean all.
    columns = [at for at, has_name in enumerate(named) if has_name] or list(range(stride))
    return values[begin : begin + count * stride].reshape(count, stride)[:, columns]


def _surface(part: ET.Element, inputs: tuple[_Input, ...], name: str) -> _Surface:
    kind = _kind(part)
    if part.find("{*}ph") is not None:
        raise UnsupportedMeshError(
            f"{name} has polygons with holes, which are not supported; export the mesh with "
            "triangulated faces"
        )
    stride = 1 + max(int(element.get("offset", "0")) for element in part.iterfind("{*}input"))
    lists = [numbers_in_text(element.text or "", np.int64) for element in part.iterfind("{*}p")]
    if any(len(one) % stride for one in lists):
        raise UnsupportedMeshError(f"{name} is cut off: a corner of its {kind} lacks an index")
    rows = np.concatenate([np.empty(0, np.int64), *lists]).reshape(-1, stride)
    sizes = np.array([len(one) // stride for one in lists], np.int64)
    if kind == "triangles":
        sizes = np.full(len(rows) // 3, 3, np.int64)
    elif kind == "polylist":
        counts = part.find("{*}vcount")
        sizes = numbers_in_text("" if counts is None else counts.text or "", np.int64)
    if sizes.sum() != len(rows) or len(sizes) < int(part.get("count", "0")):
        raise UnsupportedMeshError(
            f"{name} is cut off: {len(sizes)} of {part.get('count')} {kind} are there, of "
            f"{len(rows)} of {sizes.sum()} corners"
        )
    for one in inputs:
        used = rows[:, one.offset]
        if len(used) and not 0 <= used.min() <= used.max() < len(one.values):
            raise UnsupportedMeshError(
                f"{name} has an index beyond the {len(one.values)} values of its {one.semantic}"
            )
    triangles = _triangles(kind, sizes)
    if kind in ("polylist", "polygons"):
        positions = next(one for one in inputs if one.semantic == "POSITION")
        check_polygons(MeshPolygons(positions.values, rows[:, positions.offset], sizes))
    return _Surface(part.get("material", ""), rows, triangles, inputs)


def _triangles(kind: str, sizes: Integers) -> Integers:
    """Return the triangles (m, 3), by their corners' rows; polygons of two corners have none."""
    if kind != "tristrips":
        begins, large = np.cumsum(sizes) - sizes, sizes >= len("xyz")
        triangles = polygon_fans(sizes[large])
        shift = begins[large] - (np.cumsum(sizes[large]) - sizes[large])
        return np.asarray(triangles + np.repeat(shift, sizes[large] - 2)[:, None])
    strips = [np.empty((0, 3), np.int64)]
    begin = 0
    for size in sizes:
        order = np.arange(begin, begin + size)
        strip = np.stack([order[:-2], order[1:-1], order[2:]], axis=1)
        strip[1::2] = strip[1::2, [1, 0, 2]]
        strips.append(strip)
        begin += size
    return np.concatenate(strips)
