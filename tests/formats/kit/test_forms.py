"""The forms that annotations stand for: texts, unions distinguished by their kind, and the way back to plain data."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

import pytest

from simspec.formats.kit.forms import check_fields, form_of, plain, typed


@dataclass(frozen=True)
class Hinge:
    axis: tuple[float, float, float]
    kind: Literal["hinge", "slide"]


@dataclass(frozen=True)
class Free:
    kind: Literal["free"] = "free"
    note: str | None = None


@dataclass(frozen=True)
class Whole:
    joints: tuple[Hinge | Free, ...]
    word: Literal["a", "b"]
    limit: float | None


@dataclass(frozen=True)
class Without:
    either: Hinge | Whole


WHOLE = Whole((Hinge((0.0, 0.0, 1.0), "slide"), Free(), Free(note="n")), "b", None)
PLAIN = {
    "joints": [{"axis": [0.0, 0.0, 1.0], "kind": "slide"}, {"kind": "free"}, {"kind": "free", "note": "n"}],
    "word": "b",
    "limit": None,
}


def test_plain_data_and_dataclasses_are_equivalent():
    assert plain(WHOLE) == PLAIN
    check_fields(PLAIN, form_of(Whole), "it")
    assert typed(Whole, PLAIN) == WHOLE


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"word": "c"}, "it.word has 'c', which is not known"),
        ({"word": 1}, "it.word is 1, should be a text"),
        ({"joints": [{"kind": "ball"}]}, "it.joints.0.kind has 'ball', which is not known"),
        ({"joints": [{}]}, "it.joints.0.kind is None, should be a text"),
        ({"joints": [[]]}, "it.joints.0 is [], should be an object"),
        ({"joints": [{"kind": "free", "axis": [0, 0, 1]}]}, "it.joints.0 lacks the fields [] and has ['axis']"),
        ({"limit": 10**400}, "should be a finite number"),
        ({"limit": True}, "it.limit is True, should be a finite number"),
    ],
)
def test_other_data_is_refused_with_its_place(change, said):
    with pytest.raises(ValueError, match=re.escape(said)):
        check_fields({**PLAIN, **change}, form_of(Whole), "it")


def test_members_of_a_union_say_their_kind():
    with pytest.raises(TypeError, match="do not all have a literal 'kind'"):
        form_of(Without)
