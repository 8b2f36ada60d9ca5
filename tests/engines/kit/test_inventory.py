"""Tables of inventories: one name, read from an engine and derived from a world."""

from __future__ import annotations

from types import SimpleNamespace

from simspec.engines.kit.inventory import NEUTRAL, Items, below

ITEMS = Items[SimpleNamespace, float](
    {
        "damping": (lambda joint: float(joint.d), lambda damping: damping),
        "enabled": (lambda joint: bool(joint.on), True),
        "limit": (lambda joint: None if joint.limit is None else float(joint.limit), lambda damping: None),
    }
)
NAMED = Items[SimpleNamespace, float].named(getattr, {"d": lambda damping: damping, "gap": NEUTRAL})


def test_both_sides_have_the_same_names() -> None:
    joint = SimpleNamespace(d=0.5, on=1, limit=None, gap=3)
    assert (
        ITEMS.read(joint, "joint.a")
        == ITEMS.expect(0.5, "joint.a")
        == {"joint.a.damping": 0.5, "joint.a.enabled": True}
    )
    assert NAMED.read(joint) == NAMED.expect(0.5, neutral={"gap": 3}) == {"d": 0.5, "gap": 3}


def test_a_value_missing_on_either_side_is_a_difference() -> None:
    assert ITEMS.read(SimpleNamespace(d=0.5, on=1, limit=2.0)) != ITEMS.expect(0.5)
    assert "gap" not in NAMED.expect(0.5)


def test_tables_join_and_prefixes_are_taken_away() -> None:
    assert list((ITEMS | NAMED).table) == ["damping", "enabled", "limit", "d", "gap"]
    assert below("body", {"body.a": 1, "bodyguard.b": 2}) == {"a": 1}
