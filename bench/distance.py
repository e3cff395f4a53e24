"""Distances by our own GJK and tree of triangles beside those of coal 3 (the successor of hpp-fcl).

The cases of docs/decisions/0008: boxes with parallel faces, boxes in any attitude, a level body
over a mesh of some 3,500 triangles. Exact: by arithmetic where faces are parallel, else by PQP on
triangles (python-fcl). coal is not a dependency: pip install coal.

    python bench/distance.py
"""

import math
import time
from collections.abc import Callable

import coal
import fcl
import numpy as np
from numpy.typing import NDArray

from wil_campaign.worlds.clearance.gjk import posed_convex_distance
from wil_campaign.worlds.clearance.surfaces import surface_distance, triangle_tree
from wil_campaign.worlds.frames import Quat, Vec3, matrix_from_quat

F64 = NDArray[np.float64]
CUBE = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float64)
SIDES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
FACES = np.array([f for a, b, c, d in SIDES for f in ((a, b, c), (a, c, d))], np.int32)
BODY = np.array([0.15, 0.15, 0.05])
ROUNDS = 2000
Placed = tuple[Vec3, Quat]


def coal_distance(one: object, other: object) -> Callable[[Placed], float]:
    """Return coal's distance of a placed geometry from another at the origin."""
    request, still = coal.DistanceRequest(), coal.Transform3s.Identity()
    request.gjk_tolerance, request.abs_err, request.rel_err = 1e-6, 0.0, 0.0

    def distance(at: Placed) -> float:
        place = coal.Transform3s(matrix_from_quat(at[1]), np.array(at[0]))
        found = coal.DistanceResult()
        return max(0.0, float(coal.distance(one, place, other, still, request, found)))

    return distance


def pqp_distance(corners: F64, faces: NDArray[np.int32], other: F64, mesh: NDArray[np.int32]):  # noqa: ANN201
    """Return the distance of triangles, by PQP."""
    models = []
    for points, triangles in ((corners, faces), (other, mesh)):
        model = fcl.BVHModel()
        model.beginModel(len(points), len(triangles))
        model.addSubModel(points, triangles)
        model.endModel()
        models.append(model)
    still = fcl.CollisionObject(models[1])

    def distance(at: Placed) -> float:
        moved = fcl.CollisionObject(models[0], fcl.Transform(np.array(at[1]), np.array(at[0])))
        return max(0.0, float(fcl.distance(moved, still)))

    return distance


def timed(distance: Callable[[Placed], float], cases: list[Placed]) -> tuple[F64, float]:
    """Return the distances, and microseconds for one: the best of three passes."""
    found = np.array([distance(at) for at in cases])
    best = math.inf
    for _ in range(3):
        begin = time.perf_counter()
        for at in cases:
            distance(at)
        best = min(best, (time.perf_counter() - begin) / len(cases) * 1e6)
    return found, best


def report(name: str, cases: list[Placed], exact: F64, **ways: Callable[[Placed], float]) -> None:
    """Print the errors and the time of each way."""
    apart = exact > 1e-6
    for way, distance in ways.items():
        found, took_us = timed(distance, cases)
        error = np.abs(found - exact)[apart]
        touching = int(np.sum(found[~apart] > 1e-4))
        print(
            f"{name:28} {way:5} error max {error.max() * 1e3:9.5f} mm, p99 "
            f"{np.percentile(error, 99) * 1e3:9.5f} mm, too near by at most "
            f"{max(0.0, (exact - found)[apart].max()) * 1e3:8.5f} mm, "
            f"contacts missed {touching}, {took_us:6.1f} us"
        )


def level(rng: np.random.Generator) -> Placed:
    """Return a level body at a quarter turn of yaw, somewhere about a bar."""
    half = int(rng.integers(4)) * math.pi / 4
    x, y, z = (float(v) for v in rng.uniform(-1.5, 1.5, 3))
    return (x, y, z), (math.cos(half), 0.0, 0.0, math.sin(half))


def anyhow(rng: np.random.Generator) -> Placed:
    """Return a body in any attitude."""
    q = rng.normal(size=4)
    w, i, j, k = (float(v) for v in q / np.linalg.norm(q))
    x, y, z = (float(v) for v in rng.uniform(-1.5, 1.5, 3))
    return (x, y, z), (w, i, j, k)


def boxes(rng: np.random.Generator, name: str, draw: Callable[..., Placed], bar: F64) -> None:
    """Compare boxes."""
    cases = [draw(rng) for _ in range(ROUNDS)]
    body, other = CUBE * BODY, CUBE * bar
    if draw is level:
        gaps = [np.maximum(np.abs(at) - BODY - bar, 0.0) for at, _ in cases]
        exact = np.array([np.linalg.norm(gap) for gap in gaps])
    else:
        pqp = pqp_distance(body, FACES, other, FACES)
        exact = np.array([pqp(at) for at in cases])
    theirs = coal_distance(coal.Box(*(2 * BODY)), coal.Box(*(2 * bar)))
    report(
        name, cases, exact, ours=lambda at: posed_convex_distance(body, *at, other)[0], coal=theirs
    )


def ground(rng: np.random.Generator) -> None:
    """Compare a level body over a mesh."""
    side = np.linspace(-3.0, 3.0, 43)
    north, east = np.meshgrid(side, side)
    height = 0.1 * np.sin(2 * north) * np.cos(3 * east)
    points = np.stack([north.ravel(), east.ravel(), height.ravel()], axis=1)
    index = np.arange(43 * 43).reshape(43, 43)
    a, b, c, d = (
        x.ravel() for x in (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:])
    )
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]).astype(np.int32)
    cases = []
    for _ in range(ROUNDS // 4):
        (x, y, _), q = level(rng)
        cases.append(((x, y, float(rng.uniform(0.2, 1.5))), q))
    body, tree = CUBE * BODY, triangle_tree(points, faces.astype(np.int64))
    pqp = pqp_distance(body, FACES, points, faces)
    mesh = coal.BVHModelOBBRSS()
    mesh.beginModel(len(faces), len(points))
    vertices, triangles = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    for point in points:
        vertices.append(point)
    for face in faces:
        triangles.append(coal.Triangle(*(int(i) for i in face)))
    mesh.addSubModel(vertices, triangles)
    mesh.endModel()
    theirs = coal_distance(coal.Box(*(2 * BODY)), mesh)
    exact = np.array([pqp(at) for at in cases])
    report(
        f"mesh of {len(faces)} triangles",
        cases,
        exact,
        ours=lambda at: surface_distance(body, *at, tree),
        coal=theirs,
    )


def main() -> None:
    """Print the table."""
    rng = np.random.default_rng(1)
    boxes(rng, "level body, bar", level, np.array([0.05, 0.05, 0.6]))
    boxes(rng, "level body, wall", level, np.array([0.05, 4.0, 2.0]))
    boxes(rng, "any attitude, bar", anyhow, np.array([0.05, 0.05, 0.6]))
    boxes(rng, "any attitude, thin", anyhow, np.array([1e-4, 0.3, 0.3]))
    ground(rng)


if __name__ == "__main__":
    main()
