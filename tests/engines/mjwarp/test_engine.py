"""MuJoCo Warp: its refusals, agreement with MuJoCo on the same files, all its fields, room for contacts, and its cache of
compiled kernels."""

from __future__ import annotations

import dataclasses
import fnmatch

import numpy as np
import pytest

import simspec
from simspec.compiler import compile_world
from simspec.engines.kit.settings import check_settings
from simspec.engines.mjwarp import programs
from simspec.engines.mjwarp.engine import LACKED, MjWarp, WarpModel
from simspec.engines.mjwarp.programs import begin
from simspec.engines.mujoco import fields, inventory
from simspec.engines.mujoco.engine import MuJoCo
from simspec.errors import UnsupportedError
from simspec.proof.checks import inventory_checks
from simspec.proof.mutation_worlds import WORLDS
from simspec.testing import worlds as shipped
from simspec.testing.worlds import accepting, with_options
from tests import worlds

installed = pytest.mark.skipif(MjWarp.version() is None, reason="mujoco-warp is not installed")
SINGLE = 3e-6
"""Round-off of singles in a second's motion of 1 m in steps of 1 ms (the floor of a double pendulum is 6e-5 after 2 s)."""


def refused(world) -> str:
    with pytest.raises(UnsupportedError) as error:
        compile_world(accepting(world, "mjwarp"), ["mjwarp"])
    return str(error.value)


@pytest.mark.parametrize("kind", ["cylinder", "ellipsoid"])
def test_shapes_that_it_meets_by_searching_are_refused_by_name(kind):
    text = refused(shipped.shapes_world((kind,)))
    assert f"a {kind} may touch a box: MuJoCo Warp finds contacts of this pair by a search" in text
    assert "docs/engines/mjwarp.md" in text


def test_the_pyramid_is_refused_where_anything_has_friction():
    assert "MuJoCo Warp's solver returns NaN for pushed boxes with friction under the pyramid" in refused(
        worlds.with_cone("pyramid-inscribed")
    )


def test_massless_bodies_with_friction_are_rejected_where_the_solver_returns_nan():
    world = WORLDS["weightless"]("mjwarp")
    assert "returns NaN for massless bodies with friction, such as 'root'" in refused(world)
    smooth = tuple(dataclasses.replace(pair, friction=0.0) for pair in world.contact.pairs)
    contact = dataclasses.replace(world.contact, pairs=smooth)
    assert compile_world(accepting(dataclasses.replace(world, contact=contact), "mjwarp"), ["mjwarp"])


@pytest.mark.parametrize(
    ("torsional", "rolling", "ratio", "taken"),
    [
        (1e-4, 0.0, None, False),
        (1e-4, 0.0, 1000.0, True),
        (1e-4, 0.001, None, True),
        (0.01, 0.0, None, True),  # needs no more than an impratio of 1000
    ],
)
def test_torsional_friction_alone_is_rejected_where_landing_bodies_would_be_nan(torsional, rolling, ratio, taken):
    world = WORLDS["rolling"]("mjwarp")
    law = dataclasses.replace(world.contact.pairs[0], torsional_friction=torsional, rolling_friction=rolling)
    world = dataclasses.replace(world, contact=dataclasses.replace(world.contact, pairs=(law,)))
    world = with_options(world, "mjwarp", settings=() if ratio is None else (("high_impratio", ratio),))
    if taken:
        assert compile_world(accepting(world, "mjwarp"), ["mjwarp"])
    else:
        assert "set engines.mjwarp.settings.high_impratio to 1000" in refused(world)


def test_shapes_with_collision_functions_are_accepted():
    assert compile_world(accepting(shipped.shapes_world(("sphere", "box", "capsule")), "mjwarp"), ["mjwarp"])


def test_its_files_are_those_of_the_other_engine_that_reads_them():
    world = shipped.hinges()
    ours, theirs = (compile_world(world, [name])[name].files["model.xml"] for name in ("mjwarp", "mujoco"))
    assert ours == theirs


def test_devices_and_solvers_that_there_are_not_are_refused():
    for name, value in (("device", "cuda"), ("device", "gpu"), ("solver", "pgs"), ("solver", "cg"), ("impratio", 1e7)):
        assert check_settings(MjWarp, [(name, value)])
    assert check_settings(MjWarp, [("friction", "coulomb")])
    for name, value in (("device", "cuda:1"), ("device", "cpu"), ("solver", "newton")):
        assert check_settings(MjWarp, [(name, value)]) == []


def files_of(world, kind) -> dict:
    return dict(compile_world(world, [kind.NAME])[kind.NAME].files)


@installed
def test_the_proof_reads_every_field_of_the_model():
    """Or its own, made of those: lists by which it orders its work."""
    modules = begin([])
    file = modules.mujoco.MjModel.from_xml_string("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>")
    taken = programs.taken_over(modules, modules.warp.get_device("cpu"), file, 0)
    tables = ("NEUTRAL_ARRAYS", "COVERED", "DERIVED", "INERT", "EMPTY", "FLAG_FIELDS")
    compared = (inventory.COUNTS.table, inventory.OPTIONS.table, inventory.COMPARED)
    looked_at = [row for table in (*(getattr(fields, name) for name in tables), *compared) for row in table]
    for actual, theirs in ((taken, file), (taken.opt, file.opt)):
        names = [name for name in type(actual).__dataclass_fields__ if hasattr(theirs, name) and name != "opt"]
        assert len(names) > 20
        assert not [name for name in names if not any(fnmatch.fnmatchcase(name, row) for row in looked_at)]
    seen = WarpModel(taken, file, 0)
    assert not hasattr(taken, "jnt_user")
    assert seen.jnt_user.shape == (0, 0)
    assert seen.geom_size.tolist() == [[1.0, 0.0, 0.0]]
    assert not hasattr(seen, "geom_of_no_version")


