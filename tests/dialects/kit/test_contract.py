"""The base class of dialects: it requires the settings of a target and a sidecar of the declared type."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import pytest

from simspec.contact import Rules, contact_plan
from simspec.dialects.kit.contract import Dialect, Lowered, NeededSetting
from simspec.dialects.kit.sidecar import SIDECAR, Sidecar, Target, common_fields
from simspec.errors import UnsupportedError
from simspec.formats.kit.contract import Format
from simspec.support.declarations import EXACT
from simspec.support.features import Feature
from tests import worlds

RULES = Rules("max", "max", "max", "max", "same")


class Lines(Format):
    NAME = "lines"

    def write(self, tree: Any) -> dict[str, str]:
        return {"lines.txt": "\n".join(tree)}

    def read(self, folder: Any) -> Any:
        return (folder / "lines.txt").read_text().splitlines()


@dataclass(frozen=True, slots=True, kw_only=True)
class LinesSidecar(Sidecar):
    count: int


class LinesDialect(Dialect):
    NAME: ClassVar[str] = "lines"
    FORMAT: ClassVar[str] = "lines"
    SUPPORT = dict.fromkeys(Feature, EXACT)
    SIDECAR = LinesSidecar
    SETTINGS: ClassVar[dict] = {
        "depth": NeededSetting(int),
        "share": NeededSetting(float),
        "way": NeededSetting(str, ("up", "down")),
        "asleep": NeededSetting(bool, optional=True),
    }
    format = Lines()

    def lower(self, world, target):
        names = tuple(body.name for body in world.bodies)
        return Lowered(
            names, LinesSidecar(**common_fields(self.NAME, self.FORMAT, world, target, {}), count=len(names))
        )

    def raise_(self, document, sidecar):
        return document, sidecar


def target(**settings: Any) -> Target:
    world = worlds.gripper()
    return Target("toy", RULES, contact_plan(world, RULES, False), settings)


def test_a_sidecar_goes_into_its_file_and_comes_back_typed(tmp_path):
    world = worlds.gripper()
    files = LinesDialect().emit(world, target(depth=3, share=1, way="up"))
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    document, sidecar = LinesDialect().read(tmp_path)
    assert sidecar == LinesDialect().lower(world, target(depth=3, share=1, way="up")).sidecar
    assert document == [body.name for body in world.bodies]


def test_a_damaged_sidecar_is_refused_before_it_is_raised(tmp_path):
    files = LinesDialect().emit(worlds.gripper(), target(depth=3, share=1, way="up"))
    for name, text in files.items():
        (tmp_path / name).write_text(text.replace('"count"', '"counts"') if name == SIDECAR else text)
    with pytest.raises(ValueError, match=r"sidecar lacks the fields \['count'\]"):
        LinesDialect().read(tmp_path)


def test_settings_that_a_target_lacks_are_named_all_at_once():
    with pytest.raises(UnsupportedError) as refused:
        LinesDialect().emit(worlds.gripper(), target(share=0.5))
    message = str(refused.value)
    for word in ("engines.toy.settings.depth", "engines.toy.settings.way", "up, down"):
        assert word in message
    for word in ("asleep", "settings.share"):
        assert word not in message


def test_an_engine_declares_the_requirements_of_its_dialect():
    LinesDialect().check_declared({"depth", "share", "way", "other"})
    with pytest.raises(ValueError, match="lacks the settings depth, way, which the dialect 'lines' needs"):
        LinesDialect().check_declared({"share"})


@pytest.mark.parametrize(
    "wrong",
    [
        {"depth": 3.5},
        {"depth": True},
        {"share": "much"},
        {"share": float("nan")},
        {"way": "left"},
        {"asleep": 1},
    ],
)
def test_settings_of_another_kind_are_refused(wrong):
    (name,) = wrong
    with pytest.raises(UnsupportedError, match=rf"engines\.toy\.settings\.{name}"):
        LinesDialect().emit(worlds.gripper(), target(**{"depth": 3, "share": 0.5, "way": "up"} | wrong))
