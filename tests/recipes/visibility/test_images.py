"""What a mixed picture shows of virtual objects, against where geometry puts them."""

import math
from dataclasses import dataclass

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wil_campaign.recipes.visibility.images import ImagePair, compare_images
from wil_campaign.recipes.visibility.model import (
    ExpectedImage,
    FrameVisibility,
    ObjectVisibility,
    VirtualObjects,
)
from wil_campaign.vehicles.readings import BgrImage

WIDTH, HEIGHT, STEP = 160, 120, 4
GATE = 2
VIRTUAL = VirtualObjects({GATE: "gate"})
ORANGE = (0, 105, 220)


def ring(
    x: float = 80.0, y: float = 60.0, half: float = 22.0, bar: float = 4.0
) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """Return where a square gate is, in samples."""
    rows, columns = np.mgrid[0:HEIGHT, 0:WIDTH]
    away = np.maximum(abs(columns - x), abs(rows - y))
    return np.asarray((away <= half) & (away >= half - bar))


def room(seed: int, level: float = 140.0) -> BgrImage:
    """Return a wall with stains and a camera's noise."""
    rng = np.random.default_rng(seed)
    stains = cv2.resize(rng.normal(level, 20, (6, 8)), (WIDTH, HEIGHT))
    noise = rng.normal(0, 3, (HEIGHT, WIDTH, 3))
    return np.asarray(np.clip(stains[:, :, None] + noise, 0, 255), np.uint8)


def drawn(mask: np.ndarray[tuple[int, ...], np.dtype[np.bool_]], seed: int = 1) -> BgrImage:
    """Return a picture of the virtual world."""
    image = room(seed, 150.0)
    image[mask] = ORANGE
    return image


@dataclass
class Scene:
    """A real picture, and a gate that geometry puts into it."""

    real: BgrImage
    due: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]

    def compare(
        self,
        mixed: BgrImage,
        *,
        limit_px: float | None = None,
        is_like: bool = True,
        unknown: np.ndarray[tuple[int, ...], np.dtype[np.bool_]] | None = None,
    ) -> FrameVisibility:
        ids = np.where(self.due, np.uint8(GATE), np.uint8(1))
        return compare_images(
            ImagePair(
                t_s=1.0,
                real_bgr=self.real,
                mixed_bgr=mixed,
                expected=ExpectedImage(ids, drawn(self.due), unknown, STEP),
                virtual=VIRTUAL,
                limit_px=limit_px,
                is_like=is_like,
            )
        )

    def overlaid(self, mask: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]) -> BgrImage:
        """Return the real picture with a gate laid over it somewhere."""
        return np.where(mask[:, :, None], drawn(mask), self.real)


@pytest.fixture(scope="module")
def scene() -> Scene:
    return Scene(room(0), ring())


def gate_of(frame: FrameVisibility) -> ObjectVisibility:
    assert frame.not_measured == ""
    (gate,) = frame.objects
    return gate


def test_a_gate_in_its_place_is_shown(scene: Scene) -> None:
    gate = gate_of(scene.compare(scene.overlaid(ring())))
    assert (gate.in_view, gate.is_shown, gate.offset) == (True, True, 0.0)
    assert gate.shown == pytest.approx(1.0, abs=0.02)
    # A tenth of 180 px.
    assert gate.limit == pytest.approx(18.0)


def test_an_untouched_picture_shows_nothing(scene: Scene) -> None:
    gate = gate_of(scene.compare(scene.real.copy()))
    assert (gate.in_view, gate.is_shown, gate.shown, gate.offset) == (True, False, 0.0, None)


@given(st.integers(-14, 14), st.integers(-14, 14))
def test_a_shift_is_found_in_the_picture(across: int, down: int) -> None:
    """By the larger part of it; by less where an edge falls near another edge of the frame."""
    here = Scene(room(0), ring())
    gate = gate_of(here.compare(here.overlaid(ring(80.0 + across, 60.0 + down))))
    assert gate.offset is not None
    shift_px = STEP * max(abs(across), abs(down))
    assert 0.7 * shift_px - STEP <= gate.offset <= 1.5 * shift_px + STEP


