"""The scenes that discriminate: each comes out as its oracle says in every engine, and otherwise under a wrong law."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import simspec
from simspec.errors import UnsupportedError
from simspec.language.formatting import format_text
from simspec.language.load import load_study_file
from simspec.runner.expectations import evaluate
from simspec.support.features import Feature
from simspec.world.canonical import sha256
from tests.declared import with_the_cone

pytestmark = pytest.mark.usefixtures("warm_engines")

ENGINES = with_the_cone(Feature.RESTITUTION)

SPECS = Path(__file__).resolve().parents[2] / "specs"
SCENES = SPECS / "contact"
STUDY = SPECS / "studies" / "contact.yaml"
QUICK = (
    "bouncing-row",
    "card-house",
    "newtons-cradle",
    "oblique-impact",
    "ramp-grid",
    "rolling-ramp",
    "six-materials",
    "slide-24",
    "spinning-disc",
    "tripod",
)
TOWERS = ("tower-boxes", "tower-cylinders")
OF_VERSIONS = ("box-on-box",)
"""The world that compares releases of an engine (tests/commands/test_bisect.py), with its native contact."""
GRAVITY = 9.81

REFUSED = {
    ("newtons-cradle", "rapier"): "joint.fixed",
    ("newtons-cradle", "physx"): "joint.fixed",
    ("spinning-disc", "physx"): "shape.cylinder",
    ("tower-cylinders", "physx"): "shape.cylinder",
}
"""Scenes that an engine does not support, each with the feature."""
MISSES = {("tripod", "rapier"): 1, ("tripod", "physx"): 1, ("card-house", "physx"): 2}
"""Number of expectations of a scene that an engine misses, as it declares: bodies that spin fast while sliding are braked too
strongly, and cards slide on their edges in PhysX."""

WRONG = {
    "slide-24, a circumscribed pyramid": (
        "slide-24",
        "dart",
        ("contact.friction_cone=pyramid-circumscribed", "engines.dart.accept=[contact.cone.pyramid-circumscribed]"),
    ),
    "slide-24, an inscribed pyramid": (
        "slide-24",
        "mujoco",
        (
            "contact.friction_cone=pyramid-inscribed",
            "engines.mujoco.accept=[contact.cone.pyramid-inscribed, contact.friction.impact]",
        ),
    ),
    "tripod, a circumscribed pyramid": ("tripod", "pybullet", ("contact.friction_cone=pyramid-circumscribed",)),
    "tripod, an inscribed pyramid": (
        "tripod",
        "mujoco",
        (
            "contact.friction_cone=pyramid-inscribed",
            "engines.mujoco.accept=[contact.cone.pyramid-inscribed, contact.friction.impact, contact.friction.self-locking]",
        ),
    ),
    "ramp-grid, one pair": ("ramp-grid", "pybullet", ("contact.pairs.1.friction=0.5",)),
    "ramp-grid, the one that creeps": ("ramp-grid", "mujoco", ("contact.pairs.4.friction=0.475",)),
    "ramp-grid, the one that stays": ("ramp-grid", "dart", ("contact.pairs.5.friction=0.457",)),
    "rolling-ramp, both balls alike": ("rolling-ramp", "mujoco", ("contact.materials.slick.friction=0.5",)),
    "bouncing-row, one restitution": ("bouncing-row", "dart", ("contact.materials.fair.restitution=0.3",)),
    "newtons-cradle, less lively": ("newtons-cradle", "pybullet", ("contact.materials.steel.restitution=0.8",)),
    "oblique-impact, friction missing in impacts": (
        "oblique-impact",
        "mujoco",
        (
            "engines.mujoco.settings.friction=native",
            "engines.mujoco.accept=[contact.friction.impact, material.restitution]",
        ),
    ),
    "oblique-impact, less friction": ("oblique-impact", "pybullet", ("contact.materials.slick.friction=0.045",)),
    "card-house, above the limit": ("card-house", "mujoco", ("contact.materials.slick.friction=0.3",)),
    "card-house, below the limit": ("card-house", "dart", ("contact.materials.rough.friction=0.2",)),
    "spinning-disc, less friction": ("spinning-disc", "mujoco", ("contact.materials.floor.friction=0.2",)),
    "six-materials, combined": ("six-materials", "dart", ("contact.pairs=[]",)),
    "six-materials, one value 2 % off in layers": ("six-materials", "pybullet", ("contact.pairs.4.friction=0.755",)),
    "six-materials, one value 2 % off in pairs": ("six-materials", "mujoco", ("contact.pairs.12.friction=0.143",)),
}
"""Effects of a wrong law on a scene: the scene, an engine, and the changed settings."""


def outcomes(name: str, engine: str, sets: tuple[str, ...] = ()):
    world = simspec.load(SCENES / f"{name}.yaml", sets=list(sets)).resolve()
    return evaluate(simspec.run(world, engine))


def test_every_scene_is_tried():
    scenes = {path.stem for path in SCENES.glob("*.yaml")}
    laws = {
        sweep.spec.path.stem for sweep in load_study_file(STUDY).sweeps(small=False) if "contact" in sweep.words.show
    }
    assert {*QUICK, *TOWERS, *OF_VERSIONS, *laws} == scenes
    assert not laws & {*QUICK, *TOWERS}  # these are there to be proven, and move nothing


@pytest.mark.parametrize("name", [*QUICK, *TOWERS])
def test_a_scene_is_as_the_library_wants_it(name):
    path = SCENES / f"{name}.yaml"
    text = path.read_text(encoding="utf-8")
    spec = simspec.load(path)
    world = spec.resolve()
    assert world.name == name
    assert world.expectations
    assert spec.data.description
    assert text.splitlines()[1].startswith("# ")  # the physics, above all else
    assert format_text(text, path.name) == text
    assert sha256(world) == sha256(simspec.load(path).resolve())


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("name", QUICK)
def test_a_scene_comes_out_as_its_oracle_says(name, engine):
    if (name, engine) in REFUSED:
        with pytest.raises(UnsupportedError, match=REFUSED[name, engine]):
            outcomes(name, engine)
        return
    wrong = [outcome for outcome in outcomes(name, engine) if not outcome.passed]
    assert len(wrong) == MISSES.get((name, engine), 0), wrong


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_law_shows(case):
    name, engine, sets = WRONG[case]
    assert any(not outcome.passed for outcome in outcomes(name, engine, sets))


@pytest.mark.parametrize("engine", ENGINES)
def test_a_tower_of_boxes_stands(engine):
    """One second of the ten, in which PyBullet's still rocks a little; docs/records/contact.md has all of them, at
    every timestep."""
    found = outcomes("tower-boxes", engine, ("physics.duration=1 s",))
    assert all(outcome.passed for outcome in found if outcome.kind == "displacement")


@pytest.mark.parametrize(
    "engine", [name for name in ENGINES if name != "dart" and ("tower-cylinders", name) not in REFUSED]
)
def test_a_tower_of_cylinders_stands(engine):
    """All of the ten seconds; DART takes half a minute for them, and has one second in the next test."""
    assert all(outcome.passed for outcome in outcomes("tower-cylinders", engine))


def test_a_tower_of_cylinders_needs_a_sound_detector():
    """DART's own detector has no contact for a cylinder that stands on another."""
    world = simspec.load(SCENES / "tower-cylinders.yaml", sets=["physics.duration=1 s"])
    settings = "engines.dart.settings.collision_detector=fcl"
    bad = simspec.load(SCENES / "tower-cylinders.yaml", sets=["physics.duration=1 s", settings])
    assert all(outcome.passed for outcome in evaluate(simspec.run(world.resolve(), "dart")))
    assert not all(outcome.passed for outcome in evaluate(simspec.run(bad.resolve(), "dart")))


