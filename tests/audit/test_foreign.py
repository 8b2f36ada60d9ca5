"""Tiny files that engines load as they are: each claim is measured in the live engine."""

from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path

import pytest

from simspec.audit.audit import loaded
from simspec.audit.meaning import Meaning
from simspec.engines.kit.registry import engines
from simspec.errors import EngineError
from simspec.world.types import Body, ReadBack
from tests.audit.files import PENDULUM, robot

pytestmark = pytest.mark.usefixtures("warm_engines")

READERS = [name for name, engine in engines().items() if "urdf" in engine.FOREIGN and engine.version() is not None]


def loaded_model(engine: str, folder: Path, text: str, language: str = "urdf") -> ReadBack:
    path = folder / f"robot.{ {'urdf': 'urdf', 'mjcf': 'xml'}[language] }"
    path.write_text(text, encoding="utf-8")
    loading = loaded(engine, Meaning(path, language), None, 60.0)
    if loading.error is not None:
        raise loading.error
    assert loading.read_back is not None
    return loading.read_back


def body(back: ReadBack, name: str) -> Body:
    return next(entry for entry in back.bodies if entry.name == name)


@pytest.mark.parametrize("engine", READERS)
def test_plain_values_are_in_every_engine(engine, tmp_path):
    arm = body(loaded_model(engine, tmp_path, robot()), "arm")
    assert arm.inertial.mass == 1.0
    assert arm.inertial.centre_of_mass == pytest.approx((0.1, 0.0, 0.0), abs=1e-7)
    assert arm.joint.kind == "hinge"
    assert arm.joint.axis == pytest.approx((0.0, 1.0, 0.0), abs=1e-7)
    assert arm.joint.position_limits == pytest.approx((-1.0, 2.0))
    assert arm.joint.damping == pytest.approx(0.5)
    shapes = [shape for shape in arm.shapes if shape.collision]
    assert len(shapes) == 1


@pytest.mark.parametrize("engine", READERS)
def test_the_turn_of_an_inertia(engine, tmp_path):
    """The file's tensor is turned by the inertial's rpy: only an engine that computes its own has none of it."""
    inertia = body(loaded_model(engine, tmp_path, robot()), "arm").inertial.inertia
    if engine == "pybullet":
        assert abs(inertia[3]) < 1e-9
        assert inertia[0] != pytest.approx(0.0241501643, rel=1e-3)
    else:
        assert inertia[0] == pytest.approx(0.0241501643, rel=1e-6)
        assert inertia[3] == pytest.approx(-0.0049272486, rel=1e-6)


def test_a_link_without_inertial(tmp_path):
    """Its mass is zero by the language; loaders take 1 kg, or its shapes as full of water."""
    masses = {engine: body(loaded_model(engine, tmp_path, robot(hand="")), "hand").inertial.mass for engine in READERS}
    ball = 1000.0 * 4.0 / 3.0 * math.pi * 0.1**3
    expected = {"mujoco": pytest.approx(ball), "pybullet": 1.0, "dart": 1.0, "drake": 0.0}
    assert masses == {name: expected[name] for name in READERS}


def test_fixed_links_and_visuals_are_dropped(tmp_path):
    back = loaded_model("mujoco", tmp_path, robot())
    assert [entry.name for entry in back.bodies] == ["world", "arm", "hand"]
    assert not any(shape.visual and not shape.collision for entry in back.bodies for shape in entry.shapes)
    assert body(back, "arm").joint.velocity_limit is None


@pytest.mark.parametrize("engine", READERS)
def test_limits_that_are_both_zero(engine, tmp_path):
    limits = body(loaded_model(engine, tmp_path, robot(lower=0.0, upper=0.0)), "hand").joint.position_limits
    assert limits == {"mujoco": None, "dart": (0.0, 0.0), "drake": (0.0, 0.0)}.get(engine, limits)


