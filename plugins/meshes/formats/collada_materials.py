"""Reads the materials of Collada files: chapter 8 "FX" of COLLADA 1.4.1, its common profile."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from wil_campaign.plugins.meshes.beside import image_beside
from wil_campaign.plugins.meshes.looks import PLAIN_RGB, LookPicture, SurfaceLook, Wrap
from wil_campaign.plugins.meshes.mesh_polygons import numbers_in_text
from wil_campaign.plugins.meshes.mesh_support import UnsupportedMeshError

_SHADERS = ("lambert", "phong", "blinn", "constant")
_WRAPS: Mapping[str, Wrap] = {"MIRROR": "mirror", "CLAMP": "clamp", "BORDER": "clamp"}
_LUMINANCE = np.array([0.212671, 0.715160, 0.072169])
"""Of RGB_ZERO and RGB_ONE: COLLADA 1.4.1, "Determining Transparency"."""


@dataclass(frozen=True, slots=True, eq=False)
class ColladaMaterials:
    """The materials of a Collada file by their id, each read once. folder: of the file."""

    folder: Path
    materials: Mapping[str, ET.Element]
    effects: Mapping[str, ET.Element]
    images: Mapping[str, ET.Element]
    _looks: dict[str, tuple[SurfaceLook, str]] = field(default_factory=dict)

    @classmethod
    def of(cls, root: ET.Element, folder: Path) -> "ColladaMaterials":
        """Return the materials of a document."""
        return cls(
            folder,
            _by_id(root.iterfind("{*}library_materials/{*}material")),
            _by_id(root.iterfind("{*}library_effects/{*}effect")),
            _by_id(root.iterfind(".//{*}image")),
        )

    def bound(
        self, symbol: str, instance: ET.Element | None, node: str
    ) -> tuple[SurfaceLook, str | None]:
        """Return the look that a node gives a symbol, and the set of its texture coordinates.

        Without a binding the symbol is the material's id, as other programs have it. Raises
        UnsupportedMeshError for a material that does not exist, and a look that is not drawn.
        """
        ident = symbol if instance is None else instance.get("target", "").removeprefix("#")
        if ident not in self.materials:
            raise UnsupportedMeshError(
                f"{node} uses the material '{ident[:60]}', which does not exist"
            )
        if ident not in self._looks:
            self._looks[ident] = self._read(ident)
        look, semantic = self._looks[ident]
        for element in () if instance is None else instance.iterfind("{*}bind_vertex_input"):
            if element.get("semantic") == semantic:
                return look, element.get("input_set", "0")
        return look, None

    def _read(self, ident: str) -> tuple[SurfaceLook, str]:
        """Return a material's look, and the semantic of its texture coordinates."""
        material = self.materials[ident]
        name = (material.get("name") or ident)[:60]
        instance = material.find("{*}instance_effect")
        effect_id = "" if instance is None else instance.get("url", "").removeprefix("#")
        effect = self.effects.get(effect_id)
        if effect is None:
            raise UnsupportedMeshError(
                f"material '{name}' has the effect '{effect_id[:60]}', which does not exist"
            )
        shader = next(
            (
                element
                for kind in _SHADERS
                for element in effect.iterfind(f".//{{*}}technique/{{*}}{kind}")
            ),
            None,
        )
        if shader is None:
            raise UnsupportedMeshError(f"material '{name}' has no shader of the common profile")
        kind = "emission" if shader.tag.endswith("constant") else "diffuse"
        look, semantic = self._colored(name, effect, shader.find(f"{{*}}{kind}"))
        return self._with_alpha(look, effect, shader), semantic

    def _colored(
        self, name: str, effect: ET.Element, channel: ET.Element | None
    ) -> tuple[SurfaceLook, str]:
        texture = None if channel is None else channel.find("{*}texture")
        if texture is None:
            color = _color(effect, channel)
            return SurfaceLook(name, PLAIN_RGB if color is None else color[:3]), ""
        picture = LookPicture(
            self._image(name, effect, texture), wraps=_wraps(effect, texture.get("texture", ""))
        )
        return SurfaceLook(name, (1.0, 1.0, 1.0), picture), texture.get("texcoord", "")

    def _with_alpha(self, look: SurfaceLook, effect: ET.Element, shader: ET.Element) -> SurfaceLook:
        """Return a look with its opacity.

        A transparency of 0 that leaves nothing to be seen is what exporters write for opaque.
        """
        transparent, factor = shader.find("{*}transparent"), shader.find("{*}transparency")
        amount = 1.0 if factor is None else float("".join(factor.itertext()).strip() or "1")
        if transparent is None:
            return look if amount in (0.0, 1.0) else replace(look, alpha=amount, alpha_of="glass")
        opaque = transparent.get("opaque", "A_ONE")
        texture = transparent.find("{*}texture")
        if texture is not None:
            image = self._image(look.name, effect, texture)
            alpha = 1.0 if opaque == "A_ONE" else 0.0
            same = look.picture is not None and look.picture.source == image
            return replace(look, alpha=alpha, alpha_of="glass", opacity=None if same else image)
        color = _color(effect, transparent) or (1.0, 1.0, 1.0, 1.0)
        part = color[3] if opaque.startswith("A_") else float(_LUMINANCE @ color[:3])
        alpha = part * amount if opaque.endswith("_ONE") else 1.0 - part * amount
        if alpha <= 0.0 == amount:
            alpha = 1.0
        return replace(look, alpha=alpha, alpha_of="glass" if alpha < 1.0 else "nothing")

    def _image(self, name: str, effect: ET.Element, texture: ET.Element) -> Path:
        """Return the file of a texture: by its sampler and surface, or by the image's id."""
        ident = texture.get("texture", "")
        sampler = _parameter(effect, ident, "sampler2D")
        if sampler is not None:
            direct = sampler.find("{*}instance_image")
            source = (sampler.findtext("{*}source") or "").strip()
            surface = _parameter(effect, source, "surface")
            if direct is not None:
                ident = direct.get("url", "").removeprefix("#")
            elif surface is not None:
                ident = (surface.findtext("{*}init_from") or "").strip()
        image = self.images.get(ident)
        if image is None:
            raise UnsupportedMeshError(
                f"material '{name}' has the image '{ident[:60]}', which does not exist"
            )
        written = path_of_image(image)
        if not written:
            raise UnsupportedMeshError(f"the image '{ident[:60]}' of material '{name}' has no file")
        return image_beside(self.folder, written, by=f"material '{name}'", is_uri=True)


