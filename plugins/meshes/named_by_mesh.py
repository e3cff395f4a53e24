"""The files that a mesh file names, as far as they are there: buffers, materials and images."""

from collections.abc import Iterator
from pathlib import Path

from wil_campaign.foundation.files.limits import MAX_MESH_BYTES
from wil_campaign.foundation.files.paths import is_file
from wil_campaign.plugins.meshes.beside import file_beside, image_beside
from wil_campaign.plugins.meshes.formats.collada_materials import path_of_image
from wil_campaign.plugins.meshes.formats.gltf_file import open_gltf
from wil_campaign.plugins.meshes.formats.obj_file import libraries_named
from wil_campaign.plugins.meshes.formats.obj_materials import images_of
from wil_campaign.plugins.meshes.formats.ply_file import texture_named
from wil_campaign.plugins.meshes.mesh_limits import open_collada
from wil_campaign.plugins.meshes.mesh_support import UnsupportedMeshError


def files_named_by_mesh(path: Path) -> list[Path]:
    """Return the files that a mesh file names and that its reader may read, in their order.

    None of a file that is none of the readers' or is damaged, which they report.
    """
    try:
        if not is_file(path) or path.stat().st_size > MAX_MESH_BYTES:
            return []
        return list(_named(path))
    except Exception:  # noqa: BLE001 - a damaged file may have anything anywhere
        return []


def _named(path: Path) -> Iterator[Path]:
    match path.suffix.lower():
        case ".obj":
            for library in libraries_named(path):
                yield library
                yield from images_of(library)
        case ".dae":
            for image in open_collada(path).iterfind(".//{*}image"):
                yield from _there(path.parent, path_of_image(image))
        case ".gltf" | ".glb":
            document = open_gltf(path).document
            for part in (*document.get("buffers", ()), *document.get("images", ())):
                uri = part.get("uri", "data:")
                if not uri.startswith("data:"):
                    yield from _there(path.parent, uri)
        case ".ply":
            yield from _there(path.parent, texture_named(path), is_uri=False)
        case _:
            return


def _there(folder: Path, written: str, *, is_uri: bool = True) -> Iterator[Path]:
    for find in (file_beside, image_beside):
        try:
            yield find(folder, written, by="it", is_uri=is_uri)
        except UnsupportedMeshError:
            continue
        return
