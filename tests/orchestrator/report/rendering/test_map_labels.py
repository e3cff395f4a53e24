"""Names in a map: clear of each other, of markers and of the border, whatever stands there."""

import itertools

from hypothesis import given
from hypothesis import strategies as st

from wil_campaign.orchestrator.report.rendering.map_labels import LabelBox, place_names, text_box

AREA = LabelBox(0.0, 0.0, 420.0, 300.0)


def test_a_name_goes_above_its_object() -> None:
    (placed,) = place_names([("gate", LabelBox(100.0, 100.0, 140.0, 110.0))], [], AREA)
    assert (placed.at, placed.anchor, placed.leader) == ((120.0, 95.0), "middle", None)


def test_names_of_objects_at_one_place_do_not_collide() -> None:
    box = LabelBox(200.0, 150.0, 210.0, 160.0)
    names = [f"pillar-{k}" for k in range(8)]
    placed = place_names([(name, box) for name in names], [box], AREA)
    assert [one.name for one in placed] == names
    assert any(one.leader is not None for one in placed)
    boxes = [text_box(one) for one in placed]
    assert not any(a.meets(b) for a, b in itertools.combinations([*boxes, box], 2))


def test_a_name_without_a_free_place_is_left_out() -> None:
    box = LabelBox(200.0, 150.0, 210.0, 160.0)
    assert place_names([("gate", box)], [AREA], AREA) == []


@given(
    st.lists(
        st.tuples(
            st.text("abcxyz-", min_size=1, max_size=12), st.floats(0, 400), st.floats(0, 290)
        ),
        max_size=12,
    )
)
def test_no_two_names_ever_collide(given: list[tuple[str, float, float]]) -> None:
    wanted = [(name, LabelBox(x, y, x + 10.0, y + 10.0)) for name, x, y in given]
    boxes = [text_box(place_name) for place_name in place_names(wanted, [], AREA)]
    assert all(box.is_within(AREA) for box in boxes)
    assert not any(a.meets(b) for a, b in itertools.combinations(boxes, 2))
