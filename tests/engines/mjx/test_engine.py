"""MJX: its refusals, agreement with MuJoCo on the same files, and all its fields."""

from __future__ import annotations

import dataclasses
import fnmatch

import numpy as np
import pytest

import simspec
from simspec.compiler import compile_world
from simspec.engines.mjx import programs
from simspec.engines.mjx.engine import Mjx, MjxModel
from simspec.engines.mjx.programs import begin
from simspec.engines.mujoco import fields, inventory
from simspec.engines.mujoco.engine import MuJoCo
from simspec.errors import UnsupportedError
from simspec.outputs.files import LOCK
from simspec.proof.checks import inventory_checks
from simspec.proof.selftest_worlds import WORLDS
from simspec.testing import worlds as shipped
from simspec.testing.worlds import accepting
from tests import worlds

installed = pytest.mark.skipif(Mjx.version() is None, reason="mujoco-mjx is not installed")


def refused(world) -> str:
    with pytest.raises(UnsupportedError) as error:
        compile_world(accepting(world, "mjx"), ["mjx"])
    return str(error.value)


def test_shapes_that_it_meets_by_searching_are_refused_by_name():
    assert "a cylinder may touch a box: MJX has no collision function" in refused(shipped.shapes_world(("cylinder",)))
    assert compile_world(accepting(shipped.shapes_world(("sphere",)), "mjx"), ["mjx"])


def test_a_world_with_frictional_and_frictionless_contacts_is_rejected():
    table = {("grey", "grey"): 0.5, ("grey", "smooth"): 0.0, ("smooth", "smooth"): 0.0}
    assert "MJX has no frictionless contacts, and grey and smooth have no friction" in refused(worlds.table(table))


def test_the_pyramid_is_refused_where_anything_has_friction():
    """There a resting body overlaps by less than the distance at which MJX distinguishes corners of faces."""
    assert "faces that overlap by less than 1 µm" in refused(worlds.with_cone("pyramid-inscribed"))
    slippery = shipped.shapes_world(("sphere",), friction=0.0)
    contact = dataclasses.replace(slippery.contact, friction_cone="pyramid-inscribed")
    assert compile_world(dataclasses.replace(slippery, contact=contact), ["mjx"])


def test_too_many_contacts_are_refused():
    assert compile_world(accepting(worlds.spheres(27), "mjx"), ["mjx"])
    assert "dense matrix, here of more than 1,000,000 entries" in refused(worlds.spheres(216))


def test_its_files_are_those_of_the_other_engine_that_reads_them():
    world = shipped.hinges()
    ours, theirs = (compile_world(world, [name])[name].files["model.xml"] for name in ("mjx", "mujoco"))
    assert ours.replace('multiccd="disable"', 'multiccd="enable"') == theirs


@installed
def test_the_proof_reads_every_field_of_the_model():
    modules = begin()
    file = modules.mujoco.MjModel.from_xml_string("<mujoco/>")
    model = modules.mjx.put_model(file)
    tables = (getattr(fields, name) for name in ("NEUTRAL_ARRAYS", "COVERED", "DERIVED", "INERT", "EMPTY"))
    looked_at = [row for table in (*tables, inventory.COUNTS.table, inventory.COMPARED) for row in table]
    local = {"opt", "_impl", "_sizes"} | {
        *("dof_hasfrictionloss", "tendon_hasfrictionloss"),  # of frictionloss, which is compared
        *("wrap_inside_maxiter", "wrap_inside_tolerance", "wrap_inside_z_init", "is_wrap_inside", "geom_rbound_hfield"),
    }  # of tendons around shapes, and of height fields, of which there are none
    names = [*type(model).__dataclass_fields__, *type(model._impl).__dataclass_fields__]
    missed = [name for name in names if not any(fnmatch.fnmatchcase(name, row) for row in looked_at)]
    assert set(missed) <= local
    mjx_model = MjxModel(model, file)
    assert not hasattr(model, "jnt_user")
    assert mjx_model.jnt_user.shape == (0, 0)
    assert mjx_model.opt.noslip_iterations == 0
    assert not hasattr(mjx_model, "geom_of_no_version")


