"""MuJoCo's arena: it follows from the world where the default is too large, piles fit, and what does not fit is an error."""

from __future__ import annotations

import re

import numpy as np
import pytest

import simspec
from simspec.compiler import compile_world, write_folder
from simspec.dialects.kit.sidecar import read_sidecar
from simspec.engines.mujoco.engine import MuJoCo
from simspec.errors import EngineError
from simspec.formats.mjcf.tree import MOST_BY_DEFAULT, arena_megabytes

mujoco = pytest.importorskip("mujoco")
pytestmark = pytest.mark.usefixtures("warm_engines")

SPEC = """
simspec: 1
name: pile
physics: {{timestep: 1 ms, duration: 5 ms}}
contact:
  friction_cone: {cone}
  materials: {{plain: {{friction: {sliding}, restitution: 0}}}}
bodies:
  floor: {{fixed: true, shapes: [{{plane: {{}}, material: plain}}]}}
  thing:
    array: {{grid: {grid}, spacing: 0.1999}}
    pose: {{xyz: [0, 0, 0.0999]}}
    mass: 1 kg
    shapes: [{{{shape}, material: plain}}]
engines: {{mujoco: {{accept: {accept}, settings: {settings}}}}}
"""
BALL, BOX = "sphere: {radius: 0.1}", "box: {size: [0.2, 0.2, 0.2]}"
EDGE = MOST_BY_DEFAULT // 6


def world_of(folder, grid, shape=BALL, cone="elliptic", sliding=0.5, **settings):
    """Bodies that overlap all their neighbours by 0.1 mm."""
    given = ", ".join(f"{name}: {value}" for name, value in settings.items())
    (folder / "pile.yaml").write_text(
        SPEC.format(
            accept="[contact.friction.impact" + (", contact.cone.pyramid-inscribed]" if cone != "elliptic" else "]"),
            grid=grid,
            shape=shape,
            cone=cone,
            sliding=sliding,
            settings=f"{{{given}}}",
        )
    )
    return simspec.load(folder / "pile.yaml").resolve()


def loaded(world, folder):
    """The engine with the world's files."""
    write_folder(compile_world(world, ["mujoco"])["mujoco"].files, folder)
    engine = MuJoCo()
    engine.load(folder, read_sidecar(folder))
    return engine


def memory(world):
    found = re.search(r'<size[^>]*memory="(\d+)M"', compile_world(world, ["mujoco"])["mujoco"].files["model.xml"])
    return None if found is None else int(found[1])


def test_the_default_is_kept_up_to_a_size(tmp_path):
    assert memory(world_of(tmp_path, [EDGE, 1, 1])) is None
    more = world_of(tmp_path, [EDGE + 1, 1, 1])
    assert memory(more) == arena_megabytes(more) < 300


def test_without_newton_the_size_grows_with_the_contacts_and_the_search_alone(tmp_path):
    """MuJoCo's default for 10,000 bodies is 145 GB."""
    sizes = [arena_megabytes(world_of(tmp_path, [n, 10, 10]), newton=False) for n in (10, 100)]
    assert sizes[1] < 10.0 * sizes[0] + 400


@pytest.mark.parametrize("settings", [{}, {"solver": "cg"}, {"solver": "pgs"}, {"friction": "coulomb", "solver": "cg"}])
def test_a_pile_in_which_all_neighbours_touch_fits(tmp_path, settings):
    world = world_of(tmp_path, [8, 8, 7], **settings)
    engine = loaded(world, tmp_path / "files")
    engine.step(1)
    assert engine.model.narena == memory(world) * 2**20
    assert engine.data.ncon > 3 * 448 - 200
    assert engine.data.maxuse_arena < 0.8 * engine.model.narena
    engine.close()


def test_boxes_fit_with_all_their_points(tmp_path):
    engine = loaded(world_of(tmp_path, [8, 8, 7], BOX, "pyramid-inscribed"), tmp_path / "files")
    engine.step(1)
    assert engine.data.ncon > 4 * 3 * 448 * 0.8
    assert engine.data.maxuse_arena < engine.model.narena
    engine.close()


def test_a_given_size_is_taken(tmp_path):
    assert memory(world_of(tmp_path, [2, 1, 1], arena=77)) == 77


@pytest.mark.parametrize("arena", [1, 2])
@pytest.mark.parametrize("advance", ["step", "actuate"])
@pytest.mark.parametrize("friction", ["native", "coulomb"])
def test_an_arena_overflow_is_an_error_and_never_a_step_without_contacts(tmp_path, arena, advance, friction):
    engine = loaded(world_of(tmp_path, [20, 20, 1], friction=friction, arena=arena), tmp_path / "files")
    nothing = np.zeros(0, dtype=np.intp)
    move = (lambda: engine.step(1)) if advance == "step" else engine.actuate(nothing, nothing).step
    with pytest.raises(EngineError, match=rf"arena of {arena} MiB has no room .*settings: {{arena: {2 * arena}}}"):
        move()
    engine.close()


def test_a_run_without_room_ends_with_that_error(tmp_path):
    with pytest.raises(EngineError, match="arena of 1 MiB has no room"):
        simspec.run(world_of(tmp_path, [20, 20, 1], arena=1), "mujoco")


def test_pairs_that_were_left_out_are_no_answer(tmp_path):
    engine = loaded(world_of(tmp_path, [20, 20, 2], arena=1), tmp_path / "files")
    with pytest.raises(EngineError, match="arena of 1 MiB has no room"):
        engine.detect_units()
    engine.close()
