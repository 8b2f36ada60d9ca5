"""Kinematic bodies that carry joints: by SAP, since TAMSI does not converge there."""

from __future__ import annotations

import pytest

import simspec
from simspec.compiler import compile_world
from simspec.engines.drake.approximations import approximation
from simspec.errors import UnsupportedError
from simspec.testing.worlds import accepting, with_options

SPEC = """simspec: 1
name: carried
contact: {materials: {pad: {friction: 0.8}}}
bodies:
  floor: {fixed: true, shapes: [{plane: {}, material: pad}]}
  palm: {kinematic: true, pose: {xyz: [0, 0, 1]}, shapes: [{sphere: {radius: 0.1}, material: pad}]}
  cube: {pose: {xyz: [0, 0, 0.03]}, mass: 0.2, shapes: [{box: {size: [0.06, 0.06, 0.06]}, material: pad}]}
"""
FINGER = "  finger: {parent: palm, mass: 0.1, inertia: {principal: [1, 1, 1]}, joint: {type: hinge, axis: [1, 0, 0]}}\n"


def test_kinematic_bodies_with_joints_require_sap(tmp_path):
    for name, text, solver in (("bare", SPEC, "tamsi"), ("hand", SPEC + FINGER, "sap")):
        (tmp_path / f"{name}.yaml").write_text(text, encoding="utf-8")
        assert approximation(simspec.load(tmp_path / f"{name}.yaml").resolve()) == solver
    world = simspec.load(tmp_path / "hand.yaml").resolve()
    assert '"sap"' in "".join(compile_world(accepting(world, "drake"), ["drake"])["drake"].files.values())
    options = with_options(world, "drake", settings=(("contact_approximation", "tamsi"),))
    with pytest.raises(UnsupportedError, match="TAMSI fails to converge"):
        compile_world(options, ["drake"])
