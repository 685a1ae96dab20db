from __future__ import annotations

import pytest

from struck.scene.gathered_notes import gather_notes, list_names


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (["ball"], "ball"),
        (["a", "b"], "a and b"),
        (["a", "b", "c"], "a, b and c"),
        (["c0", "c1"], "c0 and c1"),
        (["c0", "c1", "c2", "c3"], "c0 to c3"),
        (["c3", "c1", "c2"], "c1 to c3"),
        (["d08", "d09", "d10"], "d08 to d10"),
        (["cube 1", "cube 2", "cube 3", "ball"], "cube 1 to cube 3 and ball"),
        (["c0", "c2", "c4"], "c0, c2 and c4"),
        (["7", "8", "9"], "7 to 9"),
        ([*"abcdef"], "a, b, c, d, e and f"),
        ([*"abcdefgh"], "a, b, c, d, e and 3 others"),
        (["a", "b", "c", "d", "e", "f", "x1", "x2", "x3"], "a, b, c, d, e and 4 others"),
    ],
)
def test_names_are_listed_in_words(names: list[str], words: str) -> None:
    assert list_names(names) == words


def test_names_may_be_quoted() -> None:
    assert list_names(["d1", "d2", "d3", "ball"], "'{}'") == "'d1' to 'd3' and 'ball'"


def test_equal_notes_become_one_line_in_the_order_of_the_first() -> None:
    notes = [("a", "its walls"), ("b", "other"), ("c", "its walls"), ("a", "its walls")]
    assert gather_notes(notes) == ("a and c: their walls", "b: other")
    assert gather_notes([("a", "it is silent")]) == ("a: it is silent",)
    assert gather_notes([("a", "it is silent"), ("b", "it is silent")]) == (
        "a and b: they are silent",
    )
    assert gather_notes([]) == ()