def test_87_px_are_not_flown_without_a_word(scene: Scene) -> None:
    for away in (87 / STEP, -87 / STEP):
        assert gate_of(scene.compare(scene.overlaid(ring(80.0 + away)))).is_displaced


def test_87_px_are_too_far_however_near_the_gate_is() -> None:
    near = Scene(room(0), ring(half=75.0, bar=14.0))
    assert gate_of(near.compare(near.overlaid(ring(half=75.0, bar=14.0)))).offset == 0.0
    shifted = gate_of(near.compare(near.overlaid(ring(80.0 + 87 / STEP, half=75.0, bar=14.0))))
    assert shifted.is_displaced


@pytest.mark.parametrize("size", [0.6, 0.75, 1.3, 1.6])
def test_another_size_is_displaced(scene: Scene, size: float) -> None:
    mixed = scene.overlaid(ring(half=22.0 * size, bar=4.0 * size))
    assert gate_of(scene.compare(mixed)).is_displaced


def test_a_part_of_the_gate_shows_it(scene: Scene) -> None:
    """Light hides parts: half of it is shown, and that half is in its place."""
    half = ring()
    half[:, 95:] = False
    gate = gate_of(scene.compare(scene.overlaid(half)))
    assert gate.is_shown
    assert not gate.is_displaced


def test_a_limit_of_the_recipe_counts_to_the_resolution_of_the_comparison(scene: Scene) -> None:
    aside = scene.overlaid(ring(82.0))
    assert not gate_of(scene.compare(aside, limit_px=4.0)).is_displaced
    assert gate_of(scene.compare(aside, limit_px=2.0)).is_displaced
    assert not gate_of(scene.compare(scene.overlaid(ring()), limit_px=0.1)).is_displaced


@pytest.mark.parametrize(("aside", "displaced"), [(0.0, False), (1.0, False), (2.0, True)])
def test_a_small_image_is_compared_to_its_resolution(aside: float, displaced: bool) -> None:
    """1.5 % of an image of 48 samples are less than one, by which edges are rounded."""
    small = np.s_[:36, :48]
    due, shown = ring(24.0, 18.0, 4.0, 2.0)[small], ring(24.0 + aside, 18.0, 4.0, 2.0)[small]
    real, twin = room(0)[small], room(1)[small].copy()
    twin[due] = ORANGE
    ids = np.where(due, np.uint8(GATE), np.uint8(1))
    frame = compare_images(
        ImagePair(
            t_s=1.0,
            real_bgr=real,
            mixed_bgr=np.where(shown[:, :, None], np.array(ORANGE, np.uint8), real),
            expected=ExpectedImage(ids, twin, None, 1),
            virtual=VIRTUAL,
            limit_px=None,
            is_like=True,
        )
    )
    assert gate_of(frame).is_displaced is displaced


def test_an_object_drawn_where_none_is_due_is_reported() -> None:
    empty = Scene(room(0), np.zeros((HEIGHT, WIDTH), np.bool_))
    frame = empty.compare(empty.overlaid(ring(half=6.0, bar=2.0)))
    assert frame.is_unexpected
    assert not gate_of(frame).in_view
    # Just out of the picture, a gate may reach into it by the limit.
    edge = np.zeros((HEIGHT, WIDTH), np.bool_)
    edge[:, :2] = True
    assert not empty.compare(empty.overlaid(edge)).is_unexpected
    assert not empty.compare(empty.real.copy()).is_unexpected


def test_pixels_that_a_physical_object_may_hide_do_not_count(scene: Scene) -> None:
    hidden = np.zeros((HEIGHT, WIDTH), np.bool_)
    hidden[:, 85:] = True
    gate = gate_of(scene.compare(scene.overlaid(ring() & ~hidden), unknown=hidden))
    assert (gate.is_shown, gate.offset) == (True, 0.0)
    whole = gate_of(scene.compare(scene.overlaid(ring()), unknown=hidden))
    assert (whole.is_shown, whole.offset) == (True, 0.0)


