"""A glTF file with one triangle, as text."""

import base64
import json
import struct
from typing import Any

TRIANGLE = struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 1, 0)
INDICES = struct.pack("<3H", 0, 1, 2)


def gltf(**changes: Any) -> str:
    """Return a file with one triangle; changes: of the members of its document."""
    data = base64.b64encode(TRIANGLE + INDICES).decode()
    document: dict[str, Any] = {
        "asset": {"version": "2.0"},
        "buffers": [
            {"uri": f"data:application/octet-stream;base64,{data}", "byteLength": 42},
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": 36},
            {"buffer": 0, "byteOffset": 36, "byteLength": 6},
        ],
        "accessors": [
            {
                "bufferView": 0,
                "componentType": 5126,
                "count": 3,
                "type": "VEC3",
                "min": [0, 0, 0],
                "max": [1, 1, 0],
            },
            {"bufferView": 1, "componentType": 5123, "count": 3, "type": "SCALAR"},
        ],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
        "scene": 0,
    }
    return json.dumps({**document, **changes})
