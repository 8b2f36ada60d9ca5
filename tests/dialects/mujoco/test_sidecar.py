"""The sidecar of a model for MuJoCo, and what an engine of this dialect must declare."""

from __future__ import annotations

import dataclasses
import json

import pytest

from simspec.compiler import target_of, write_folder
from simspec.dialects.kit.sidecar import SIDECAR, read_sidecar, sidecar_text
from simspec.dialects.mujoco.dialect import MujocoDialect
from simspec.dialects.mujoco.sidecar import MujocoSidecar
from simspec.engines.mujoco.engine import MuJoCo
from simspec.errors import EngineError, UnsupportedError
from tests import worlds
from tests.dialects.mujoco.saying import emit


def test_the_lowered_tree_equals_the_read_tree(tmp_path):
    world = worlds.gripper()
    write_folder(emit(world), tmp_path / "a")
    lowered = MujocoDialect().lower(world, target_of(world, MuJoCo)).sidecar
    assert MujocoSidecar.of(read_sidecar(tmp_path / "a")) == lowered
    assert isinstance(lowered, MujocoSidecar)
    assert lowered.explicit_pairs
    assert lowered.models == tuple(body.model for body in world.bodies)


DAMAGE = {
    "a model too few": (lambda content: content["models"].pop(), "models has"),
    "a rigid joint without a body": (lambda content: content["fixed_joints"].update(ghost="g"), "'ghost'"),
    "a rigid joint dropped": (lambda content: content["fixed_joints"].clear(), "fixed_joints"),
    "a flag as a text": (lambda content: content.update(explicit_pairs="yes"), "explicit_pairs"),
    "a field too many": (lambda content: content.update(more=1), "more"),
    "a setting dropped": (lambda content: content["settings"].pop("friction_cushion"), "settings.friction_cushion"),
    "a setting of another kind": (lambda content: content["settings"].update(iterations=1.5), "settings.iterations"),
    "a word that is none": (lambda content: content["settings"].update(solver="guess"), "newton, cg, pgs"),
    "a body twice": (lambda content: content["bodies"][1].update(content["bodies"][0]), "twice"),
}


@pytest.mark.parametrize("name", DAMAGE)
def test_damage_is_refused_by_the_reader_and_by_the_engine(name, tmp_path):
    change, message = DAMAGE[name]
    files = emit(worlds.world(worlds.tree(["fixed", "hinge"], 1)))
    content = json.loads(files[SIDECAR])
    change(content)
    write_folder({**files, SIDECAR: sidecar_text(content)}, tmp_path / "a")
    with pytest.raises(ValueError, match=message):
        MujocoDialect().read(tmp_path / "a")
    with pytest.raises(EngineError, match=message):
        MuJoCo().load(tmp_path / "a", content)


def test_an_engine_without_a_setting_of_the_dialect_gets_an_error_with_its_name():
    """A second engine of the dialect gets an error with the name of the setting, not a KeyError."""
    world = worlds.gripper()
    target = target_of(world, MuJoCo)
    settings = {name: value for name, value in target.settings.items() if name != "explicit_pairs_limit"}
    with pytest.raises(UnsupportedError, match=r"engines\.other\.settings\.explicit_pairs_limit"):
        MujocoDialect().emit(world, dataclasses.replace(target, engine="other", settings=settings))
    with pytest.raises(ValueError, match="explicit_pairs_limit"):
        MujocoDialect().check_declared(settings)
    MujocoDialect().check_declared(MuJoCo.SETTINGS)
