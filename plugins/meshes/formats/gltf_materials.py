"""Reads the materials of glTF files: 3.8 "Texture Data" and 3.9 "Materials" of glTF 2.0."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from wil_campaign.plugins.meshes.beside import image_beside
from wil_campaign.plugins.meshes.looks import Affine, AlphaOf, LookPicture, SurfaceLook, Wrap
from wil_campaign.plugins.meshes.mesh_support import (
    UnsupportedMeshError,
    check_gltf_material,
)

_WRAPS: Mapping[int, Wrap] = {10497: "repeat", 33071: "clamp", 33648: "mirror"}
_GLOSSINESS = "KHR_materials_pbrSpecularGlossiness"
_TRANSMISSION = "KHR_materials_transmission"
_TRANSFORM = "KHR_texture_transform"
_WEBP = "EXT_texture_webp"


class _Source(Protocol):
    """What materials need of a glTF file."""

    @property
    def path(self) -> Path: ...

    @property
    def document(self) -> Mapping[str, Any]: ...

    def view(self, index: int) -> bytes: ...

    def embedded(self, uri: str) -> bytes | None: ...


@dataclass(frozen=True, slots=True, eq=False)
class GltfMaterials:
    """The materials of a glTF file, each read once."""

    gltf: _Source
    _looks: dict[int, SurfaceLook] = field(default_factory=dict)

    def look(self, index: int) -> SurfaceLook:
        """Return the look of a material. Raises UnsupportedMeshError for what is not drawn."""
        if index not in self._looks:
            materials = self.gltf.document.get("materials", ())
            if not 0 <= index < len(materials):
                raise UnsupportedMeshError(f"it uses material {index} of {len(materials)}")
            name = str(materials[index].get("name") or index)[:60]
            self._looks[index] = self._read(name, materials[index])
        return self._looks[index]

    def _read(self, name: str, material: Mapping[str, Any]) -> SurfaceLook:
        check_gltf_material(name, material)
        extensions = material.get("extensions", {})
        metal = material.get("pbrMetallicRoughness", {})
        factor, texture = metal.get("baseColorFactor"), metal.get("baseColorTexture")
        if _GLOSSINESS in extensions:
            gloss = extensions[_GLOSSINESS]
            factor, texture = gloss.get("diffuseFactor"), gloss.get("diffuseTexture")
        red, green, blue, alpha = map(float, factor or (1.0, 1.0, 1.0, 1.0))
        kinds: Mapping[str, AlphaOf] = {"MASK": "cut-outs", "BLEND": "glass"}
        alpha_of = kinds.get(material.get("alphaMode", "OPAQUE"), "nothing")
        passing = float(extensions.get(_TRANSMISSION, {}).get("transmissionFactor", 0.0))
        if passing > 0.0:
            alpha_of, alpha = "glass", alpha * (1.0 - passing)
        return SurfaceLook(
            name=name,
            rgb=(red, green, blue),
            picture=None if texture is None else self._picture(name, texture),
            is_linear=True,
            alpha=alpha,
            alpha_of=alpha_of,
            cutoff=float(material.get("alphaCutoff", 0.5)),
        )

    def _picture(self, name: str, info: Mapping[str, Any]) -> LookPicture:
        document = self.gltf.document
        transform = info.get("extensions", {}).get(_TRANSFORM, {})
        texture = document["textures"][info["index"]]
        sampler = document["samplers"][texture["sampler"]] if "sampler" in texture else {}
        return LookPicture(
            source=self._image(name, texture),
            uv_set=int(transform.get("texCoord", info.get("texCoord", 0))),
            affine=_affine(transform),
            wraps=(
                _WRAPS[sampler.get("wrapS", 10497)],
                _WRAPS[sampler.get("wrapT", 10497)],
            ),
        )

    def _image(self, name: str, texture: Mapping[str, Any]) -> Path | bytes:
        extensions = texture.get("extensions", {})
        source = extensions.get(_WEBP, {}).get("source", texture.get("source"))
        if source is None:
            kinds = ", ".join(sorted(map(str, extensions))) or "none"
            raise UnsupportedMeshError(
                f"the texture of material '{name}' has no image that is read (extensions: "
                f"{kinds[:80]}); export it as PNG or JPEG"
            )
        image = self.gltf.document["images"][source]
        if "bufferView" in image:
            return self.gltf.view(image["bufferView"])
        embedded = self.gltf.embedded(image["uri"])
        if embedded is not None:
            return embedded
        folder = self.gltf.path.parent
        return image_beside(folder, image["uri"], by=f"material '{name}'", is_uri=True)


def _affine(transform: Mapping[str, Any]) -> Affine:
    """Return KHR_texture_transform as a matrix: offset, after rotation, after scale."""
    right, down = map(float, transform.get("offset", (0.0, 0.0)))
    across, along = map(float, transform.get("scale", (1.0, 1.0)))
    angle = float(transform.get("rotation", 0.0))
    cosine, sine = math.cos(angle), math.sin(angle)
    return (
        (cosine * across, sine * along, right),
        (-sine * across, cosine * along, down),
    )