@installed
def test_a_changed_value_is_reported(load_files):
    """Also of a law: its values are reported as MuJoCo's where these round to the stored values."""
    live = load_files(MjWarp, files_of(shipped.hinges(), MjWarp))
    seen = WarpModel(live._taken, live.model, 0)
    assert seen.opt.timestep == live.model.opt.timestep
    live._taken.opt.timestep.fill_(live.model.opt.timestep * (1.0 + 2.0**-22))
    assert seen.opt.timestep == pytest.approx(live.model.opt.timestep, rel=1e-6)
    assert seen.opt.timestep != live.model.opt.timestep
    live._taken.body_mass.fill_(2.0)
    assert set(seen.body_mass.tolist()) == {2.0}


@installed
def test_a_contradicting_file_is_found(load_files):
    world = accepting(shipped.hinges(), "mjwarp")
    files = files_of(world, MjWarp)
    for before, after, name in (
        ('impratio="1000"', 'impratio="999"', "opt.impratio"),
        ('tolerance="1e-08"', 'tolerance="1e-07"', "opt.tolerance"),
        ('nativeccd="enable"', 'nativeccd="disable"', "file.flags.disable_nativeccd"),
        ('autoreset="disable"', 'autoreset="enable"', "flags.disable_autoreset"),
    ):
        assert before in files["model.xml"]
        changed = files | {"model.xml": files["model.xml"].replace(before, after, 1)}
        found = load_files(MjWarp, changed).read_back()
        (check,) = inventory_checks(MjWarp.expected_inventory(world, found.neutral), found.inventory)
        assert name in check.detail


@installed
def test_it_moves_and_touches_as_the_other_engine_does(load_files):
    world = accepting(shipped.shapes_world(("sphere",)), "mjwarp", "mujoco")
    live = [load_files(kind, files_of(world, kind)) for kind in (MjWarp, MuJoCo)]
    for entry in live:
        entry.step(300)
    ours, theirs = (entry.body_states()[0] for entry in live)
    assert np.abs(ours - theirs).max() < SINGLE * 10
    ours, theirs = (entry.contacts() for entry in live)
    assert sorted(map(tuple, ours["body"].tolist())) == sorted(map(tuple, theirs["body"].tolist()))
    assert ours["normal_force"].sum() == pytest.approx(theirs["normal_force"].sum(), rel=1e-3)
    assert np.array_equal(live[0].detect_contacts(), live[1].detect_contacts())
    assert live[0].energy() == pytest.approx(live[1].energy(), rel=1e-4)


@installed
def test_contacts_without_room_are_never_left_out(load_files, monkeypatch):
    """There is more room, and the steps are done again: to the bits of a run that had it at once."""
    files = files_of(accepting(worlds.spheres(27), "mjwarp"), MjWarp)
    runs = []
    for room in (programs.LEAST_ROOM, 1):
        monkeypatch.setattr(programs, "LEAST_ROOM", room)
        monkeypatch.setattr(programs, "OF_EACH", programs.OF_EACH if room > 1 else 0)
        live = load_files(MjWarp, files)
        begun = live._motion._room.contacts
        for _ in range(60):
            live.step(10)
        runs.append(live.get_state()[0].tobytes())
        assert (live._motion._room.contacts > begun) == (room == 1)
        assert len(live.contacts()["body"]) > 1
    assert runs[0] == runs[1]
    monkeypatch.setattr(programs, "LARGEST_ROOM", 1)
    live = load_files(MjWarp, files)
    with pytest.raises(simspec.EngineError, match="has room for 1 contacts at most, and there are more"):
        live.step(600)


@installed
def test_a_device_that_is_not_there_is_an_error(load_files):
    options = simspec.world.types.EngineOptions("mjwarp", settings=(("device", "cuda:7"),))
    world = dataclasses.replace(shipped.hinges(), engines=(options,))
    with pytest.raises(simspec.EngineError, match="there is no device 'cuda:7' here, but"):
        load_files(MjWarp, files_of(world, MjWarp))


@installed
def test_compiled_kernels_are_kept_in_the_user_s_cache():
    modules = begin([])
    assert f"/simspec/{programs.FOLDER}" in str(modules.warp.config.kernel_cache_dir)


@installed
def test_the_same_run_gives_the_same_bits(load_files):
    files = files_of(accepting(shipped.shapes_world(("box",)), "mjwarp"), MjWarp)
    runs = []
    for chunk in (100, 1):
        live = load_files(MjWarp, files)
        for _ in range(100 // chunk):
            live.step(chunk)
        state = live.get_state()
        live.set_state(*state)
        live.body_states()
        runs.append(live.get_state()[0].tobytes())
    assert runs[0] == runs[1]


@installed
def test_flags_that_it_refuses_are_taken_from_it_alone():
    modules = begin([])
    file = modules.mujoco.MjModel.from_xml_string('<mujoco><option><flag autoreset="disable"/></option></mujoco>')
    before, lacked = int(file.opt.disableflags), int(getattr(modules.mujoco.mjtDisableBit, LACKED[0]))
    taken = programs.taken_over(modules, modules.warp.get_device("cpu"), file, lacked)
    assert int(file.opt.disableflags) == before
    assert not int(taken.opt.disableflags) & lacked
    assert WarpModel(taken, file, lacked).opt.disableflags & lacked
