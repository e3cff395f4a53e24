"""Refuses features of mesh files that their readers leave out or misread without an error: glTF.

The reader is trimesh 4; paragraphs are those of the glTF 2.0 specification.
"""

from collections.abc import Mapping
from typing import Any

_EXTENSIONS = frozenset({"EXT_texture_webp", "KHR_lights_punctual", "KHR_mesh_quantization"})
_SHADING = "KHR_materials_"
"""Extensions of materials change how a surface shines, which the renderer leaves out anyway."""
_TRIANGLES, _STRIP, _FAN = 4, 5, 6
_FLOAT, _UNSIGNED_SHORT = 5126, 5123


class UnsupportedMeshError(Exception):
    """A mesh file that would be read otherwise than it is meant; says how to export it."""


def check_gltf_support(document: Mapping[str, Any]) -> None:
    """Raise UnsupportedMeshError for a glTF document with features that its reader lacks.

    These are required extensions (3.12) such as compression; triangle fans (3.7.2.1); and data of
    positions, indices, textures and colours that are sparse, not in a buffer, or integers that are
    to be scaled (3.6.2).
    """
    for name in map(str, document.get("extensionsRequired", ())):
        if name not in _EXTENSIONS and not name.startswith(_SHADING):
            raise UnsupportedMeshError(
                f"it requires the glTF extension {name[:60]}, which is not supported; export it "
                "without compression and without that extension"
            )
    accessors = document.get("accessors", ())
    for mesh in document.get("meshes", ()):
        for part in mesh.get("primitives", ()):
            _check_primitive(part, accessors)


def _check_primitive(part: Mapping[str, Any], accessors: Any) -> None:
    mode = part.get("mode", _TRIANGLES)
    if mode == _FAN:
        raise UnsupportedMeshError(
            "it has a triangle fan (primitive mode 6), which is not supported; export triangles"
        )
    if mode not in (_TRIANGLES, _STRIP):
        return
    attributes = part.get("attributes", {})
    used = {"POSITION": attributes.get("POSITION"), "indices": part.get("indices")}
    # The reader takes colours of vertices only where there is no material.
    looks = "TEXCOORD_0" if "material" in part else "COLOR_0"
    used[looks] = attributes.get(looks)
    for name, index in used.items():
        if index is not None:
            _check_accessor(name, accessors[index])


def _check_accessor(name: str, accessor: Mapping[str, Any]) -> None:
    if "bufferView" not in accessor or "sparse" in accessor:
        raise UnsupportedMeshError(
            f"its {name} data are compressed or sparse, which is not supported; export it without "
            "compression"
        )
    kind = accessor.get("componentType")
    is_scaled = bool(accessor.get("normalized")) and kind != _FLOAT
    if (is_scaled and name != "COLOR_0") or (name == "COLOR_0" and kind == _UNSIGNED_SHORT):
        raise UnsupportedMeshError(
            f"its {name} data are normalized integers, which are not supported; export it with "
            "floating-point numbers (without quantization)"
        )
