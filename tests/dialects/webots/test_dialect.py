"""A world written for Webots and read again: nothing is lost, and any change in the files is found."""

from __future__ import annotations

import dataclasses
import math
import random
import re

import pytest

from simspec.compiler import compile_world
from simspec.dialects.kit.contract import dialects
from simspec.dialects.kit.defects import NAMES
from simspec.dialects.kit.mutating import mutations
from simspec.dialects.kit.sidecar import SIDECAR
from simspec.dialects.webots.defects import DEFECTS, TABLE
from simspec.engines.webots.engine import Webots
from simspec.errors import UnsupportedError
from simspec.formats.kit.text import number
from simspec.formats.wbt.format import WORLD
from simspec.proof.comparator import compare
from simspec.testing import worlds as shipped
from simspec.testing.worlds import accepting
from simspec.world.types import Body, Inertial, Joint, Pose, Shape
from tests import worlds
from tests.dialects.webots.worlds import bare, every

EVERY = every()


def compiled(world):
    return dict(compile_world(world, ["webots"])["webots"].files)


def failures(world, files, folder):
    """The failures of the independent reader, and of the comparison with the world; [] for files of the world."""
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")
    try:
        model = dialects()["webots"].read(folder)
    except (ValueError, LookupError) as error:
        return [str(error)]
    checks = compare(world, model, Webots.RULES, Webots.LAYERS, text=True)
    assert len(checks) > 5
    return [f"{check.name}, {check.where}: {check.detail or check.worst}" for check in checks if not check.passed]


@pytest.mark.parametrize("name", EVERY)
def test_lower_and_raise_are_inverse(name, tmp_path):
    assert failures(EVERY[name], compiled(EVERY[name]), tmp_path) == []


@pytest.mark.parametrize("seed", range(6))
def test_random_trees_come_back(seed, tmp_path):
    chance = random.Random(seed)
    kinds = ["free", *(chance.choice(("fixed", "hinge", "slide", "ball")) for _ in range(7))]
    if seed % 2:
        kinds[0] = "fixed"
    gravity = tuple(chance.uniform(-10.0, 10.0) for _ in range(3))
    world = shipped.world(shipped.tree(kinds, seed), "random")
    world = dataclasses.replace(world, physics=dataclasses.replace(world.physics, gravity=gravity))
    assert failures(bare(world), compiled(bare(world)), tmp_path) == []


def test_every_kind_of_joint_comes_back(tmp_path):
    world = bare(worlds.every_joint())
    assert failures(world, compiled(world), tmp_path) == []


@pytest.mark.parametrize("defect", [name for name, plant in DEFECTS.items() if not isinstance(plant, str)])
def test_every_planted_defect_is_seen_in_the_files(defect, tmp_path):
    world = EVERY[NAMES[defect]]
    assert failures(world, DEFECTS[defect](compiled(world)), tmp_path)


def test_every_defect_is_planted_or_says_why_not():
    assert DEFECTS.keys() == NAMES.keys()
    assert {name for name in NAMES if NAMES[name] in EVERY} >= {
        name for name, plant in DEFECTS.items() if not isinstance(plant, str)
    }


SHARE = {"model": 23}
"""Of every so many changes one: all 9,600 of the eleven worlds take half a minute, and none of them is missed."""
ROUND_OFF = 1e-15
"""Lengths and shares below which a number may be any other."""