def test_the_tripods_oracle_is_the_rigid_bodys_equations():
    """The displacements in the spec, computed here again, with another integrator (midpoint) and step."""
    friction, arm, inertia, duration, step = 0.3, 0.1, 0.01, 0.3, 5e-5
    world = simspec.load(SCENES / "tripod.yaml").resolve()
    feet = arm * np.array([[math.cos(a), math.sin(a)] for a in (0.0, 2 * math.pi / 3, 4 * math.pi / 3)])

    def rate(state: np.ndarray) -> np.ndarray:
        cosine, sine = math.cos(state[2]), math.sin(state[2])
        levers = feet @ np.array([[cosine, sine], [-sine, cosine]])
        slip = state[3:5] + state[5] * np.column_stack([-levers[:, 1], levers[:, 0]])
        speed = np.maximum(np.linalg.norm(slip, axis=1, keepdims=True), 1e-9)
        force = -friction * GRAVITY / 3 * slip / speed
        torque = float((levers[:, 0] * force[:, 1] - levers[:, 1] * force[:, 0]).sum())
        return np.array([*state[3:6], *force.sum(axis=0), torque / inertia])

    for spin, expectation in zip((0.0, 10.0, 30.0), world.expectations, strict=True):
        state = np.array([0.0, 0.0, 0.0, 1.0, 0.0, spin])
        for _ in range(round(duration / step)):
            state = state + step * rate(state + 0.5 * step * rate(state))
        wanted = dict(expectation.parameters)["xyz"]
        np.testing.assert_allclose(wanted[:2], state[:2], atol=3e-4)


def test_six_materials_have_a_table_that_no_rule_gives():
    world = simspec.load(SCENES / "six-materials.yaml").resolve()
    assert len(world.contact.materials) == 6
    values = {(pair.first, pair.second): pair.friction for pair in world.contact.pairs}
    assert len(set(values.values())) == len(values) == 21
    local = {material.name: material.friction for material in world.contact.materials}
    for rule in (min, max, lambda a, b: a * b, lambda a, b: (a + b) / 2, lambda a, b: math.sqrt(a * b)):
        off = [abs(rule(local[a], local[b]) / value - 1) for (a, b), value in values.items() if a != b]
        assert max(off) > 0.2
