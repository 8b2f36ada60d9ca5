"""The probe of oblique impacts: its closed forms, planted slips, and what the engines show."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from simspec.compiler import compile_world, write_folder
from simspec.engines.kit.registry import find_engine
from simspec.proof.contact import oblique, run, size
from simspec.proof.contact.oblique import impact_begins, impact_ends
from simspec.proof.contact.probe import GRAVITY, TrialMotion, project
from simspec.support.features import Feature
from tests import worlds
from tests.caches import cache_home
from tests.declared import with_the_cone
from tests.proof.contact_probing import law

pytestmark = pytest.mark.usefixtures("warm_engines")

PROBE = run.PROBES["oblique"]
MODES = {name: () for name in with_the_cone(Feature.RESTITUTION) if name != "mujoco"} | {
    "mujoco": (("friction", "coulomb"),)
}
"""Settings of each engine with which impacts have friction."""


@pytest.fixture(autouse=True)
def few_probes(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", cache_home(tmp_path))
    monkeypatch.setattr(run, "PROBES", {"oblique": PROBE})
    monkeypatch.setattr(size, "size_trial", lambda world: None)


# --- the closed forms, against momentum ---------------------------------------------------------------------------


def inverse_mass(body, lever):
    """(3, 3): the change of velocity by an impulse at ``lever`` from the centre; a flat box is assumed not to rotate."""
    if body.joint.kind == "fixed":
        return np.zeros((3, 3))
    found = np.eye(3) / body.inertial.mass
    if body.shapes[0].kind == "sphere":
        x, y, z = lever
        across = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        found -= across @ across / body.inertial.inertia[0]
    return found


def made(wanted, trial):
    """The motion of a trial under the law: flight, and one impulse at the point of contact in the step after bodies overlap.

    From momentum at that point alone, without the probe's shares: the impulse along the normal that gives the speed of
    separation, and the one across that stops the slip, as near to it as the cone lets it come.
    """
    dt, steps = wanted.timestep, sum(phase.steps for phase in trial.phases)
    partner = {body.name: other for body, other in zip(trial.bodies[::2], trial.bodies[1::2], strict=False)}
    couples = [(body, trial.bodies[0]) for body in trial.bodies[1:]] if not trial.meets else []
    couples += [(body, partner[body.name]) for body in trial.bodies[::2]] if trial.meets else []
    pose = {body.name: np.zeros((steps + 1, 7)) for body in trial.bodies}
    velocity = {body.name: np.zeros((steps + 1, 6)) for body in trial.bodies}
    for entry, other in couples:
        states = [
            (np.array(body.joint.position[:3]), np.array(body.joint.velocity))
            for body in (entry, other)
            if body.joint.position
        ]
        hit = False
        for step in range(steps + 1):
            for body, (place, speed) in zip((entry, other), states, strict=False):
                pose[body.name][step, :3], velocity[body.name][step] = place, speed
            (place, speed), more = states[0], states[1:]
            if more:
                line = more[0][0] - place
                gap = float(np.linalg.norm(line)) - entry.shapes[0].size[0] - other.shapes[0].size[0]
                normal, reach = line / np.linalg.norm(line), entry.shapes[0].size[0]
            else:
                reach = entry.shapes[0].size[0] if entry.shapes[0].kind == "sphere" else entry.shapes[0].size[2] / 2.0
                gap, normal = place[2] - reach, np.array([0.0, 0.0, -1.0])
            fallen = np.array([0.0, 0.0, -GRAVITY * dt])
            changes = [np.concatenate([fallen, np.zeros(3)]) for _ in states]
            if gap < 0.0 and not hit:
                hit = True
                inverse = inverse_mass(entry, reach * normal) + inverse_mass(other, -reach * normal)
                slip = speed[:3] - (more[0][1][:3] if more else 0.0)
                load = 0.0 if more else GRAVITY * dt  # a floor does not fall along
                size = (1.0 + wanted.pair.restitution) * float(slip @ normal) + load
                size /= float(normal @ inverse @ normal)
                across = np.eye(3) - np.outer(normal, normal)
                stop = np.linalg.pinv(across @ inverse @ across) @ across @ slip
                most = wanted.pair.friction * size
                stop *= min(1.0, most / np.linalg.norm(stop))
                impulse = size * normal + stop
                for body, change, sign in zip((entry, other), changes, (-1.0, 1.0), strict=False):
                    change[:3] += sign * impulse / body.inertial.mass
                    if body.shapes[0].kind == "sphere":
                        change[3:] += np.cross(-sign * reach * normal, sign * impulse) / body.inertial.inertia[0]
            states = [(p + dt * (v + c)[:3], v + c) for (p, v), c in zip(states, changes, strict=True)]
    return TrialMotion(dt * np.arange(steps + 1), pose, velocity)


@pytest.mark.parametrize("timestep", [0.0005, 0.016])
@pytest.mark.parametrize("restitution", [0.0, 0.5])
@pytest.mark.parametrize("friction", [0.05, 0.5, 1.5])
def test_closed_forms_agree_with_momentum(friction, restitution, timestep):
    wanted = law(timestep, friction, restitution)
    found = PROBE.figures(wanted, [made(wanted, trial) for trial in PROBE.trials(wanted)])
    assert [figure.probe for figure in found].count("oblique") == 10  # balls: velocity and spin, each slips and grips
    assert [figure.probe for figure in found].count("oblique-separation") == 6
    for figure in found:
        assert figure.measured == pytest.approx(figure.expected, rel=1e-6, abs=1e-9), figure.case
    sizes = {figure.case.split(",")[0]: figure.expected for figure in found if figure.quantity == "change of velocity"}
    assert all(size > 0.0 for size in sizes.values())


def test_both_regimes_occur():
    """Gripping bodies end without slip, slipping bodies do not, by the initial speeds of the trials."""
    wanted = law(friction=0.5, restitution=0.5)
    for case, body in zip(PROBE.landings(wanted), PROBE.trials(wanted)[0].bodies[1:], strict=True):
        slip = math.hypot(*body.joint.velocity[:2]) * oblique.SHARE[case.shape]
        limit = 0.5 * 1.5 * PROBE.approach(wanted)
        assert slip / limit == pytest.approx(1.6 if case.regime == "slips" else 0.6)


@pytest.mark.parametrize("friction", [0.05, 1.0, 4.0])
def test_nothing_is_faster_than_it_may_be(friction):
    wanted = law(friction=friction, restitution=1.0)
    for trial in PROBE.trials(wanted):
        for body in trial.bodies:
            if body.joint.velocity:
                assert math.hypot(*body.joint.velocity[:2]) < 1.1 * oblique.FASTEST
    assert PROBE.approach(wanted) <= oblique.APPROACH


def test_without_friction_or_contact_there_is_nothing_to_measure():
    assert not PROBE.applies(law(friction=0.0))
    assert not PROBE.applies(law(collide=False))
    rolling = law(rolling_friction=0.01)
    assert PROBE.applies(rolling)
    assert PROBE.shapes(rolling) == ("box",)
    assert len(PROBE.trials(rolling)) == 1


def test_where_an_impact_begins_and_ends():
    fall = GRAVITY * 0.001
    speed = np.zeros((8, 3))
    speed[:, 0] = [1.0, 1.0, 1.0, 0.7, 0.5, 0.5, 0.5, 0.5]
    speed[:, 2] = [-2.0, -2.0 - fall, -2.0 - 2 * fall, -0.5, 0.9, 0.9 - fall, 0.9 - 2 * fall, 0.9 - 3 * fall]
    begin = impact_begins(speed, 0.001)
    assert (begin, impact_ends(speed[:, 2], begin)) == (2, 4)


def test_no_number_is_never_passed():
    wanted = law(restitution=0.5)
    motions = []
    for trial in PROBE.trials(wanted):
        steps = sum(phase.steps for phase in trial.phases) + 1
        nothing = {body.name: np.full((steps, 7), np.nan) for body in trial.bodies}
        motions.append(TrialMotion(np.zeros(steps), nothing, {name: value[:, :6] for name, value in nothing.items()}))
    assert not any(figure.passed for figure in PROBE.figures(wanted, motions))


def test_free_flight_through_the_floor_fails():
    """Free flight, without an impact."""
    wanted = law(restitution=0.5)
    motions = []
    for trial in PROBE.trials(wanted):
        values = {body.name: np.zeros((11, 7)) for body in trial.bodies}
        speed = {body.name: np.tile(body.joint.velocity or (0.0,) * 6, (11, 1)) for body in trial.bodies}
        for name, rows in values.items():
            rows[:, :3] = next(body for body in trial.bodies if body.name == name).joint.position[:3] or 0.0
        motions.append(TrialMotion(np.zeros(11), values, speed))
    assert not any(figure.passed for figure in PROBE.figures(wanted, motions))


# --- in engines ---------------------------------------------------------------------------------------------------


def measured(world, engine, folder, settings=()):
    accept = ("contact.cone.elliptic", "contact.friction.impact", "material.restitution")
    if settings:
        accept = accept[:1] + accept[2:]
    world = worlds.with_options(world, engine, settings=tuple(settings), accept=accept)
    write_folder(compile_world(world, [engine])[engine].files, folder)
    with run.measure(world, engine, folder, None, 120.0, False) as measuring:
        return measuring.wait()[0]


SEPARATE_POINTS = ("rapier", "oblique-separation")
"""An engine and the probe in which it declares what it makes of several points that bounce at once."""


@pytest.mark.parametrize("engine", MODES)
@pytest.mark.parametrize("restitution", [0.0, 0.5])
def test_impacts_have_friction_within_four_percent_and_without_a_deviation(engine, restitution, tmp_path):
    """MuJoCo's within 3 %."""
    if find_engine(engine).version() is None:
        pytest.skip(f"{engine} is not installed")
    for friction in (0.05, 0.5, 1.0):
        world = worlds.ball_with_law(friction=friction, restitution=restitution)
        found = measured(world, engine, tmp_path / str(friction), MODES[engine])
        assert len(found) == 16
        assert all(
            figure.passed and (not figure.deviation or (engine, figure.probe) == SEPARATE_POINTS) for figure in found
        ), [f for f in found if not f.passed]
        most = 0.03 if engine == "mujoco" else 0.04
        assert all(
            abs(figure.measured - figure.expected) <= most * figure.expected
            for figure in found
            if figure.probe == "oblique"
        )


