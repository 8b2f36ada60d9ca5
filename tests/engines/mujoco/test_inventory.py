"""Everything that MuJoCo holds is compared: no field is left out, worlds of every kind are as expected, changes are noticed."""

from __future__ import annotations

import dataclasses
import fnmatch
import re

import numpy as np
import pytest

from simspec.compiler import compile_world, write_folder
from simspec.dialects.kit.sidecar import read_sidecar
from simspec.engines.kit.registry import find_engine
from simspec.engines.mujoco import fields, inventory
from simspec.engines.mujoco.engine import MuJoCo
from simspec.proof.checks import inventory_checks
from simspec.proof.selftest_worlds import WORLDS, model
from simspec.world.types import EngineOptions, Hardness, Shape

mujoco = pytest.importorskip("mujoco")

TABLES = {
    **{name: getattr(fields, name) for name in ("NEUTRAL_ARRAYS", "COVERED", "DERIVED", "INERT", "EMPTY")},
    **{"COUNTS": inventory.COUNTS.table, "COMPARED": inventory.COMPARED, "OPTION": ("opt",)},
}


def fields_of(value):
    return [name for name in dir(value) if not name.startswith("_") and not callable(getattr(value, name))]


def test_the_tables_partition_the_fields_of_the_model():
    empty = mujoco.MjModel.from_xml_string("<mujoco/>")
    for name in fields_of(empty):
        found = [table for table, rows in TABLES.items() if any(fnmatch.fnmatchcase(name, row) for row in rows)]
        assert len(found) == 1, f"{name}: {found}"
    assert set(fields_of(empty.opt)) == {*inventory.OPTIONS.table, *fields.FLAG_FIELDS}


def test_the_tables_name_no_field_that_is_not_there():
    names = fields_of(mujoco.MjModel.from_xml_string("<mujoco/>"))
    for table, rows in TABLES.items():
        assert [row for row in rows if not fnmatch.filter(names, row)] == [], table


def edited_check(world, folder, edit=lambda text: text):
    """The check of the inventory of ``world``, with its model.xml edited."""
    write_folder(compile_world(world, ["mujoco"])["mujoco"].files, folder)
    path = folder / "model.xml"
    path.write_text(edit(path.read_text()))
    engine = MuJoCo()
    engine.load(folder, read_sidecar(folder))
    try:
        found = engine.read_back()
    finally:
        engine.close()
    (check,) = inventory_checks(find_engine("mujoco").expected_inventory(world, found.neutral), found.inventory)
    return check


def with_hardness(name, hardness):
    world = WORLDS[name]("mujoco")
    pairs = tuple(dataclasses.replace(pair, hardness=hardness, restitution=0.0) for pair in world.contact.pairs)
    accepted = ("contact.friction.impact", "contact.hardness.native", "contact.hardness.time-constant")
    accept = EngineOptions("mujoco", accept=accepted)
    return dataclasses.replace(world, contact=dataclasses.replace(world.contact, pairs=pairs), engines=(accept,))


def with_settings(**settings):
    (options,) = model("mujoco").engines
    options = dataclasses.replace(options, settings=tuple(sorted(settings.items())))
    return dataclasses.replace(model("mujoco"), engines=(options,))


def with_many_groups():
    """More classes of shapes than masks have bits, so that bodies are excluded pair by pair."""
    world = model("mujoco")
    names = [f"group_{number:02}" for number in range(34)]
    cube = next(body for body in world.bodies if body.name == "cube")
    bodies = tuple(
        dataclasses.replace(
            cube,
            name=name,
            model=name,
            collision_group=name,
            joint=dataclasses.replace(cube.joint, name=f"{name}_joint"),
            shapes=(dataclasses.replace(cube.shapes[0], name=f"{name}_0"),),
        )
        for name in names
    )
    ignored = tuple(sorted((names[i], names[i + 1]) for i in range(33)))
    contact = dataclasses.replace(world.contact, ignored_groups=ignored, excluded_bodies=())
    return dataclasses.replace(world, bodies=bodies, contact=contact)


def with_a_visual_only_shape():
    world = model("mujoco")
    seen = Shape("cube_eye", "sphere", (0.2,), collision=False)
    bodies = tuple(
        dataclasses.replace(body, shapes=(dataclasses.replace(body.shapes[0], visual=False), seen))
        if body.name == "cube"
        else body
        for body in world.bodies
    )
    return dataclasses.replace(world, bodies=bodies)


KINDS = {
    **{name: (lambda name=name: WORLDS[name]("mujoco")) for name in WORLDS},
    "native hardness": lambda: with_hardness("bouncing", Hardness("native")),
    "time constant": lambda: with_hardness("bouncing", Hardness("time-constant", 0.02, 0.9)),
    "stiffness": lambda: with_hardness("bouncing", Hardness("stiffness", stiffness=5e3, damping=10.0)),
    "settings": lambda: with_settings(
        solver="cg",
        iterations=7,
        tolerance=1e-6,
        warmstart=False,
        multiccd=False,
        island=True,
        impratio=20.0,
        friction_cushion=0.0,
        friction_rate=50.0,
        contact_impedance=0.99,
        limit_impedance=0.98,
        noslip_iterations=3,
    ),
    "sleeping": lambda: with_settings(sleeping=True, sleep_tolerance=1e-4),
    "no explicit pairs": lambda: with_settings(explicit_pairs_limit=0),
    "many groups": with_many_groups,
    "a visual-only shape": with_a_visual_only_shape,
}