@pytest.mark.parametrize("name", ["model", "ball joint", "lifted", "rolling", "sums"])
def test_changes_of_the_files_are_seen(name, tmp_path):
    world = EVERY[name]
    files = compiled(world)
    changes = list(mutations(files, TABLE))
    assert {change.file for change in changes} == {WORLD, SIDECAR}
    share = SHARE.get(name, 15)
    tried = [change for change in changes[share // 2 :: share] if TABLE.inertness(change) is None and not tiny(change)]
    missed = [change.name for change in tried if not failures(world, {**files, change.file: change.text}, tmp_path)]
    assert missed == []
    assert len(tried) > 20


def tiny(change):
    """Whether a change is of a number that is nothing but round-off."""
    number = re.search(r"\[\d+\] (\S+) to ", change.change)
    return number is not None and change.kind in ("scaled", "sign") and 0.0 < abs(float(number[1])) < ROUND_OFF


# --- what is this dialect's own ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "gravity", [(0.0, 0.0, -9.81), (0.0, 0.0, 0.0), (0.0, 0.0, 3.0), (9.81, 0.0, 0.0), (1.0, 2.0, 3.0)]
)
def test_gravity_has_any_direction_by_a_pose_around_all_solids(gravity, tmp_path):
    world = bare(worlds.every_joint())
    world = dataclasses.replace(world, physics=dataclasses.replace(world.physics, gravity=gravity))
    files = compiled(world)
    assert failures(world, files, tmp_path) == []
    assert ("DEF turned Pose" in files[WORLD]) is any((gravity[0], gravity[1], gravity[2] > 0.0))
    assert f"  gravity {number(math.sqrt(sum(x * x for x in gravity)))}\n" in files[WORLD]


@pytest.mark.parametrize(
    ("limits", "written"),
    [
        ((-1.0, 2.0), True),
        ((-math.pi, math.pi), True),
        ((-6.28, 6.28), False),
        ((0.1, 1.0), False),
        ((0.0, 0.0), False),
    ],
)
def test_stops_that_webots_does_not_have_stay_in_the_sidecar(limits, written, tmp_path):
    world = bare(shipped.jointed("hinge", position_limits=limits, position=(limits[1],)))
    files = compiled(world)
    assert failures(world, files, tmp_path) == []
    stop = number(limits[1]) if written else "0"
    assert f"maxStop {stop}\n" in files[WORLD]
    assert ('"untold_limits": []' in files[SIDECAR]) is written


@pytest.mark.parametrize("timestep", [0.0005, 0.0015, 1e-6])
def test_steps_that_no_controller_can_make_are_refused(timestep):
    world = EVERY["bouncing"]
    world = dataclasses.replace(world, physics=dataclasses.replace(world.physics, timestep=timestep))
    with pytest.raises(UnsupportedError, match="step whole milliseconds"):
        compile_world(world, ["webots"])


def test_a_chain_is_nested_as_deep_as_it_is_long(tmp_path):
    world = bare(shipped.world(shipped.tree(["free", *["hinge"] * 120], 3), "chain"))
    assert failures(world, compiled(world), tmp_path) == []


@pytest.mark.parametrize("solid", [False, True])
def test_a_solid_without_mass_has_no_contacts_in_webots(solid, tmp_path):
    base = EVERY["bouncing"]
    pad = Shape("pad", "box", (0.1, 0.1, 0.1), material="rubber", collision=solid)
    fixed = Body("pad", "ball", Inertial(0.0), Joint("pad_joint", "fixed", "ball", Pose((0.0, 0.0, -0.2))), (pad,))
    world = dataclasses.replace(base, bodies=(*base.bodies, fixed))
    if solid:
        with pytest.raises(UnsupportedError, match="ignores contacts of a Solid without mass, and 'pad' has none"):
            accepting(world, "webots")
    else:
        assert failures(accepting(world, "webots"), compiled(accepting(world, "webots")), tmp_path) == []


@pytest.mark.parametrize("size", ["0", "-0.5"])
def test_sizes_of_shapes_that_are_not_above_zero_are_refused(size, tmp_path):
    world = bare(worlds.shapes_world(("sphere",)))
    files = compiled(world)
    changed, count = re.subn(r"radius [0-9.e-]+", f"radius {size}", files[WORLD], count=1)
    assert count == 1
    (failure,) = failures(world, {**files, WORLD: changed}, tmp_path)
    assert "should have sizes above zero" in failure
