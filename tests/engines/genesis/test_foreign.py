"""Genesis's description of a robot file, read without Genesis; and files in Genesis, where it has its environment."""

from __future__ import annotations

import math
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from simspec.audit import What
from simspec.audit.audit import DEADLINE, _engine_audit, loaded
from simspec.audit.meaning import meaning_of
from simspec.engines.genesis.engine import Genesis
from simspec.engines.genesis.foreign import FOREIGN, FOREIGN_ADDITIONS, GenesisDescription
from simspec.engines.kit.environments import environments
from simspec.language.foreign import ImportOptions

PYTHON = environments().get("genesis")
installed = pytest.mark.skipif(PYTHON is None, reason="genesis is not installed")

SWING = """<mujoco>
  <option gravity="0 0 -3" timestep="0.002"/>
  <worldbody>
    <geom name="floor" type="plane" size="5 5 .1"/>
    <body name="arm" pos="0 0 1">
      <joint name="swing" axis="0 1 0" stiffness="3" springref="20" damping=".1"/>
      <geom name="rod" type="capsule" size=".03 .2" mass="1" friction=".001" solref="-1000 -10"/>
      <body name="hand" pos="0 0 -.3"><joint name="turn" axis="1 0 0" armature=".01"/>
        <geom name="tip" type="sphere" size=".05" mass=".2"/></body>
    </body>
    <body name="stone" pos="1 0 1"><freejoint/>
      <inertial pos=".1 0 0" mass="1" fullinertia=".02 .03 .04 .001 0 0"/><geom name="side" type="box" size=".2 .2 .2"/></body>
  </worldbody>
  <contact><pair geom1="floor" geom2="tip"/></contact>
</mujoco>
"""


def described(**changes):
    """A link of a description, as Genesis makes it."""
    link = {
        "name": "arm",
        "parent_idx": -1,
        "pos": np.zeros(3),
        "quat": np.array([1.0, 0.0, 0.0, 0.0]),
        "offset_pos": np.zeros(3),
        "offset_quat": np.array([1.0, 0.0, 0.0, 0.0]),
        "is_aligned": False,
        "joints": [],
        "geoms": [],
        "vgeoms": [],
        "mass": 2.0,
        "inertial_pos": np.zeros(3),
        "inertial_quat": np.array([1.0, 0.0, 0.0, 0.0]),
        "inertia": np.diag([1.0, 2.0, 2.5]),
    }
    return SimpleNamespace(**link | changes)


def joint(kind="REVOLUTE", armature=0.0, count=1, **changes):
    fields = {
        "name": "swing",
        "type": SimpleNamespace(name=kind),
        "pos": np.zeros(3),
        "init_qpos": np.zeros(1),
        "sol_params": np.array([0.0, 1.0, 0.9, 0.95, 0.001, 0.5, 2.0]),
        "dofs_motion_ang": np.array([[0.0, 1.0, 0.0]]),
        "dofs_motion_vel": np.array([[1.0, 0.0, 0.0]]),
        "dofs_limit": np.array([[-math.inf, math.inf]]),
        "dofs_force_range": np.array([[-math.inf, math.inf]]),
        **{f"dofs_{name}": np.zeros(count) for name in ("damping", "frictionloss", "stiffness")},
        "dofs_armature": np.full(count, armature),
    }
    return SimpleNamespace(**fields | changes)


def geom(kind="SPHERE", data=(0.1,), friction=1.0, time=0.0):
    return SimpleNamespace(
        type=SimpleNamespace(name=kind),
        data=np.array(data),
        pos=np.zeros(3),
        quat=np.array([1.0, 0.0, 0.0, 0.0]),
        friction=friction,
        friction_torsional=0.0,
        friction_rolling=0.0,
        sol_params=np.array([time, 1.0, 0.9, 0.95, 0.001, 0.5, 2.0]),
    )


def back_of(*links, armature=0.1, **dropped):
    scene = SimpleNamespace(
        options=SimpleNamespace(
            sim=SimpleNamespace(dt=0.01, gravity=(0.0, 0.0, -9.81)),
            rigid=SimpleNamespace(
                integrator=SimpleNamespace(name="approximate_implicitfast"),
                friction_cone=SimpleNamespace(name="pyramidal"),
                constraint_timeconst=0.01,
                enable_neutral_collision=False,
            ),
        )
    )
    entity = SimpleNamespace(desc=SimpleNamespace(links=list(links)))
    return GenesisDescription(entity, SimpleNamespace(default_armature=armature)).read_back(scene, dropped)


