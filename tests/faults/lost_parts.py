"""Mesh files with two parts, one in a vehicle's way, and how the one in the way is lost.

Axes of all files: x forward, y left, z up, in metres. The other part stands far behind.
"""

import base64
import json
import struct
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import trimesh

_FAR_M = (40.0, 0.0, 0.0)
_ASSET = '<asset><unit meter="1"/><up_axis>Z_UP</up_axis></asset>'
_INSTANCING, _VISIBILITY = "EXT_mesh_gpu_instancing", "KHR_node_visibility"
Vertices = npt.NDArray[np.float64]
Faces = npt.NDArray[np.int64]
Part = tuple[Vertices, Faces]

WHOLE = ("dae", "gltf", "glb", "obj", "ply", "binary ply", "stl", "binary stl")
"""Files in which nothing is lost."""
LOST: Mapping[str, str] = {
    "controller": "dae",
    "no geometry": "dae",
    "another file": "dae",
    "no material": "dae",
    "dae cut": "dae",
    "triangles cut": "dae",
    "skin": "gltf",
    "instances": "gltf",
    "morph": "gltf",
    "hidden": "gltf",
    "compressed": "gltf",
    "node extension": "gltf",
    "two scenes": "gltf",
    "buffer cut": "gltf",
    "glb cut": "glb",
    "obj cut": "obj",
    "obj surface": "obj",
    "obj elsewhere": "obj",
    "ply cut": "ply",
    "binary ply cut": "binary ply",
    "stl cut": "stl",
    "solid cut": "stl",
    "binary stl cut": "binary stl",
}
"""How a part is lost, and of which file."""


def parts(size_m: Sequence[float]) -> tuple[Part, Part]:
    """Return the part that stands far behind, and the box in the way."""
    far, near = trimesh.creation.box((1.0, 1.0, 1.0)), trimesh.creation.box(size_m)
    far.apply_translation(_FAR_M)
    return (np.asarray(far.vertices), np.asarray(far.faces)), (
        np.asarray(near.vertices),
        np.asarray(near.faces),
    )


def mesh_file(how: str, size_m: Sequence[float], share: float) -> tuple[str, bytes]:
    """Return name and contents of a file. how: a key of LOST, or one of WHOLE.

    size_m: of the box in the way; share: from 0 to 1, how much of it is there in a file that is
    cut.
    """
    kind = LOST.get(how, how)
    both = parts(size_m)
    name = f"wall.{kind.rpartition(' ')[2]}"
    match kind:
        case "dae":
            return name, _collada(both, how, share).encode()
        case "gltf":
            return name, json.dumps(_gltf(both, how, share)).encode()
        case "glb":
            return name, _cut(_glb(both), share if how == "glb cut" else 1.0)
        case "obj":
            return name, _obj(both, how, share).encode()
    # A text .stl that was cut between two solids is whole by itself.
    left = both[0] if how == "solid cut" else _joined(both)
    whole = trimesh.Trimesh(*left, process=False)
    in_text = {"encoding": "ascii"} if kind == "ply" else {}
    data = whole.export(file_type="stl_ascii" if kind == "stl" else name[5:], **in_text)
    raw = data.encode() if isinstance(data, str) else bytes(data)
    return name, _cut(raw, share) if how.endswith(f"{kind} cut") else raw


def _cut(raw: bytes, share: float) -> bytes:
    """Return a file's first half, and a share of its second, in which the box is."""
    half = len(raw) // 2
    return raw[: half + int(share * (len(raw) - half))]


def _joined(both: tuple[Part, Part]) -> Part:
    (first, of_first), (second, of_second) = both
    return np.concatenate([first, second]), np.concatenate([of_first, of_second + len(first)])


def _obj(both: tuple[Part, Part], how: str, share: float) -> str:
    vertices, faces = _joined(both)
    lines = [f"v {x:g} {y:g} {z:g}" for x, y, z in vertices]
    own = len(both[0][1])
    lines += [f"f {a} {b} {c}" for a, b, c in faces[:own] + 1]
    near = [f"f {a} {b} {c}" for a, b, c in faces[own:] + 1]
    before = "\n".join(lines) + "\n"
    match how:
        case "obj surface":
            return f"{before}cstype bezier\nsurf 0 1 0 1 9 10 11 12\nend\n"
        case "obj elsewhere":
            return f"{before}call wall2.obj\n"
    after = "\n".join(near) + "\n"
    return before + (after[: int(share * len(after))] if how == "obj cut" else after)


def is_whole(how: str, data: bytes) -> bool:
    """Return whether nothing in a file says that more was meant: docs/worlds.md names these.

    An `.obj` that ends with a whole face, and a text `.stl` that ends with one of its solids.
    """
    last = data.splitlines()[-1].split()
    return how == "solid cut" or (how == "obj cut" and last[0] == b"f" and len(last) == 4)


