"""Refuses features of mesh files that would be left out or misread without an error: glTF.

Paragraphs are those of the glTF 2.0 specification.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from wil_campaign.worlds.scene.meshes import FloatArray

SURFACE_MODES = frozenset({4, 5, 6})
"""Triangles, strips and fans of them (3.7.2.1); others are points and lines."""
_REQUIRED = frozenset(
    {"EXT_texture_webp", "KHR_lights_punctual", "KHR_mesh_quantization", "KHR_texture_transform"}
)
"""Extensions that are read, or are nothing that is seen."""
_SHADING = "KHR_materials_"
"""Extensions of materials change how a surface shines, which the renderer leaves out anyway."""
_INSTANCING = "EXT_mesh_gpu_instancing"
_VISIBILITY = "KHR_node_visibility"
_HARMLESS = frozenset(
    {
        "AGI_stk_metadata",
        "CESIUM_primitive_outline",
        "EXT_instance_features",
        "EXT_lights_ies",
        "EXT_lights_image_based",
        "EXT_mesh_features",
        "EXT_structural_metadata",
        "KHR_audio_emitter",
        "KHR_draco_mesh_compression",
        "KHR_implicit_shapes",
        "KHR_interactivity",
        "KHR_lights_punctual",
        "KHR_materials_variants",
        "KHR_mesh_quantization",
        "KHR_node_hoverability",
        "KHR_node_selectability",
        "KHR_physics_rigid_bodies",
        "KHR_xmp",
        "KHR_xmp_json_ld",
        "MSFT_lod",
    }
)
"""Extensions of nodes, meshes and accessors that leave the surface as it stands without them.

Draco: a primitive may have its data without compression as well, and else its accessors are empty.
"""
_HARMLESS_IN_FILE = _HARMLESS | {
    "AGI_articulations",
    "KHR_animation_pointer",
    "VRM",
    "VRMC_springBone",
    "VRMC_vrm",
}
"""The same of a whole file; CESIUM_RTC is none of them: it moves everything."""
_HARMLESS_LOOKS = ("KHR_materials_", "EXT_materials_", "ADOBE_materials_", "MSFT_packing_")


_LAST_ROW = 1e-6
"""What exporters of single precision leave in the last row of a matrix."""


class UnsupportedMeshError(Exception):
    """A mesh file that would be read otherwise than it is meant; says how to export it."""


def check_place(matrix: FloatArray, name: str) -> None:
    """Raise UnsupportedMeshError for a matrix (4, 4) of a node that is no place.

    Where rows and columns were confused, the way that it moves stands in its last row.
    """
    if not np.allclose(matrix[3], (0.0, 0.0, 0.0, 1.0), rtol=0.0, atol=_LAST_ROW):
        raise UnsupportedMeshError(
            f"{name} has a matrix whose last row is not 0 0 0 1: rows and columns may be "
            "confused; export it anew"
        )


def gltf_name(kind: str, index: int, thing: Mapping[str, Any]) -> str:
    """Return what messages call a part of a glTF file: by its name, else by its number."""
    name = thing.get("name")
    return f"{kind} '{name[:60]}'" if isinstance(name, str) and name else f"{kind} {index}"


def check_gltf_support(document: Mapping[str, Any]) -> None:
    """Raise UnsupportedMeshError for extensions (3.12) that a glTF document requires or uses.

    Those of compression and unknown ones may change where its surfaces are.
    """
    for name in map(str, document.get("extensionsRequired", ())):
        if name not in _REQUIRED and not name.startswith(_SHADING):
            raise UnsupportedMeshError(
                f"it requires the glTF extension {name[:60]}, which is not supported; export it "
                "without compression and without that extension"
            )
    for name in map(str, document.get("extensions", {})):
        if name not in _HARMLESS_IN_FILE and not name.startswith(_HARMLESS_LOOKS):
            raise UnsupportedMeshError(
                f"it has the glTF extension {name[:60]}, which is not supported; export it without "
                "that extension"
            )
    for kind in ("buffer", "bufferView", "accessor", "scene"):
        for index, thing in enumerate(document.get(f"{kind}s", ())):
            _check_extensions(kind, index, thing)


def check_gltf_node(document: Mapping[str, Any], index: int) -> None:
    """Raise UnsupportedMeshError for a node of a scene whose surface is not where it says.

    Skins (3.7.3) place it by other nodes, morph targets (3.7.2.2) by weights, and extensions
    repeat or hide it.
    """
    node = document["nodes"][index]
    name = gltf_name("node", index, node)
    extensions = node.get("extensions", {})
    if _INSTANCING in extensions:
        raise UnsupportedMeshError(
            f"{name} has instances by {_INSTANCING}, which is not supported; export it with a node "
            "for each"
        )
    if not extensions.get(_VISIBILITY, {}).get("visible", True):
        raise UnsupportedMeshError(
            f"{name} is hidden by {_VISIBILITY}, which is not supported; export it without"
        )
    _check_extensions("node", index, node)
    if "mesh" not in node:
        return
    if "skin" in node:
        raise UnsupportedMeshError(
            f"{name} has a skin: its surface is where its joints are, which is not supported; "
            "export it with the pose applied"
        )
    mesh = document["meshes"][node["mesh"]]
    _check_extensions("mesh", node["mesh"], mesh)
    for part in mesh["primitives"]:
        _check_extensions("mesh", node["mesh"], part, mesh)
    weights = node.get("weights", mesh.get("weights", ()))
    if any(weights) and any(part.get("targets") for part in mesh["primitives"]):
        raise UnsupportedMeshError(
            f"{name} has morph targets with weights, which are not supported; export it with the "
            "shape applied"
        )


def check_gltf_material(name: str, material: Mapping[str, Any]) -> None:
    """Raise UnsupportedMeshError for extensions by which a material may have other colours."""
    for extension in map(str, material.get("extensions", {})):
        if not extension.startswith(_HARMLESS_LOOKS):
            raise UnsupportedMeshError(
                f"material '{name}' has the glTF extension {extension[:60]}, which is unknown"
            )


def _check_extensions(
    kind: str, index: int, thing: Mapping[str, Any], named: Mapping[str, Any] | None = None
) -> None:
    for extension in map(str, thing.get("extensions", {})):
        if extension not in _HARMLESS | {_VISIBILITY}:
            raise UnsupportedMeshError(
                f"{gltf_name(kind, index, named or thing)} has the glTF extension "
                f"{extension[:60]}, which is not supported; export it without that extension"
            )