def test_mujocos_native_friction_is_insufficient_and_declared(tmp_path):
    found = measured(worlds.ball_with_law(friction=0.5), "mujoco", tmp_path / "native")
    assert all(figure.passed for figure in found)
    off = [abs(f.measured - f.expected) / f.expected for f in found if f.probe == "oblique"]
    assert 0.7 < min(off) <= max(off) < 0.92
    assert all("contact.friction.impact" in figure.deviation for figure in found if figure.probe == "oblique")


@pytest.mark.parametrize("engine", MODES)
def test_another_friction_is_measured_as_such(engine, tmp_path):
    """A twentieth more friction than required: slipping bodies show it, gripping bodies do not."""
    if find_engine(engine).version() is None:
        pytest.skip(f"{engine} is not installed")
    world = worlds.ball_with_law(friction=0.4)
    pair = dataclasses.replace(world.contact.pairs[0], friction=0.44)
    more = dataclasses.replace(world, contact=dataclasses.replace(world.contact, pairs=(pair,)))
    accept = ("contact.cone.elliptic",)
    more, world = (worlds.with_options(entry, engine, settings=MODES[engine], accept=accept) for entry in (more, world))
    write_folder(compile_world(more, [engine])[engine].files, tmp_path / "more")
    with run.measure(world, engine, tmp_path / "more", None, 120.0, False) as measuring:
        found, _ = measuring.wait()
    wrong = {figure.case.split(",")[0] for figure in found if not figure.passed}
    assert wrong == {f"{what} that slips" for what in ("a box on the floor", "a ball on the floor", BALLS)}


BALLS = "a ball on a ball of three times its mass"


@pytest.mark.parametrize(("engine", "cone"), [("pybullet", "pyramid-circumscribed"), ("mujoco", "pyramid-inscribed")])
def test_pyramids(engine, cone, tmp_path):
    if find_engine(engine).version() is None:
        pytest.skip(f"{engine} is not installed")
    world = worlds.ball_with_law(friction=0.5)
    world = dataclasses.replace(world, contact=dataclasses.replace(world.contact, friction_cone=cone))
    world = worlds.with_options(world, engine, settings=MODES[engine], accept=(f"contact.cone.{cone}",))
    write_folder(compile_world(world, [engine])[engine].files, tmp_path / "files")
    with run.measure(world, engine, tmp_path / "files", None, 120.0, False) as measuring:
        found, _ = measuring.wait()
    assert all(figure.passed and not figure.deviation for figure in found)
    slips = [f.expected for f in found if f.case.startswith("a box on the floor that slips") and f.probe == "oblique"]
    assert slips[0] > 0.0
    assert project(np.array([10.0, 0.0]), 1.0, cone)[0] == 1.0