@pytest.mark.parametrize(
    ("hidden_from", "is_shown", "is_unexpected"),
    [(0, True, True), (0, False, False), (85, True, False)],
)
def test_an_object_that_is_hidden_whole_and_shown_nevertheless_is_unexpected(
    scene: Scene, hidden_from: int, is_shown: bool, is_unexpected: bool
) -> None:
    """A recipe without depth draws it through a wall of the world file."""
    hidden = np.zeros((HEIGHT, WIDTH), np.bool_)
    hidden[:, hidden_from:] = True
    ids = np.where(ring(), np.uint8(GATE), np.uint8(1))
    hidden &= ring()
    expected = ExpectedImage(ids, drawn(ring()), hidden, STEP, hidden)
    mixed = scene.overlaid(ring()) if is_shown else scene.real.copy()
    pair = ImagePair(
        t_s=1.0,
        real_bgr=scene.real,
        mixed_bgr=mixed,
        expected=expected,
        virtual=VIRTUAL,
        limit_px=None,
        is_like=True,
    )
    assert compare_images(pair).is_unexpected is is_unexpected


@pytest.mark.parametrize("blend", [1.0, 0.5, 0.25])
def test_a_recipe_that_changes_everything_is_searched_for_the_gate(
    scene: Scene, blend: float
) -> None:
    def mixed(x: float) -> BgrImage:
        twin = drawn(ring(x)).astype(np.float64)
        return np.asarray(scene.real + blend * (twin - scene.real), np.uint8)

    right = gate_of(scene.compare(mixed(80.0)))
    assert (right.is_shown, right.offset) == (True, 0.0)
    aside = gate_of(scene.compare(mixed(100.0)))
    assert aside.offset == pytest.approx(80.0, abs=STEP)
    assert aside.is_displaced


@pytest.mark.parametrize(("share", "is_shown"), [(0.5, True), (0.25, True), (0.1, False)])
@pytest.mark.parametrize("whole", [True, False], ids=["whole picture", "isolated"])
def test_a_gate_of_too_little_contrast_is_not_shown(
    scene: Scene, share: float, is_shown: bool, whole: bool
) -> None:
    """A weighted merge shows its weight of the contrast."""
    twin = cv2.addWeighted(scene.real, 1.0 - share, drawn(ring()), share, 0.0)
    mixed = twin if whole else np.where(ring()[:, :, None], twin, scene.real)
    gate = gate_of(scene.compare(np.asarray(mixed, np.uint8)))
    assert (gate.in_view, gate.is_shown) == (True, is_shown)


def test_one_grey_level_shows_no_gate(scene: Scene) -> None:
    mixed = np.where(ring()[:, :, None], scene.real + 1, scene.real).astype(np.uint8)
    assert not gate_of(scene.compare(mixed)).is_shown
    # Nor is it something that geometry does not put there.
    assert not scene.compare(mixed).is_unexpected


def test_an_object_in_another_light_is_shown(scene: Scene) -> None:
    """As another simulator draws it."""
    for light in (0.5, 1.15):
        dim = np.where(ring()[:, :, None], drawn(ring()) * light, scene.real).astype(np.uint8)
        gate = gate_of(scene.compare(dim, is_like=False))
        assert (gate.is_shown, gate.offset) == (True, 0.0)


def test_an_object_before_a_wall_of_its_colour_is_shown() -> None:
    """Where there is nearly no contrast, nearly none is asked."""
    wall = room(0)
    wall[:, :100] = ORANGE
    wall[::2] -= 2
    here = Scene(wall, ring())
    assert gate_of(here.compare(here.overlaid(ring()))).is_shown


def test_an_object_in_the_edge_of_the_picture_need_not_be_shown() -> None:
    """It is as wide as what the default limit lets objects be beside their place."""
    edge = np.zeros((HEIGHT, WIDTH), np.bool_)
    edge[30:90, :3] = True
    here = Scene(room(0), edge)
    assert not gate_of(here.compare(here.real.copy())).in_view
    edge[30:90, :4] = True
    assert gate_of(here.compare(here.real.copy())).in_view