def _geometry(name: str, part: Part, how: str, share: float) -> str:
    vertices, faces = part
    numbers = " ".join(f"{x:g}" for x in vertices.ravel())
    shown = faces[: int(share * len(faces))] if how == "triangles cut" else faces
    corners = " ".join(str(k) for k in shown.ravel())
    material = ' material="M"' if how == "no material" else ""
    return (
        f'<geometry id="{name}"><mesh><source id="{name}p"><float_array id="{name}a" '
        f'count="{vertices.size}">{numbers}</float_array><technique_common><accessor '
        f'source="#{name}a" count="{len(vertices)}" stride="3"><param name="X"/><param name="Y"/>'
        f'<param name="Z"/></accessor></technique_common></source><vertices id="{name}v"><input '
        f'semantic="POSITION" source="#{name}p"/></vertices><triangles count="{len(faces)}"'
        f'{material}><input semantic="VERTEX" source="#{name}v" offset="0"/><p>{corners}</p>'
        "</triangles></mesh></geometry>"
    )


def _collada(both: tuple[Part, Part], how: str, share: float) -> str:
    geometries = _geometry("far", both[0], "", 1.0) + _geometry("near", both[1], how, share)
    controller = '<controller id="c"><skin source="#near"/></controller>'
    library = f"<library_controllers>{controller}</library_controllers>"
    bound = (
        '<instance_geometry url="#near"><bind_material><technique_common><instance_material '
        'symbol="M" target="#none"/></technique_common></bind_material></instance_geometry>'
    )
    instance = {
        "controller": '<instance_controller url="#c"/>',
        "no geometry": '<instance_geometry url="#none"/>',
        "another file": '<instance_geometry url="wall2.dae#near"/>',
        "no material": bound,
    }.get(how, '<instance_geometry url="#near"/>')
    text = (
        '<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">'
        f"{_ASSET}{library if how == 'controller' else ''}<library_geometries>{geometries}"
        '</library_geometries><library_visual_scenes><visual_scene id="s"><node '
        f'name="far"><instance_geometry url="#far"/></node><node name="near">{instance}</node>'
        '</visual_scene></library_visual_scenes><scene><instance_visual_scene url="#s"/></scene>'
        "</COLLADA>"
    )
    return _cut(text.encode(), share).decode() if how == "dae cut" else text


def _packed(both: tuple[Part, Part]) -> tuple[bytes, dict[str, Any]]:
    """Return a buffer, and a document with its views, accessors, meshes and nodes."""
    buffer, views, accessors, meshes = b"", [], [], []
    for vertices, faces in both:
        for data, width, kind in (
            (vertices.astype("<f4"), 5126, "VEC3"),
            (faces.astype("<u2").ravel(), 5123, "SCALAR"),
        ):
            raw = data.tobytes()
            views.append({"buffer": 0, "byteOffset": len(buffer), "byteLength": len(raw)})
            bounds = {}
            if kind == "VEC3":
                bounds = {"min": data.min(axis=0).tolist(), "max": data.max(axis=0).tolist()}
            accessors.append(
                {
                    "bufferView": len(views) - 1,
                    "componentType": width,
                    "count": len(data),
                    "type": kind,
                    **bounds,
                }
            )
            buffer += raw
        first = len(accessors) - 2
        meshes.append({"primitives": [{"attributes": {"POSITION": first}, "indices": first + 1}]})
    document: dict[str, Any] = {
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": len(buffer)}],
        "bufferViews": views,
        "accessors": accessors,
        "meshes": meshes,
        "nodes": [{"mesh": 0, "name": "far"}, {"mesh": 1, "name": "near"}],
        "scenes": [{"nodes": [0, 1]}],
        "scene": 0,
    }
    return buffer, document


def _gltf(both: tuple[Part, Part], how: str, share: float) -> dict[str, Any]:
    buffer, document = _packed(both)
    near, views = document["nodes"][1], document["bufferViews"]
    match how:
        case "skin":
            document["skins"] = [{"joints": [0]}]
            near["skin"] = 0
        case "instances":
            near["extensions"] = {_INSTANCING: {"attributes": {"TRANSLATION": 0}}}
            document["extensionsUsed"] = [_INSTANCING]
        case "morph":
            # The box is in the way by its default weights alone.
            document["meshes"][1]["weights"] = [1.0]
            document["meshes"][1]["primitives"][0]["targets"] = [{"POSITION": 2}]
            near["translation"] = list(_FAR_M)
        case "hidden":
            near["extensions"] = {_VISIBILITY: {"visible": False}}
            document["extensionsUsed"] = [_VISIBILITY]
        case "compressed":
            views[3]["extensions"] = {"EXT_meshopt_compression": {"buffer": 0}}
            document["extensionsUsed"] = ["EXT_meshopt_compression"]
        case "node extension":
            near["extensions"] = {"ACME_bent_nodes": {}}
            document["extensionsUsed"] = ["ACME_bent_nodes"]
        case "two scenes":
            document["scenes"] = [{"nodes": [0]}, {"nodes": [1]}]
            del document["scene"]
        case "buffer cut":
            half = views[2]["byteOffset"]
            buffer = buffer[: half + int(share * (len(buffer) - half - 1))]
    data = base64.b64encode(buffer).decode()
    document["buffers"][0]["uri"] = f"data:application/octet-stream;base64,{data}"
    return document


def _glb(both: tuple[Part, Part]) -> bytes:
    buffer, document = _packed(both)
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    buffer += b"\0" * (-len(buffer) % 4)
    chunks = b"".join(
        struct.pack("<I4s", len(data), kind) + data
        for data, kind in ((text, b"JSON"), (buffer, b"BIN\0"))
    )
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks
