"""How the surfaces of a mesh file look, by its own materials: colours and textures.

Each format's reader states its materials as `SurfaceLook`; here they become what is drawn.
What it does not draw is refused by the material's name, for a camera would see something else.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from wil_campaign.foundation.files.images import ImageError, decode_image_file, read_image, read_tga
from wil_campaign.plugins.meshes.mesh_support import UnsupportedMeshError
from wil_campaign.worlds.scene.colors import Rgb, srgb_of_linear
from wil_campaign.worlds.scene.meshes import BgrTexture, FloatArray, IntArray, Material
from wil_campaign.worlds.scene.textures import texture_to_powers_of_two

Wrap = Literal["repeat", "mirror", "clamp"]
AlphaOf = Literal["nothing", "cut-outs", "glass"]

PLAIN_RGB = (150 / 255.0, 150 / 255.0, 150 / 255.0)
"""Of a surface without a material."""
_MOST_COLORS = 64
_OPAQUE = 254.5 / 255.0
_FARTHEST = 1e6
"""Of a texture coordinate: beyond it single precision has no places on an image."""
_SEAM = 0.01
"""Of a texture: how far beyond its edge a corner may lie that is meant to be on it."""

_IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
Affine = tuple[tuple[float, float, float], tuple[float, float, float]]


@dataclass(frozen=True, slots=True)
class LookPicture:
    """The image of a look: a file, or bytes of the mesh file.

    uv_set: which texture coordinates place it. affine: maps these, as the file has them, to those
    of the image. wraps: what lies beyond its edges across and along. gain, base: of its colours.
    """

    source: Path | bytes
    uv_set: int = 0
    affine: Affine = _IDENTITY
    wraps: tuple[Wrap, Wrap] = ("repeat", "repeat")
    gain: float = 1.0
    base: float = 0.0


@dataclass(frozen=True, slots=True)
class SurfaceLook:
    """A material of a mesh file. name: for messages. rgb: 0 to 1, multiplied with the picture.

    is_linear: whether rgb and the colours of vertices are linear, as in glTF, else sRGB. alpha:
    opacity of the colour. alpha_of: what alpha below 1 means; cut-outs are where it is below
    cutoff. opacity: a picture of its own, whose alpha (or brightness without one) counts.
    """

    name: str
    rgb: tuple[float, float, float] = PLAIN_RGB
    picture: LookPicture | None = None
    is_linear: bool = False
    alpha: float = 1.0
    alpha_of: AlphaOf = "nothing"
    cutoff: float = 0.5
    opacity: Path | None = None


NO_LOOK = SurfaceLook("")


@dataclass(frozen=True, slots=True, eq=False)
class FilePart:
    """Triangles of one look, as a mesh file has them, in its axes and unit.

    vertices: (n, 3). faces: (m, 3). uv: (n, 2) as the file has them, or None. v_is_up: whether v
    counts from the image's last row. colors: (n or m, 3 or 4), 0 to 1, of vertices or faces, or
    None; with is_by_face of faces.
    """

    vertices: FloatArray
    faces: IntArray
    look: SurfaceLook = NO_LOOK
    uv: FloatArray | None = None
    v_is_up: bool = True
    colors: FloatArray | None = None
    is_by_face: bool = False


@dataclass(frozen=True, slots=True)
class LookPainter:
    """Makes materials of looks. draws_transparent: transparent surfaces are drawn as opaque."""

    draws_transparent: bool = False
    _images: dict[Path | bytes, NDArray[Any]] = field(default_factory=dict)
    _textures: dict[tuple[LookPicture, tuple[bool, bool]], BgrTexture] = field(default_factory=dict)

    def paint(self, part: FilePart) -> tuple[FloatArray, IntArray, tuple[Material, ...]]:
        """Return texture coordinates (v downwards), each face's material, and the materials.

        Raises UnsupportedMeshError, with the material's name, for a look that cannot be drawn.
        """
        look = part.look
        image = None if look.picture is None else self._image(look, look.picture.source)
        if not self.draws_transparent:
            self._check_alpha(part, image)
        to_srgb = srgb_of_linear if look.is_linear else _same
        rgb = np.rint(255.0 * to_srgb(np.clip(_colors_of(part), 0.0, 1.0))).astype(np.int32)
        if look.picture is None or image is None:
            index, colors = _few(rgb, len(part.faces))
            uv = np.zeros((len(part.vertices), 2))
            return uv, index, tuple(Material(_rgb(color)) for color in colors)
        uv, is_mirrored = _placed(part, look.picture)
        material = Material(_only(look, rgb), self._texture(look.picture, image, is_mirrored))
        return uv, np.zeros(len(part.faces), np.int32), (material,)

    def _image(self, look: SurfaceLook, source: Path | bytes) -> NDArray[Any]:
        """Return the pixels of an image, (height, width, 3 or 4), 8 bit, BGR and alpha."""
        if source not in self._images:
            try:
                pixels = _decoded(source)
            except (ImageError, OSError) as error:
                what = "" if isinstance(source, bytes) else f" '{source.name}'"
                raise UnsupportedMeshError(
                    f"the image{what} of material '{look.name}' cannot be decoded: {error}"
                ) from error
            self._images[source] = _bgr(pixels)
        return self._images[source]

    def _texture(
        self, picture: LookPicture, image: NDArray[Any], is_mirrored: tuple[bool, bool]
    ) -> BgrTexture:
        """Return an image as a texture; equal ones are one array, which is packed once.

        is_mirrored: whether it goes on as its mirror image, across and along.
        """
        key = picture, is_mirrored
        if key not in self._textures:
            bgr = image[:, :, :3]
            if (picture.gain, picture.base) != (1.0, 0.0):
                changed = np.rint(bgr * picture.gain + 255.0 * picture.base)
                bgr = np.clip(changed, 0, 255).astype(np.uint8)
            for axis, mirrored in zip((1, 0), is_mirrored, strict=True):
                bgr = np.concatenate([bgr, np.flip(bgr, axis)], axis) if mirrored else bgr
            self._textures[key] = texture_to_powers_of_two(np.ascontiguousarray(bgr))
        return self._textures[key]

    def _check_alpha(self, part: FilePart, image: NDArray[Any] | None) -> None:
        """Raise UnsupportedMeshError for a look through which something else would be seen."""
        look = part.look
        if look.alpha_of == "nothing":
            return
        alpha = look.alpha
        if part.colors is not None and part.colors.shape[1] > len("rgb"):
            alpha *= float(part.colors[:, 3].min(initial=1.0))
        if look.opacity is not None:
            pixels = self._image(look, look.opacity)
            shown = pixels[:, :, 3] if pixels.shape[2] > len("bgr") else pixels.min(axis=2)
            alpha *= float(shown.min()) / 255.0
        elif image is not None and image.shape[2] > len("bgr"):
            alpha *= float(image[:, :, 3].min()) / 255.0
        if alpha < (look.cutoff if look.alpha_of == "cut-outs" else _OPAQUE):
            what = "has cut-outs" if look.alpha_of == "cut-outs" else "is transparent"
            raise UnsupportedMeshError(
                f"material '{look.name}' {what} (alpha {alpha:.2g}), which is not drawn; make it "
                "opaque, or write 'transparent: opaque' beside 'file' to draw it so"
            )


def _decoded(source: Path | bytes) -> NDArray[Any]:
    """Return the pixels of an image as it has them. Raises ImageError, OSError."""
    if isinstance(source, bytes):
        return decode_image_file(source, cv2.IMREAD_UNCHANGED)
    if source.suffix.lower() == ".tga":
        return read_tga(source)
    return read_image(source, cv2.IMREAD_UNCHANGED)


def _same(values: FloatArray) -> FloatArray:
    return values


def _bgr(pixels: NDArray[Any]) -> NDArray[Any]:
    """Return decoded pixels as (height, width, 3 or 4) of 8 bits."""
    if pixels.dtype == np.uint16:
        pixels = (pixels >> 8).astype(np.uint8)
    elif pixels.dtype != np.uint8:
        pixels = np.clip(np.rint(255.0 * pixels), 0, 255).astype(np.uint8)
    if pixels.ndim == 2 or pixels.shape[2] == 1:
        return np.repeat(pixels.reshape(*pixels.shape[:2], 1), 3, axis=2)
    if pixels.shape[2] == 2:
        return np.concatenate([np.repeat(pixels[:, :, :1], 3, axis=2), pixels[:, :, 1:]], axis=2)
    return pixels


def _colors_of(part: FilePart) -> FloatArray:
    """Return the colour of each face, (m, 3), or the one of all, (1, 3).

    The file's own colours and the material's are multiplied.
    """
    if not np.isfinite(part.look.rgb).all():
        raise UnsupportedMeshError(f"the colour of material '{part.look.name}' is not finite")
    if part.colors is None:
        return np.array([part.look.rgb])
    rgb = part.colors[:, :3]
    rgb = rgb if part.is_by_face else rgb[part.faces].mean(axis=1)
    return rgb if part.look is NO_LOOK else rgb * np.array(part.look.rgb)


def _few(rgb: IntArray, count: int) -> tuple[IntArray, IntArray]:
    """Return the index of each face's colour, and the colours, rounded where they are many."""
    if len(rgb) == 1:
        return np.zeros(count, np.int32), rgb
    for step in (1, 32, 64):
        packed = ((rgb // step * step + step // 2) * (1 << 16, 1 << 8, 1)).sum(axis=1)
        colors, index = np.unique(packed, return_inverse=True)
        if len(colors) <= _MOST_COLORS:
            break
    unpacked = np.stack([colors >> 16, colors >> 8 & 0xFF, colors & 0xFF], axis=1)
    return index.reshape(-1).astype(np.int32), unpacked


def _only(look: SurfaceLook, rgb: IntArray) -> Rgb:
    """Return the one colour of a textured part. Raises UnsupportedMeshError for several."""
    if np.ptp(rgb, axis=0).max() > 1:
        raise UnsupportedMeshError(
            f"material '{look.name}' has a texture and different colours of vertices over it, "
            "which are not drawn together; export the mesh with one of them"
        )
    return _rgb(rgb[0])


def _placed(part: FilePart, picture: LookPicture) -> tuple[FloatArray, tuple[bool, bool]]:
    """Return texture coordinates in repeats of the texture, v downwards, and where it is mirrored.

    A mirrored texture has the image twice.
    """
    if part.uv is None:
        raise UnsupportedMeshError(
            f"material '{part.look.name}' has a texture, and faces with it have no places on it "
            "(texture coordinates)"
        )
    matrix = np.array(picture.affine)
    uv = part.uv @ matrix[:, :2].T + matrix[:, 2]
    if not np.isfinite(uv).all() or np.abs(uv).max(initial=0.0) > _FARTHEST:
        raise UnsupportedMeshError(
            f"texture coordinates of material '{part.look.name}' are not finite, or are far away"
        )
    if part.v_is_up:
        uv = np.stack([uv[:, 0], 1.0 - uv[:, 1]], axis=1)
    used = uv[part.faces.reshape(-1)]
    beyond = np.abs(used - 0.5).max(axis=0, initial=0.0) > 0.5 + _SEAM
    if any(one and wrap == "clamp" for one, wrap in zip(beyond, picture.wraps, strict=True)):
        raise UnsupportedMeshError(
            f"the texture of material '{part.look.name}' is not repeated (clamped), and faces go "
            "beyond its edges, which is not drawn"
        )
    across, along = (
        bool(one) and wrap == "mirror" for one, wrap in zip(beyond, picture.wraps, strict=True)
    )
    return uv * (0.5 if across else 1.0, 0.5 if along else 1.0), (across, along)


def _rgb(color: Any) -> Rgb:
    return (int(color[0]), int(color[1]), int(color[2]))