@pytest.mark.parametrize("name", KINDS)
def test_a_world_is_stored_as_expected(name, tmp_path):
    check = edited_check(KINDS[name](), tmp_path / "files")
    assert check.passed, check.detail
    assert check.count > 150


CHANGES = {
    "opt.iterations": ('iterations="100"', 'iterations="99"'),
    "opt.impratio": ('impratio="1000"', 'impratio="1000.01"'),
    "flags.disable_warmstart": ('warmstart="enable"', 'warmstart="disable"'),
    "flags.disable_actuation": ('actuation="enable"', 'actuation="disable"'),
    "opt.disableactuator": ("<option ", '<option actuatorgroupdisable="3" '),
    "count.neq": ("</worldbody>", '</worldbody><equality><weld body1="ball" body2="cube"/></equality>'),
    "count.ntendon": (
        "</worldbody>",
        '</worldbody><tendon><fixed><joint joint="upper_joint" coef="1"/></fixed></tendon>',
    ),
    "count.nu": ("</worldbody>", '</worldbody><actuator><position joint="upper_joint" kp="3"/></actuator>'),
    "count.ngravcomp": ('<body name="cube"', '<body gravcomp="1" name="cube"'),
    "geom.cube_0.gap": ('<geom name="cube_0"', '<geom gap="0.01" name="cube_0"'),
    "geom.cube_0.priority": ('<geom name="cube_0"', '<geom priority="2" name="cube_0"'),
    "geom.cube_0.fluid": ('<geom name="cube_0"', '<geom fluidshape="ellipsoid" name="cube_0"'),
    "masks.quiet_0.touches": ('contype="4" conaffinity="5"', 'contype="4" conaffinity="7"'),
    "jnt.upper_joint.solref": ('<joint name="upper_joint"', '<joint solreflimit="-10001 -1000" name="upper_joint"'),
    "dof.cube_joint.damping": ('<joint name="cube_joint"', '<joint damping="0.01" name="cube_joint"'),
    "jnt.upper_joint.actfrclimited": (
        '<joint name="upper_joint"',
        '<joint actuatorfrclimited="true" actuatorfrcrange="-1 1" name="upper_joint"',
    ),
    "exclude.cube,quiet": ("</contact>", '<exclude body1="quiet" body2="cube"/></contact>'),
    "body.floor.mass": (
        '<geom name="floor_0"',
        '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/><geom name="floor_0"',
    ),
    "tree.cube.sleep": ('<body name="cube"', '<body sleep="never" name="cube"'),
    "stat.meaninertia": ("<default>", '<statistic meaninertia="5"/><default>'),
    "key.initial.time": ('<key name="initial"', '<key time="1" name="initial"'),
}


@pytest.mark.parametrize("name", CHANGES)
def test_changed_values_are_found_by_name(name, tmp_path):
    before, after = CHANGES[name]

    def edit(text):
        assert before in text
        return text.replace(before, after, 1)

    world = model("mujoco")
    write_folder(compile_world(world, ["mujoco"])["mujoco"].files, tmp_path / "files")
    (tmp_path / "files" / "model.xml").write_text(edit((tmp_path / "files" / "model.xml").read_text()))
    engine = MuJoCo()
    engine.load(tmp_path / "files", read_sidecar(tmp_path / "files"))
    try:
        found = engine.read_back()
    finally:
        engine.close()
    expected = find_engine("mujoco").expected_inventory(world, found.neutral)
    unlike = {key for key in expected.keys() | found.inventory.keys() if expected.get(key) != found.inventory.get(key)}
    assert name in {key for key in unlike if not _same(expected.get(key), found.inventory.get(key))}


def _same(entry, other):
    try:
        return np.allclose(np.asarray(entry, float), np.asarray(other, float), rtol=1e-9, atol=0.0)
    except (TypeError, ValueError):
        return entry == other


def test_settings_are_the_worlds_not_the_sidecars(tmp_path):
    """A sidecar that agrees only with its model.xml."""
    world = model("mujoco")
    folder = tmp_path / "files"
    write_folder(compile_world(with_settings(iterations=50), ["mujoco"])["mujoco"].files, folder)
    side = folder / "sidecar.json"
    side.write_text(side.read_text().replace(re.search(r'"world": "(\w+)"', side.read_text())[1], "0" * 64))
    engine = MuJoCo()
    engine.load(folder, read_sidecar(folder))
    try:
        found = engine.read_back()
    finally:
        engine.close()
    expected = find_engine("mujoco").expected_inventory(world, found.neutral)
    unlike = {key for key in expected if not _same(expected[key], found.inventory[key])}
    assert unlike == {"opt.iterations", "sidecar.settings.iterations", "sidecar.world"}
