"""Public meshes as this program reads them beside trimesh (and pycollada, behind it).

    python bench/meshes.py FOLDER [--slow S]

Reads every mesh file below a folder with both: triangles, area and extent, as the file has them.
Prints each file that both read differently, and why others were refused, most frequent first. A
difference is a fault of one of them, and is to be looked at: exit code 1. --slow: prints files that
take longer, with the seconds of both.
"""

import argparse
import re
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray

from wil_campaign.plugins.meshes.mesh_reader import SUFFIXES, Z_UP, load_mesh_shape
from wil_campaign.worlds.scene.mesh_formats import MeshFileError

Corners = NDArray[np.float64]
_NAMES = re.compile(r"'[^']*'|\d[\d.e+-]*")
_ALIKE = 1e-4
"""Of area and extent: the other reads Collada in single precision."""


@dataclass(frozen=True, slots=True)
class Read:
    """What a reader made of a file: the corners of triangles (n, 3, 3), or why not."""

    corners: Corners
    refused: str
    seconds: float

    @property
    def area(self) -> float:
        """Return the area of all triangles, in the file's unit squared."""
        edges = self.corners[:, 1:] - self.corners[:, :1]
        return float(np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1).sum()) / 2.0

    @property
    def extent(self) -> Corners:
        """Return the least and greatest coordinates (2, 3), in the file's unit."""
        points = self.corners.reshape(-1, 3)
        return np.stack([points.min(axis=0), points.max(axis=0)])


def read_ours(path: Path, *, draws_transparent: bool) -> Read:
    """Return what this program makes of a mesh file, in the file's axes and unit."""
    begin = time.perf_counter()
    try:
        mesh = load_mesh_shape(path, unit="m", axes=Z_UP, draws_transparent=draws_transparent).mesh
    except MeshFileError as error:
        return Read(np.empty((0, 3, 3)), str(error), time.perf_counter() - begin)
    taken = time.perf_counter() - begin
    return Read(mesh.vertices_m[mesh.faces] * (1.0, -1.0, -1.0), "", taken)


def read_theirs(path: Path) -> Read:
    """Return what trimesh makes of a mesh file."""
    begin = time.perf_counter()
    try:
        scene = trimesh.load_scene(str(path), process=False)
        parts = [one for one in scene.dump() if isinstance(one, trimesh.Trimesh) and len(one.faces)]
        corners = [np.asarray(part.vertices, float)[part.faces] for part in parts]
    except Exception as error:  # noqa: BLE001 - it raises anything for a damaged file
        return Read(np.empty((0, 3, 3)), repr(error)[:80], time.perf_counter() - begin)
    taken = time.perf_counter() - begin
    if not corners:
        return Read(np.empty((0, 3, 3)), "no triangles", taken)
    return Read(np.concatenate(corners), "", taken)


def difference(ours: Read, theirs: Read) -> str:
    """Return in what two readers differ; "" for nothing."""
    if len(ours.corners) != len(theirs.corners):
        return f"{len(ours.corners)} triangles, the other {len(theirs.corners)}"
    if not np.isclose(ours.area, theirs.area, rtol=_ALIKE):
        return f"an area of {ours.area:.6g}, the other {theirs.area:.6g}"
    far = float(np.abs(ours.extent - theirs.extent).max())
    if far > _ALIKE * float(np.abs(theirs.extent).max()):
        return f"an extent that differs by {far:.3g}"
    return ""


def main() -> int:
    """Print how the files of a folder are read; return whether any differs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--slow", type=float, default=5.0)
    options = parser.parse_args()
    found = sorted(one for one in options.folder.rglob("*") if one.suffix.lower() in SUFFIXES)
    count: Counter[str] = Counter()
    reasons: Counter[str] = Counter()
    spent = np.zeros(2)
    for path in found:
        name = path.relative_to(options.folder)
        ours = read_ours(path, draws_transparent=True)
        if ours.refused:
            count["refused"] += 1
            reasons[_NAMES.sub("_", ours.refused)[:100]] += 1
            continue
        theirs = read_theirs(path)
        spent += (ours.seconds, theirs.seconds)
        if max(ours.seconds, theirs.seconds) > options.slow:
            print(f"slow: {name}: {ours.seconds:.1f} s, the other {theirs.seconds:.1f} s")
        told = "" if theirs.refused else difference(ours, theirs)
        count["read, the other cannot" if theirs.refused else (told and "differ") or "same"] += 1
        if told:
            print(f"differs: {name}: {told}")
        elif (opaque := read_ours(path, draws_transparent=False)).refused:
            reasons[_NAMES.sub("_", opaque.refused)[:100]] += 1
            count["of these read as 'transparent: opaque' alone"] += 1
    for reason, times in reasons.most_common():
        print(f"{times:5} {reason}")
    print(f"{len(found)} files:", ", ".join(f"{times} {what}" for what, times in count.items()))
    print(f"those read by both: {spent[0]:.1f} s, the other {spent[1]:.1f} s")
    return int(count["differ"] > 0)


if __name__ == "__main__":
    raise SystemExit(main())