@pytest.mark.parametrize(
    ("kinds", "stated", "found"),
    [
        (["REVOLUTE"], 0.0, [0.1]),
        (["PRISMATIC"], 0.0, [0.1]),
        (["REVOLUTE"], 0.02, [0.02]),
        (["SPHERICAL"], 0.0, [0.0]),
        (["REVOLUTE", "PRISMATIC"], 0.0, [0.0, 0.0]),
    ],
)
def test_a_hinge_or_slide_alone_has_the_armature_that_genesis_gives_it(kinds, stated, found):
    joints = [joint(kind, stated, name=f"j{place}") for place, kind in enumerate(kinds)]
    assert [body.joint.armature for body in back_of(described(joints=joints)).bodies] == found


def test_without_a_default_armature_a_joint_has_none():
    assert back_of(described(joints=[joint()]), armature=None).bodies[0].joint.armature == 0.0


def test_a_realigned_body_is_in_the_frame_of_its_file():
    turn = np.array([math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)])
    link = described(
        joints=[joint("FREE", count=6)],
        pos=np.array([1.1, 0.0, 1.0]),
        quat=turn,
        offset_pos=np.array([0.1, 0.0, 0.0]),
        offset_quat=turn,
        is_aligned=True,
        geoms=[geom("BOX", (0.4, 0.2, 0.6))],
    )
    back = back_of(link)
    (body,) = back.bodies
    assert body.joint.position == pytest.approx((1.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0), abs=1e-12)
    assert body.inertial.centre_of_mass == pytest.approx((0.1, 0.0, 0.0), abs=1e-12)
    assert body.inertial.inertia == pytest.approx((2.0, 1.0, 2.5, 0.0, 0.0, 0.0), abs=1e-12)
    assert body.shapes[0].pose.position == pytest.approx((0.1, 0.0, 0.0), abs=1e-12)
    assert back.inventory["realigned_bodies"] == 1


def test_shapes_whose_contacts_differ_are_counted():
    solids = [geom(friction=0.001), geom(friction=0.01), geom(time=-1000.0), geom("PLANE", (0.0, 0.0, 1.0))]
    found = back_of(described(joints=[joint()], geoms=solids), dropped_pairs=2).inventory
    assert (found["raised_frictions"], found["replaced_solrefs"], found["bounded_planes"]) == (1, 1, 1)
    assert found["dropped_pairs"] == 2
    assert set(found) <= set(FOREIGN_ADDITIONS)


def test_limits_are_from_where_the_file_has_zero():
    limited = joint(dofs_limit=np.array([[0.5, 2.0]]), init_qpos=np.array([0.5]))
    assert back_of(described(joints=[limited])).bodies[0].joint.position_limits == (0.0, 1.5)


def test_the_link_of_the_world_is_a_body_only_with_shapes():
    world = described(name="world", mass=None)
    arm = described(parent_idx=0, joints=[joint()])
    assert [(body.name, body.joint.parent) for body in back_of(world, arm).bodies] == [("arm", None)]
    world.geoms = [geom("PLANE", (0.0, 0.0, 1.0))]
    assert [body.name for body in back_of(world, arm).bodies] == ["world", "arm"]


# --- in Genesis -------------------------------------------------------------------------------------------------


def audited(folder: Path, text: str, language: str):
    path = folder / f"robot.{ {'urdf': 'urdf', 'mjcf': 'xml'}[language] }"
    path.write_text(text, encoding="utf-8")
    meaning = meaning_of(path, ImportOptions())
    loading = loaded("genesis", meaning, PYTHON, DEADLINE)
    return _engine_audit("genesis", FOREIGN[language], meaning, loading)


@installed
@pytest.mark.slow
def test_genesis_changes_a_file_in_these_ways(tmp_path):
    audit = audited(tmp_path, SWING, "mjcf")
    silent = {(finding.element, finding.quantity): finding for finding in audit.silent}
    assert set(silent) == {
        ("arm", "joint.armature"),
        ("arm", "joint.spring_rest"),
        *(("the file", name) for name in ("gravity", "raised_frictions", "replaced_solrefs", "bounded_planes")),
        ("the file", "dropped_pairs"),
    }
    assert silent["arm", "joint.armature"].what is What.ADDED
    assert silent["arm", "joint.armature"].engine_value == "0.1"
    assert Genesis.COMPILING > 0.0


def test_its_licence_terms_cover_the_libraries_that_torch_brings():
    covered = " ".join(terms.covers for terms in Genesis.LICENCES)
    libraries = (
        "cuBLAS cuDNN cuFFT cuFile cuSOLVER cuSPARSE cuSPARSELt CCCL CUPTI NVRTC NVSHMEM nvJitLink ptxas runtime"
    )
    assert not [name for name in ("torch", *libraries.split()) if name not in re.findall(r"\w+", covered)]
    assert "licence" not in Genesis.INSTALLS