def test_an_object_left_out_by_name_is_reported_in_view(scene: Scene) -> None:
    ids = np.where(ring(), np.uint8(GATE), np.uint8(1))
    ids[10:20, 10:20] = 3
    hidden = np.zeros(ids.shape, np.bool_)
    virtual = VirtualObjects({GATE: "gate"}, {3: "intruder", 4: "decoy"})

    def left_out(
        unknown: np.ndarray[tuple[int, ...], np.dtype[np.bool_]] | None,
    ) -> FrameVisibility:
        return compare_images(
            ImagePair(
                t_s=1.0,
                real_bgr=scene.real,
                mixed_bgr=scene.overlaid(ring()),
                expected=ExpectedImage(ids, drawn(ring()), unknown, STEP),
                virtual=virtual,
                limit_px=None,
                is_like=True,
            )
        )

    frame = left_out(None)
    assert (frame.not_mixed, [one.name for one in frame.objects]) == (("intruder",), ["gate"])
    hidden[10:20, 10:20] = True
    assert left_out(hidden).not_mixed == ()


@pytest.mark.parametrize("beside", [frozenset({3}), frozenset()], ids=["may show", "leaves out"])
@pytest.mark.parametrize("x", [80.0, 400.0], ids=["beside the gate", "alone"])
def test_an_object_that_a_recipe_may_show_as_well_is_no_displaced_gate(
    x: float, beside: frozenset[int]
) -> None:
    """A colour isolates two objects, and `shows` names one of them."""
    scene = Scene(room(0), ring(x))
    tree = np.zeros(scene.due.shape, np.bool_)
    tree[10:60, 5:25] = True
    both = scene.due | tree
    ids = np.select([scene.due, tree], [GATE, 3], 1).astype(np.uint8)
    frame = compare_images(
        ImagePair(
            t_s=1.0,
            real_bgr=scene.real,
            mixed_bgr=scene.overlaid(both),
            expected=ExpectedImage(ids, drawn(both), None, STEP),
            virtual=VirtualObjects({GATE: "gate"}, {3: "tree"}, beside),
            limit_px=None,
            is_like=True,
        )
    )
    is_wrong = gate_of(frame).is_displaced or frame.is_unexpected
    assert (is_wrong, frame.not_mixed) == (not beside, ("tree",))


def test_a_board_in_place_of_a_gate_is_unexpected(scene: Scene) -> None:
    """Its outline is that of the gate, whose opening it fills."""
    rows, columns = np.mgrid[0:HEIGHT, 0:WIDTH]
    board = np.maximum(abs(columns - 80.0), abs(rows - 60.0)) <= 22.0
    assert scene.compare(scene.overlaid(board)).is_unexpected
    assert not scene.compare(scene.overlaid(ring())).is_unexpected
    assert not scene.compare(scene.overlaid(ring(83.0))).is_unexpected


def test_a_whole_picture_without_the_gate_does_not_show_it(scene: Scene) -> None:
    without = room(5, 150.0)
    gate = gate_of(scene.compare(without))
    assert (gate.in_view, gate.is_shown, gate.offset) == (True, False, None)
    # Another renderer's picture may look otherwise: that is not measured, and said.
    assert scene.compare(without, is_like=False).not_measured
    assert gate_of(scene.compare(drawn(ring()), is_like=False)).is_shown


def test_a_hole_in_the_shape_of_the_gate_does_not_show_it(scene: Scene) -> None:
    """What a recipe makes that isolates all but the gate."""
    dark = Scene(room(0, 90.0), ring())
    mixed = np.where(ring()[:, :, None], dark.real, room(5, 180.0))
    gate = gate_of(dark.compare(mixed))
    assert (gate.in_view, gate.is_shown, gate.offset) == (True, False, None)


@pytest.mark.parametrize("both", [False, True])
def test_two_objects_are_distinguished(both: bool) -> None:
    left, right = ring(40.0, half=15.0), ring(120.0, half=15.0)
    ids = np.where(left, np.uint8(2), np.where(right, np.uint8(3), np.uint8(1)))
    real = room(0)
    overlaid = left | right if both else right
    mixed = np.where(overlaid[:, :, None], drawn(overlaid), real)
    frame = compare_images(
        ImagePair(
            t_s=1.0,
            real_bgr=real,
            mixed_bgr=mixed,
            expected=ExpectedImage(ids, drawn(left | right), None, STEP),
            virtual=VirtualObjects({2: "left", 3: "right"}),
            limit_px=None,
            is_like=True,
        )
    )
    assert {one.name: (one.in_view, one.is_shown, one.offset) for one in frame.objects} == {
        "left": (True, both, 0.0 if both else None),
        "right": (True, True, 0.0),
    }
    assert math.isclose(frame.elsewhere, 0.0)


