"""Reads the materials of .obj files (.mtl): Wavefront, "MTL material format", 1995."""

import contextlib
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from wil_campaign.plugins.meshes.beside import file_beside, image_beside
from wil_campaign.plugins.meshes.looks import NO_LOOK, PLAIN_RGB, LookPicture, SurfaceLook, Wrap
from wil_campaign.plugins.meshes.mesh_support import UnsupportedMeshError

_LIBRARY = re.compile(rb"^mtllib +(.+?) *$", re.MULTILINE)
_VECTORS = ("-s", "-o", "-t")
"""Options of one to three numbers."""
_VALUES = {"-mm": 2} | dict.fromkeys(
    ("-blendu", "-blendv", "-boost", "-bm", "-cc", "-clamp", "-imfchan", "-texres"), 1
)
"""Number of values of the other options."""

_Statements = Mapping[str, str]
"""By keyword in lower case: what follows it."""


@dataclass(frozen=True, slots=True)
class ObjMaterials:
    """The materials that an .obj file may use, by name, with the folder of their library."""

    has_library: bool
    by_name: Mapping[str, tuple[Path, _Statements]]

    @classmethod
    def beside(cls, path: Path, text: bytes) -> "ObjMaterials":
        """Return the materials of all libraries of an .obj file; of equal names the first.

        Raises UnsupportedMeshError for a library that is missing.
        """
        found: dict[str, tuple[Path, _Statements]] = {}
        libraries = list(libraries_of(path, text))
        for library in libraries:
            for name, statements in _materials(library).items():
                found.setdefault(name, (library.parent, statements))
        return cls(bool(libraries), found)

    def look(self, name: str) -> SurfaceLook:
        """Return the look of a material. Raises UnsupportedMeshError for one that is missing."""
        if not name:
            return NO_LOOK
        if name not in self.by_name:
            where = "its libraries do not have" if self.has_library else "it has no library for"
            raise UnsupportedMeshError(
                f"faces use the material '{name[:60]}', which {where}; name one (mtllib), or leave "
                "usemtl out"
            )
        folder, statements = self.by_name[name]
        try:
            return _look(name, folder, statements)
        except ValueError as error:
            raise UnsupportedMeshError(f"material '{name[:60]}' is damaged") from error


def libraries_of(path: Path, text: bytes) -> Iterator[Path]:
    """Yield the libraries that an .obj file names: in each statement one, or several in words."""
    for written in _LIBRARY.findall(text):
        name = written.decode("utf-8", "surrogateescape")
        try:
            yield file_beside(path.parent, name)
        except UnsupportedMeshError:
            words = name.split()
            if len(words) == 1:
                raise
            for word in words:
                yield file_beside(path.parent, word)


def images_of(library: Path) -> Iterator[Path]:
    """Yield the images that are there of those that a library's materials name."""
    for name, statements in _materials(library).items():
        for written in (statements.get("map_kd"), statements.get("map_d")):
            with contextlib.suppress(ValueError, UnsupportedMeshError):
                if written:
                    yield _file(_picture(name, library.parent, written))


def _file(picture: LookPicture) -> Path:
    if not isinstance(picture.source, Path):
        raise TypeError("an image without a file")
    return picture.source


def _materials(library: Path) -> Mapping[str, _Statements]:
    found: dict[str, dict[str, str]] = {}
    current: dict[str, str] = {}
    text = library.read_bytes().decode("utf-8", "surrogateescape").lstrip("\ufeff")
    for line in text.replace("\\\n", " ").splitlines():
        keyword, _, rest = line.strip().partition(" ") if "\t" not in line else _words(line)
        if keyword.lower() == "newmtl":
            current = found[rest.strip()] = {}
        elif keyword and not keyword.startswith("#"):
            current[keyword.lower()] = rest.strip()
    return found


def _words(line: str) -> tuple[str, str, str]:
    return line.replace("\t", " ").strip().partition(" ")