def test_additions_to_every_file(tmp_path):
    inventory = loaded_model("pybullet", tmp_path, robot()).inventory
    assert inventory["linear_damping"] == pytest.approx(0.04, abs=2e-3)
    assert inventory["joints_held_by_motors"] == 2
    assert inventory["gravity_set"] is False
    assert inventory["self_collision"] is False
    assert inventory["collision_margin"] == pytest.approx(0.001)


def test_links_of_a_body_do_not_touch_without_a_flag(tmp_path):
    """Self-collision in the read-back, from the flags alone, seen in contacts."""
    import pybullet

    path = tmp_path / "robot.urdf"
    path.write_text(robot(), encoding="utf-8")
    touching = {}
    for flags in (0, pybullet.URDF_USE_SELF_COLLISION):
        client = pybullet.connect(pybullet.DIRECT)
        try:
            uid = pybullet.loadURDF(str(path), flags=flags, physicsClientId=client)
            pybullet.resetJointState(uid, 1, 1.5, physicsClientId=client)
            pybullet.stepSimulation(physicsClientId=client)
            touching[flags] = len(pybullet.getContactPoints(uid, uid, physicsClientId=client))
        finally:
            pybullet.disconnect(physicsClientId=client)
    assert touching[0] == 0
    assert touching[pybullet.URDF_USE_SELF_COLLISION] > 0


def test_limits_and_self_collision_are_off(tmp_path):
    inventory = loaded_model("dart", tmp_path, robot()).inventory
    assert inventory["limits_enforced"] is False
    assert inventory["self_collision"] is False


def test_degrees_are_taken_for_radians(tmp_path):
    """A file whose angles are degrees (its language's default), in the loaders that read the language."""
    limits = {}
    for engine in ("mujoco", "dart", "drake"):
        back = loaded_model(engine, tmp_path, PENDULUM, "mjcf")
        joints = {entry.joint.name: entry.joint for entry in back.bodies}
        limits[engine] = joints["swing"].position_limits if "swing" in joints else None
    assert limits["mujoco"] == pytest.approx((-1.5707963, 0.78539816))
    assert limits["drake"] == pytest.approx((-1.5707963, 0.78539816))
    assert limits["dart"] != pytest.approx((-1.5707963, 0.78539816))


def test_several_joints_of_a_body_are_a_chain(tmp_path):
    back = loaded_model("mujoco", tmp_path, PENDULUM, "mjcf")
    assert [(entry.name, entry.joint.kind, entry.joint.parent) for entry in back.bodies] == [
        ("world", "fixed", None),
        ("upper/swing", "hinge", None),
        ("upper", "slide", "upper/swing"),
        ("lower", "hinge", "upper"),
    ]
    upper = body(back, "upper/swing")
    assert upper.joint.origin.position == pytest.approx((0.0, 0.0, 1.2))
    assert upper.inertial.mass == 0.0
    assert body(back, "lower").joint.origin.position == pytest.approx((0.0, 0.0, -0.4))


HUNGRY = """
from pathlib import Path
from simspec.engines.kit import foreign
class Engine:
    FOREIGN_MEMORY = BEFORE
    def prepare_foreign(self):
        pass
    def load_foreign(self, *_):
        return bytearray(3 * 2**30)
try:
    foreign.ForeignSession(Engine).load_foreign(Path("a"), "urdf", {})
    print("taken")
except MemoryError:
    print("refused")
"""


@pytest.mark.skipif(sys.platform != "linux", reason="a bound that Linux has")
@pytest.mark.parametrize(("before", "answer"), [(0, "refused"), (2**30, "refused"), (5 * 2**29, "taken")])
def test_a_file_gets_so_much_memory_and_no_more(before, answer):
    """Two GiB, or one more than an engine holds; the file needs three."""
    text = HUNGRY.replace("BEFORE", str(before))
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=True)
    assert done.stdout == f"{answer}\n"


def test_a_refused_file_and_a_fatal_file(tmp_path):
    with pytest.raises(EngineError, match="refuses the file") as refused:
        loaded_model("mujoco", tmp_path, robot().replace('type="fixed"', 'type="unheard-of"'))
    assert refused.value.refused