def path_of_image(image: ET.Element) -> str:
    """Return the file that an image names; "" for none."""
    written = image.findtext("{*}init_from/{*}ref") or image.findtext("{*}init_from") or ""
    return written.strip()


def _by_id(elements: Iterator[ET.Element]) -> dict[str, ET.Element]:
    return {element.get("id", ""): element for element in elements}


def _parameter(effect: ET.Element, sid: str, kind: str) -> ET.Element | None:
    for element in effect.iterfind(".//{*}newparam"):
        if element.get("sid") == sid:
            return element.find(f"{{*}}{kind}")
    return None


def _wraps(effect: ET.Element, sid: str) -> tuple[Wrap, Wrap]:
    sampler = _parameter(effect, sid, "sampler2D")
    written = (
        "" if sampler is None else (sampler.findtext(f"{{*}}wrap_{axis}") or "").strip()
        for axis in "st"
    )
    across, along = (_WRAPS.get(one, "repeat") for one in written)
    return across, along


def _color(
    effect: ET.Element, channel: ET.Element | None
) -> tuple[float, float, float, float] | None:
    """Return a channel's colour with its alpha, stated or by a parameter; None without one."""
    if channel is None:
        return None
    text = channel.findtext("{*}color")
    named = channel.find("{*}param")
    if named is not None:
        for kind in ("float4", "float3"):
            value = _parameter(effect, named.get("ref", ""), kind)
            text = text if value is None else value.text
    if text is None:
        return None
    red, green, blue, alpha = [*numbers_in_text(text, np.float64), 1.0][:4]
    return float(red), float(green), float(blue), float(alpha)
