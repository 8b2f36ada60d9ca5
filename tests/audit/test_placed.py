"""Bodies of two sides by their names."""

from __future__ import annotations

import pytest

from simspec.audit.meaning import WORLD, match, parents_first
from simspec.world.types import Body, Inertial, Joint


def body(name: str, parent: str | None = None, kind: str = "hinge") -> Body:
    return Body(name, "model", Inertial(1.0), Joint(f"{name}_joint", kind, parent))


def pairs(said: list[str], actual: list[str]) -> dict[str, str]:
    matched = match([body(name) for name in said], [body(name) for name in actual])
    return {name: partner.name for name, partner in matched.partners.items()}


def test_names_as_they_are_come_first():
    assert pairs(["a", "A"], ["A", "a"]) == {"a": "a", "A": "A"}


def test_names_that_were_cleaned():
    assert pairs(["left_hand"], ["left.hand"]) == {"left_hand": "left.hand"}


def test_names_with_the_model_before_them():
    assert pairs(["arm/hand"], ["hand"]) == {"arm/hand": "hand"}
    assert pairs(["hand"], ["arm::hand"]) == {"hand": "arm::hand"}


def test_names_that_several_have_are_not_guessed():
    assert pairs(["left/hand", "right/hand"], ["hand"]) == {}


def test_where_bodies_are_that_an_engine_does_not_have():
    said = [
        body("base", None, "free"),
        body("plate", "base", "fixed"),
        body("arm", "plate"),
        body("tip", "arm", "fixed"),
    ]
    matched = match(said, [body("arm")])
    assert matched.carrier == {"base": WORLD, "plate": WORLD, "arm": "arm", "tip": "arm"}
    assert match(said, []).carrier["arm"] is None


def test_the_only_root_of_each_side():
    assert pairs(["shelf"], ["pod_link"]) == {"shelf": "pod_link"}
    assert pairs(["shelf", "other"], ["pod_link", "more"]) == {}
    assert pairs(["shelf"], [WORLD]) == {}


def test_parents_come_first_in_any_order():
    said = [body("b", "a"), body("c", "b"), body("a")]
    assert [entry.name for entry in parents_first(said)] == ["a", "b", "c"]
    with pytest.raises(ValueError, match="without a way to the world"):
        parents_first([body("a", "b"), body("b", "a")])