def _look(name: str, folder: Path, statements: _Statements) -> SurfaceLook:
    picture = _picture(name, folder, statements["map_kd"]) if "map_kd" in statements else None
    if picture is None and "kd" not in statements and {"map_ka", "map_ke"} & statements.keys():
        raise UnsupportedMeshError(
            f"material '{name}' has no diffuse colour or texture (Kd, map_Kd), only others"
        )
    opacity = _file(_picture(name, folder, statements["map_d"])) if "map_d" in statements else None
    return SurfaceLook(
        name=name,
        rgb=_diffuse(name, statements, is_textured=picture is not None),
        picture=picture,
        alpha=_alpha(statements),
        alpha_of="nothing" if _alpha(statements) == 1.0 and opacity is None else "glass",
        opacity=opacity,
    )


def _diffuse(
    name: str, statements: _Statements, *, is_textured: bool
) -> tuple[float, float, float]:
    """Return the colour of a material, with which its texture is multiplied.

    Black under a texture is what exporters write that mean the texture alone.
    """
    words = statements.get("kd", "").split()
    if words and words[0] in ("spectral", "xyz"):
        raise UnsupportedMeshError(f"material '{name}' has its colour as '{words[0]}', not in RGB")
    values = [float(word) for word in words]
    if is_textured and not any(values):
        return (1.0, 1.0, 1.0)
    if not values:
        return PLAIN_RGB
    if len(values) not in (1, 3):
        raise ValueError("a colour is one number or three")
    red, green, blue = values * 3 if len(values) == 1 else values
    return (red, green, blue)


def _alpha(statements: _Statements) -> float:
    """Return a material's opacity.

    Exporters differ in whether Tr 0 or Tr 1 is opaque: neither end is taken for transparent.
    """
    if "d" in statements:
        return float(statements["d"].split()[-1])
    transparency = float(statements["tr"].split()[-1]) if statements.get("tr") else 0.0
    return 1.0 - transparency if 0.0 < transparency < 1.0 else 1.0


def _picture(name: str, folder: Path, written: str) -> LookPicture:
    """Return the picture of a statement like map_Kd: options, and a file.

    Texture coordinates are multiplied by -s and moved by -o, as other programs have it.
    """
    options: dict[str, list[str]] = {}
    rest = written
    while rest.startswith("-"):
        option, _, rest = rest.partition(" ")
        option, rest = option.lower(), rest.lstrip()
        if option not in _VECTORS and option not in _VALUES:
            raise UnsupportedMeshError(f"material '{name}' has the option {option[:20]}: unknown")
        values = options.setdefault(option, [])
        while len(values) < _VALUES.get(option, 3):
            word, _, behind = rest.partition(" ")
            if not behind.strip() or (option in _VECTORS and not _is_number(word)):
                break
            values.append(word)
            rest = behind.lstrip()
    if any(float(one) for one in options.get("-t", ())):
        raise UnsupportedMeshError(f"material '{name}' has turbulence (-t), which is not drawn")
    across, along = _pair(options.get("-s", []), 1.0)
    right, up = _pair(options.get("-o", []), 0.0)
    base, gain = map(float, options.get("-mm", ["0", "1"]))
    if not math.isfinite(base + gain):
        raise ValueError("-mm is not finite")
    wrap: Wrap = "clamp" if options.get("-clamp", ["off"])[0].lower() == "on" else "repeat"
    return LookPicture(
        image_beside(folder, rest.strip(), by=f"material '{name}'"),
        affine=((across, 0.0, right), (0.0, along, up)),
        wraps=(wrap, wrap),
        gain=gain,
        base=base,
    )


def _pair(words: list[str], default: float) -> tuple[float, float]:
    """Return an option's first two numbers; what is left out has its default."""
    first, second = ([float(word) for word in words[:2]] + [default] * 2)[:2]
    return first, second


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