BACK = 3


def before_a_wall(x: float | None) -> ObjectVisibility:
    """Return what a mixture shows of a gate before a virtual wall. x: of the gate, if any."""
    real, due = room(0), ring()
    rows, columns = np.mgrid[0:HEIGHT, 0:WIDTH]
    wall = (rows > 10) & (rows < 110) & (columns > 8) & (columns < 152)

    def picture(gate: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]) -> BgrImage:
        return np.where(wall[:, :, None], drawn(gate), real)

    nowhere = np.zeros_like(due)
    frame = compare_images(
        ImagePair(
            t_s=1.0,
            real_bgr=real,
            mixed_bgr=picture(nowhere if x is None else ring(x)),
            expected=ExpectedImage(
                np.where(due, GATE, np.where(wall, BACK, 0)).astype(np.uint8),
                picture(due),
                None,
                STEP,
            ),
            virtual=VirtualObjects({GATE: "gate", BACK: "wall"}),
            limit_px=None,
            is_like=True,
        )
    )
    return next(one for one in frame.objects if one.name == "gate")


def test_an_object_before_another_virtual_one_is_sought_as_it_is_drawn() -> None:
    """All is changed around it: where something was changed does not show where it is."""
    there, aside, missing = before_a_wall(80.0), before_a_wall(100.0), before_a_wall(None)
    assert (there.is_shown, there.is_displaced) == (True, False)
    assert aside.offset == pytest.approx(80.0, abs=STEP)
    assert aside.is_displaced
    assert not missing.is_shown


WALL = 3
RED = (10, 20, 120)
BEHIND = VirtualObjects({GATE: "gate", WALL: "wall"})


def ball_before_a_wall(*, wall: bool, away: int = 0) -> FrameVisibility:
    """Return what a picture shows of a ball before a virtual wall. away: samples that it is off."""
    real = room(0)
    rows, columns = np.mgrid[0:HEIGHT, 0:WIDTH]

    def ball(x: int) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
        return np.asarray(np.hypot(rows - 60, columns - x) <= 12)

    behind = (abs(rows - 60) <= 30) & (abs(columns - 80) <= 40)
    virtual = room(1, 150.0)
    virtual[behind] = np.where((columns // 6 % 2 == 0)[behind][:, None], (250, 250, 250), (9, 9, 9))
    expected, mixed = virtual.copy(), real.copy()
    expected[ball(80)] = RED
    if wall:
        mixed[behind] = virtual[behind]
    mixed[ball(80 + away)] = RED
    ids = np.where(behind, np.uint8(WALL), np.uint8(1))
    ids[ball(80)] = GATE
    return compare_images(
        ImagePair(
            t_s=1.0,
            real_bgr=real,
            mixed_bgr=mixed,
            expected=ExpectedImage(ids, expected, None, STEP),
            virtual=BEHIND,
            limit_px=None,
            is_like=True,
        )
    )


@pytest.mark.parametrize("wall", [True, False])
def test_an_object_before_one_that_is_not_shown_is_not_displaced(*, wall: bool) -> None:
    """What was searched in the picture was the object with the one behind it: 57 px away."""
    ball, behind = ball_before_a_wall(wall=wall).objects
    assert (ball.is_shown, ball.is_displaced, ball.offset) == (True, False, 0.0)
    assert (behind.in_view, behind.is_shown) == (True, wall)


@pytest.mark.parametrize("wall", [True, False])
def test_an_object_beside_its_place_is_displaced_also_before_a_hidden_one(*, wall: bool) -> None:
    ball, _ = ball_before_a_wall(wall=wall, away=10).objects
    assert ball.is_displaced