@installed
def test_a_contradicting_file_is_found(load_files):
    world = accepting(shipped.hinges(), "mjx")
    files = dict(compile_world(world, ["mjx"])["mjx"].files)
    for before, after, name in (
        ('impratio="1000"', 'impratio="999"', "opt.impratio"),
        ("<worldbody>", '<worldbody><body><joint name="other"/><geom size="1"/></body>', ""),
    ):
        assert before in files["model.xml"]
        changed = files | {"model.xml": files["model.xml"].replace(before, after, 1)}
        if not name:
            with pytest.raises(simspec.EngineError):
                load_files(Mjx, changed)
            continue
        found = load_files(Mjx, changed).read_back()
        (check,) = inventory_checks(Mjx.expected_inventory(world, found.neutral), found.inventory)
        assert not check.passed
        assert name in check.detail


@installed
def test_it_moves_and_touches_as_the_other_engine_does(load_files):
    world = accepting(shipped.shapes_world(("sphere",)), "mjx", "mujoco")
    live = [load_files(kind, dict(compile_world(world, [kind.NAME])[kind.NAME].files)) for kind in (Mjx, MuJoCo)]
    for entry in live:
        entry.step(300)
    ours, theirs = (entry.body_states()[0] for entry in live)
    assert np.abs(ours - theirs).max() < 1e-9  # with a box, which touches on its edges, 2e-5
    ours, theirs = (entry.contacts() for entry in live)
    assert sorted(map(tuple, ours["body"].tolist())) == sorted(map(tuple, theirs["body"].tolist()))
    assert ours["normal_force"].sum() == pytest.approx(theirs["normal_force"].sum(), rel=1e-9)
    assert np.array_equal(live[0].detect_contacts(), live[1].detect_contacts())
    assert live[0].energy() == pytest.approx(live[1].energy(), rel=1e-9)


@installed
def test_limits_hold_where_contact_is_switched_off(load_files):
    """MJX's elliptic cone does not support other rows of constraints without contacts."""
    world = accepting(WORLDS["model"]("mjx"), "mujoco")
    live = [load_files(kind, dict(compile_world(world, [kind.NAME])[kind.NAME].files)) for kind in (Mjx, MuJoCo)]
    for item in live:
        item.disable_contact()
        item.step(20)
    ours, theirs = (entry.body_states()[0] for entry in live)
    assert np.abs(ours - theirs).max() < 1e-9


@installed
def test_the_same_run_gives_the_same_bits(load_files):
    world = accepting(shipped.shapes_world(("box",)), "mjx")
    files = dict(compile_world(world, ["mjx"])["mjx"].files)
    runs = []
    for _ in range(2):
        live = load_files(Mjx, files)
        live.step(100)
        runs.append(live.get_state()[0].tobytes())
    assert runs[0] == runs[1]


@installed
def test_a_program_that_was_compiled_before_is_taken_up_again(load_files, tmp_path, monkeypatch):
    """To the same bits, also with other names and initial states, which programs lack; damaged programs are compiled again."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    world = accepting(shipped.hinges(), "mjx")
    bodies = [
        dataclasses.replace(body, joint=dataclasses.replace(body.joint, name="another", position=(0.3,)))
        if body is world.bodies[1]
        else body
        for body in world.bodies
    ]
    other = dataclasses.replace(world, bodies=tuple(bodies))
    runs = []
    for entry in (world, other, world, world):
        monkeypatch.setattr(programs, "_COMPILED", {})
        live = load_files(Mjx, dict(compile_world(entry, ["mjx"])["mjx"].files))
        live.step(20)
        runs.append(live.get_state()[0].tobytes())
        (program,) = (path for path in (tmp_path / "simspec" / programs.FOLDER).iterdir() if path.name != LOCK)
        if len(runs) == 3:
            program.write_bytes(program.read_bytes()[:-1])
    assert runs[0] == runs[2] == runs[3] != runs[1]
    assert len(program.read_bytes()) > 100_000
