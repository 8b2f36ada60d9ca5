"""A run in one engine: its contents, its identity, and its failures."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from simspec.compiler import compile_world, write_folder
from simspec.engines.kit.capabilities import DOUBLE, SINGLE
from simspec.engines.kit.registry import engines, find_engine
from simspec.errors import EngineError, SpecError
from simspec.outputs.writing import Artifacts
from simspec.runner import metrics
from simspec.runner.execution import run, run_all, run_jobs
from simspec.runner.expectations import evaluate
from simspec.runner.run import Case, perturbed_state
from simspec.world.canonical import sha256
from simspec.world.kinematics import initial_state, layout_of
from simspec.world.types import Expectation, Physics, RecordOptions
from tests import worlds
from tests.installed import JOINTED

pytestmark = pytest.mark.usefixtures("warm_engines")

ENGINES = sorted(JOINTED)
ERRORS = {DOUBLE: 1e-8, SINGLE: 2e-6}
"""Largest error of energies, as a share of the largest one."""
FOLLOWED = {DOUBLE: 1e-8, SINGLE: 1e-5}
"""Largest distance (m) from the oracle after 200 steps."""


def short(base, steps: int = 200, every: int = 10):
    return dataclasses.replace(
        base,
        physics=dataclasses.replace(base.physics, steps=steps),
        record=dataclasses.replace(base.record, every_steps=every),
    )


@pytest.mark.parametrize("engine", ENGINES)
def test_a_run_and_its_provenance(engine, tmp_path):
    world = short(worlds.damped_springs())
    entry = run(world, engine)
    assert entry.failed is None
    assert entry.time.tolist() == pytest.approx([0.01 * k for k in range(21)])
    assert entry.arrays["pose"].shape == (21, len(world.bodies), 7)
    q, v = initial_state(world)
    assert np.allclose(entry.arrays["q"][0], q, atol=1e-12)
    assert np.allclose(entry.arrays["v"][0], v, atol=1e-12)
    facts = entry.provenance
    assert facts["world_sha256"] == sha256(world)
    assert facts["engine_version"] == engines()[engine].version()
    assert facts["steps"] == 200
    assert facts["artifacts_sha256"] == compile_world(world, [engine])[engine].sha256
    assert set(facts["settings"]) == set(engines()[engine].SETTINGS)
    # the real-time factor is simulated time over the step calls alone; end to end there is more than that
    assert entry.real_time_factor == pytest.approx(0.2 / facts["seconds"]["step"])
    assert entry.end_to_end_factor == pytest.approx(0.2 / facts["seconds"]["process"])
    assert facts["seconds"]["step"] < facts["seconds"]["process"]
    again = entry.save(tmp_path / "run")
    assert (again / "bodies.parquet").is_file()


@pytest.mark.parametrize("engine", ENGINES)
def test_the_energy_of_the_engine_equals_that_of_the_metrics(engine):
    world = short(worlds.every_joint())
    entry = run(world, engine)
    kinetic, potential = metrics.energy(world, entry.arrays)
    error = ERRORS[find_engine(engine).PRECISION]
    for found, of_metrics in zip(entry.arrays["energy"].T[:2], (kinetic, potential), strict=True):
        assert np.allclose(found, of_metrics, rtol=0.0, atol=error * np.abs(of_metrics).max())


@pytest.mark.parametrize("engine", ENGINES)
def test_following_the_oracle_is_measured(engine):
    close = Expectation("follows_oracle", (("tolerance", FOLLOWED[find_engine(engine).PRECISION]),))
    world = dataclasses.replace(short(worlds.damped_springs()), expectations=(close,))
    entry = run(world, engine)
    (found,) = evaluate(entry)
    assert found.passed, found
    # the same motion moved by a hundred times the tolerance does not pass
    moved = 100.0 * dict(close.parameters)["tolerance"]
    entry.arrays["pose"][-1, -1, 0] += moved
    (found,) = evaluate(entry)
    assert not found.passed
    assert found.measured == pytest.approx(moved, rel=1e-2)
    assert found.detail.startswith(world.bodies[-1].name)


def test_features_that_the_oracle_omits_are_reported():
    limited = dataclasses.replace(
        short(worlds.limits_and_armature(), 2000), expectations=(Expectation("follows_oracle", (("tolerance", 1.0),)),)
    )
    dry = dataclasses.replace(short(worlds.limits_and_armature(dry_friction=0.1)), expectations=limited.expectations)
    for world, words in ((limited, "does not support joint limits"), (dry, "dry friction")):
        steps = np.arange(0, world.physics.steps + 1, 10)
        arrays = {"step": steps, "time": steps * 1e-3, "pose": np.zeros((len(steps), 4, 7))}
        from simspec.runner.run import Run

        (found,) = evaluate(Run(world, "any", arrays, {}))
        assert not found.passed
        assert words in found.detail


def test_given_artifacts_are_used_and_checked(tmp_path):
    world = short(worlds.spheres(2))
    compiled = compile_world(world, ["mujoco"])["mujoco"]
    write_folder(compiled.files, tmp_path / "mujoco")
    assert Artifacts.read(tmp_path / "mujoco").sha256 == compiled.sha256
    assert run(world, "mujoco", artifacts=tmp_path / "mujoco").provenance["artifacts_sha256"] == compiled.sha256
    with pytest.raises(SpecError, match="compiled from another world"):
        run(short(worlds.spheres(3)), "mujoco", artifacts=tmp_path / "mujoco")
    with pytest.raises(SpecError, match="no readable artifacts"):
        run(world, "mujoco", artifacts=tmp_path)


def test_another_record_replaces_the_record_of_the_world():
    entry = run(short(worlds.spheres(2)), "mujoco", record=RecordOptions(50, ("pose",)))
    assert entry.time.tolist() == pytest.approx([0, 0.05, 0.1, 0.15, 0.2])
    assert "contact.row" not in entry.arrays
    assert "energy" not in entry.arrays


def test_a_perturbed_state_moves_everything_a_little_and_stays_a_state():
    world = worlds.every_joint()
    q, v = initial_state(world)
    moved_q, moved_v = perturbed_state(world, 1e-6)
    assert np.abs(moved_q - q).max() < 5e-6
    assert np.allclose(moved_v, v * (1 + 1e-6), rtol=1e-15)
    turned = [k for k, body in enumerate(world.bodies) if body.joint.kind in ("ball", "free")]

    for k in turned:
        quaternion = moved_q[layout_of(world).position[k]][-4:]
        assert np.linalg.norm(quaternion) == pytest.approx(1.0, abs=1e-15)
        assert not np.array_equal(quaternion, q[layout_of(world).position[k]][-4:])
    # also where every coordinate is zero
    hung = worlds.damped_springs().bodies[1]
    straight = dataclasses.replace(hung.joint, parent=None, position=(0.0,))
    zero = worlds.world((dataclasses.replace(hung, joint=straight),))
    assert perturbed_state(zero, 1e-15)[0].tolist() == [1e-15]


def test_a_perturbed_run_starts_elsewhere():
    world = short(worlds.spheres(2))
    entry = run(world, "mujoco", perturb=1e-3)
    assert entry.arrays["q"][0][2] == pytest.approx(initial_state(world)[0][2] * 1.001)
    assert entry.provenance["perturb"] == 1e-3


@pytest.mark.parametrize("engine", ENGINES)
def test_a_state_that_stops_being_finite_is_the_runs_result(engine):
    # the square of such a spin is more than a double holds
    world = worlds.every_joint()
    root = world.bodies[0]
    spinning = dataclasses.replace(root.joint, velocity=(0.0, 0.0, 0.0, 1e160, 2e160, 3e160))
    bodies = (dataclasses.replace(root, joint=spinning), *world.bodies[1:])
    found = run_all(short(dataclasses.replace(world, bodies=bodies)), [engine])[engine]
    assert found.failed is not None
    assert found.provenance.get("steps", 0) < 200


def test_a_failed_engine_does_not_affect_others(monkeypatch):
    world = short(worlds.spheres(2))
    monkeypatch.setattr(engines()["dart"], "version", classmethod(lambda cls: None))
    with pytest.raises(EngineError, match="not installed"):
        run(world, "dart")
    found = run_all(world, ["dart", "mujoco"])
    assert list(found) == ["dart", "mujoco"]
    assert "not installed" in found["dart"].failed
    assert found["dart"].real_time_factor is None
    assert found["mujoco"].failed is None


def test_a_deadline_is_an_error_of_that_engine():
    world = dataclasses.replace(worlds.spheres(2), physics=Physics(steps=100_000_000), record=RecordOptions(1_000_000))
    with pytest.raises(EngineError, match="deadline of 2 s"):
        run(world, "mujoco", deadline=2.0)


def test_jobs_side_by_side_come_in_order(tmp_path):
    world = short(worlds.spheres(2))
    for name, compiled in compile_world(world, ["mujoco", "pybullet"]).items():
        write_folder(compiled.files, tmp_path / name)
    cases = [Case(world, name, perturb=perturb) for name in ("mujoco", "pybullet") for perturb in (0.0, 1e-15)]
    found = run_jobs([(case, tmp_path / case.engine) for case in cases])
    assert [(entry.engine, entry.provenance["perturb"]) for entry in found] == [
        (case_.engine, case_.perturb) for case_ in cases
    ]
    assert all(entry.failed is None for entry in found)
