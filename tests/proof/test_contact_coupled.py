"""The coupled contact probes: their closed forms, what engines show, and that a wrong solver or law is seen."""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import simspec
from simspec.engines.kit.refinements import SLIDING, in_force
from simspec.engines.kit.registry import find_engine
from simspec.proof.contact import leaning, run, scope, stacks
from simspec.proof.contact.leaning import Rod, pile_acceleration, rod_acceleration
from simspec.proof.contact.probe import GRAVITY
from simspec.proof.contact.simultaneous import OPENING, Strike, impulses
from simspec.support.declarations import Level
from simspec.support.features import Feature
from simspec.world.reach import MaterialReach, reach
from tests.nightly import nightly
from tests.proof.contact_probing import figures, figures_of_each, installed, law

pytestmark = pytest.mark.usefixtures("warm_engines")

ALL = MaterialReach(
    leans=True,
    gathers=True,
    corners=True,
    carries=True,
    ratio=10.0,
    layers=3,
    crosses=True,
    jams=True,
    squeezes=True,
    plane=True,
)
PROBES = run.COUPLED
JAMMING, IMPACTS = ("jam", "jam-light"), ("strike", "row", "edge")


def coupled(**pair):
    return dataclasses.replace(law(**pair), reach=ALL)


# --- closed forms -------------------------------------------------------------------------------------------------


@given(st.floats(0.2, 1.4), st.floats(-3.0, 0.0))
def test_a_smooth_rod_falls_by_its_lagrangian(angle, speed):
    """Without friction: (I + m L²/4) θ̈ = −m g (L/2) cos θ, whatever the speed (x² + z² is constant)."""
    length, mass, inertia = 1.3, 2.0, 0.4
    found = rod_acceleration(angle, speed, 0.0, length, 0.05, mass, inertia)
    expected = -mass * GRAVITY * length / 2.0 * math.cos(angle) / (inertia + mass * length**2 / 4.0)
    assert found == pytest.approx(expected, rel=1e-12)


@given(st.floats(0.2, 1.3))
def test_a_rod_at_its_least_friction_does_not_accelerate(angle):
    rod = Rod()
    least = rod._least(angle)
    assert rod_acceleration(angle, 0.0, least, rod.LENGTH, rod.RADIUS, rod.MASS, rod.INERTIA) == pytest.approx(
        0.0, abs=1e-9
    )
    assert rod_acceleration(angle, 0.0, 0.9 * least, rod.LENGTH, rod.RADIUS, rod.MASS, rod.INERTIA) < 0.0


def test_the_least_friction_of_a_thin_rod_agrees_with_the_textbook():
    """tan θ = (1 − μ²) / 2 μ for equal friction at floor and wall."""
    rod = Rod()
    rod.RADIUS = 0.0
    for friction in (0.1, 0.4, 0.8):
        assert rod._least(math.atan((1.0 - friction**2) / (2.0 * friction))) == pytest.approx(friction)


@given(st.floats(0.1, 0.7), st.sampled_from((2, 3)))
def test_a_pile_at_its_threshold_does_not_accelerate(friction, below):
    angle = 2.0 * math.atan(friction)
    assert pile_acceleration(angle, 0.0, friction, below, 0.1, 1.0) == pytest.approx(0.0, abs=1e-9)
    assert pile_acceleration(angle, 0.0, 0.9 * friction, below, 0.1, 1.0) > 0.0


@given(st.floats(0.3, 1.2), st.sampled_from((2, 3)))
def test_a_smooth_pile_conserves_energy(angle, below):
    """From rest the rate of kinetic energy is that of potential energy: with μ = 0 nothing rolls by force, so that lower
    balls would slide; they roll here, whose 2/5 m r² count."""
    radius, mass = 0.1, 1.0
    step = 1e-4
    turned = pile_acceleration(angle, 0.0, 0.0, below, radius, mass) * step
    out, up = 2.0 * radius * math.cos(angle) * turned, -2.0 * radius * math.sin(angle) * turned
    # power of gravity at this speed, against the change of kinetic energy in the step
    kinetic = below * 0.7 * mass * out**2 + 0.5 * mass * up**2
    work = -mass * GRAVITY * up * step / 2.0
    assert kinetic == pytest.approx(work, rel=1e-9)


@given(st.floats(0.0, 1.0), st.floats(0.1, 1.4))
def test_smooth_impacts_never_add_energy(restitution, opening):
    c, s = math.cos(opening), math.sin(opening)
    mobility = np.array([[1.0 + 2.0 * c * c, 2.0 * c * s], [2.0 * c * s, 3.5 + 2.0 * s * s]])
    normal, along = impulses(mobility, c, s, 0.0, restitution)
    assert along == 0.0
    after = (2.0 * normal * c - 1.0) ** 2 + 2.0 * normal**2
    assert after <= 1.0 + 1e-12
    assert after == pytest.approx(1.0 - 2.0 * (1.0 - restitution**2) * c * c / (1.0 + 2.0 * c * c), rel=1e-9)


def test_a_ball_on_two_balls_agrees_with_the_known_solution():
    """At e = 1, without friction and from 2 m/s the struck balls leave at (±0.693, 1.2) m/s."""
    wanted = coupled(friction=0.0, restitution=1.0)
    probe = Strike()
    changes = probe.changes(wanted, probe.groups()[0])
    struck = next(change for name, change in changes.items() if name.startswith("right"))
    assert struck == pytest.approx([2.4 / 2.0 / math.sqrt(3.0), 0.0, -1.2], abs=1e-9)
    assert probe.energy(wanted) == pytest.approx(1.0)
    assert pytest.approx(math.radians(30.0)) == OPENING


def test_a_stick_that_stops_takes_the_whole_slip():
    mobility = np.array([[2.0, 0.5], [0.5, 3.0]])
    normal, along = impulses(mobility, 1.0, 0.4, 10.0, 0.5)
    assert mobility @ (normal, along) == pytest.approx([1.5, 0.4])
    normal, along = impulses(mobility, 1.0, 4.0, 0.1, 0.5)
    assert along == pytest.approx(0.1 * normal)


@given(st.floats(0.05, 1.9), st.sampled_from((0.0005, 0.001, 0.004, 0.016)))
def test_bodies_that_slide_together_stop_in_the_steps_of_the_probe(friction, timestep):
    """By semi-implicit Euler, with μ g of each of two bodies of any masses."""
    probe, wanted = stacks.SlidingStack(), coupled(friction=friction, timestep=timestep)
    speed, way = probe.speed(wanted), 0.0
    for _ in range(probe.steps(wanted)):
        speed -= friction * GRAVITY * timestep
        way += speed * timestep
    assert speed == pytest.approx(0.0, abs=1e-9)
    expected = [figure.expected for figure in probe.wanted(wanted)]
    assert expected == [pytest.approx(way), pytest.approx(way), 0.0] * 2
    assert 0.8 * stacks.WAY < way < (stacks.SLAB[0] - stacks.CUBE[0]) / 2.0 + stacks.WAY / 2.0


def test_stacks_slide_on_a_plane_in_either_order():
    probe = stacks.SlidingStack()
    on_box, on_plane = probe.trials(coupled())
    assert [body.name for body in on_plane.bodies] == [body.name for body in reversed(on_box.bodies)]
    assert [trial.bodies[end].shapes[0].kind for trial, end in ((on_box, 0), (on_plane, -1))] == ["box", "plane"]
    boxes = dataclasses.replace(coupled(), reach=dataclasses.replace(ALL, plane=False))
    assert probe.trials(boxes) == [on_box]
    for missing in ({"ratio": 0.0}, {"corners": False}):
        assert not probe.applies(dataclasses.replace(coupled(), reach=dataclasses.replace(ALL, **missing)))
    assert not probe.applies(coupled(friction=0.0))
    assert not probe.applies(coupled(friction=stacks.TIPS))


# --- what a world can do ------------------------------------------------------------------------------------------

WORLD = """
simspec: 1
name: reach
physics: {{timestep: 1 ms, duration: 0.01 s}}
contact:
  friction_cone: elliptic
  materials: {{wood: {{friction: 0.5}}}}
bodies:
  floor: {{fixed: true, shapes: [{{box: {{size: [4, 4, 1]}}, pose: {{xyz: [0, 0, -0.5]}}, material: wood}}]}}
{more}
"""
BALL = "  {name}: {{pose: {{xyz: [{x}, 0, 1]}}, mass: {mass}, shapes: [{{sphere: {{radius: 0.1}}, material: wood}}]}}\n"


def found(tmp_path, more):
    path = tmp_path / "world.yaml"
    path.write_text(WORLD.format(more=more))
    return reach(simspec.load(path).resolve(), "wood", "wood")


BALLS = ("sphere",)


def balls(*masses):
    return "".join(BALL.format(name=f"ball_{number}", x=number, mass=mass) for number, mass in enumerate(masses))


def test_a_single_ball_on_a_floor_has_no_coupled_contacts(tmp_path):
    assert found(tmp_path, balls(1.0)) == MaterialReach(kinds=BALLS)


def test_a_plane_is_no_coupled_contact(tmp_path):
    box = "{box: {size: [4, 4, 1]}, pose: {xyz: [0, 0, -0.5]}, "
    path = tmp_path / "world.yaml"
    path.write_text(WORLD.format(more=balls(1.0)).replace(box, "{plane: {}, "))
    world = simspec.load(path).resolve()
    assert reach(world, "wood", "wood") == MaterialReach(kinds=BALLS, plane=True)
    assert scope.scope(world, ())["contact of several bodies"].startswith(scope.NONE_HERE)


def test_a_second_wall_lets_a_ball_lean(tmp_path):
    wall = "  wall: {fixed: true, shapes: [{box: {size: [1, 1, 1]}, pose: {xyz: [2, 0, 0.5]}, material: wood}]}\n"
    assert found(tmp_path, balls(1.0) + wall) == MaterialReach(leans=True, kinds=BALLS)


def test_two_balls_weigh_on_each_other_and_three_are_a_pile(tmp_path):
    assert found(tmp_path, balls(1.0, 30.0)) == MaterialReach(True, False, False, False, 30.0, 2, BALLS)
    assert found(tmp_path, balls(1.0, 30.0, 0.5)) == MaterialReach(True, True, False, False, 60.0, 3, BALLS)


def test_kinematic_bodies_carry_and_have_no_weight(tmp_path):
    plate = "  plate: {kinematic: true, pose: {xyz: [9, 9, 1]}, shapes: [{box: {size: [1, 1, 1]}, material: wood}]}\n"
    there = found(tmp_path, balls(1.0) + plate)
    assert (there.carries, there.leans, there.ratio) == (True, True, 0.0)


BOX = "  {name}: {{pose: {{xyz: [{x}, 0, 1]}}, mass: 1, shapes: [{{box: {{size: {size}}}, material: wood}}]}}\n"


@pytest.mark.parametrize(
    ("sizes", "crosses"),
    [
        (["[0.2, 0.2, 0.1]"], False),  # on the floor of 4 m alone
        (["[0.9, 0.9, 0.1]"], True),  # its diagonal is a third of the floor's width
        (["[0.2, 0.2, 0.1]", "[0.2, 0.2, 0.1]"], True),
        (["[0.05, 0.05, 0.05]", "[0.4, 0.3, 0.1]"], False),
    ],
)
def test_boxes_of_like_sizes_can_cross(tmp_path, sizes, crosses):
    boxes = "".join(BOX.format(name=f"box_{number}", x=number, size=size) for number, size in enumerate(sizes))
    assert found(tmp_path, boxes).crosses is crosses


def test_balls_cross_nothing(tmp_path):
    assert not found(tmp_path, balls(1.0, 1.0) + BOX.format(name="box", x=5, size="[0.2, 0.2, 0.1]")).crosses


CLAMP = """
  clamp:
    pose: {{xyz: [3, 0, 2]}}
    mass: 1
    inertia: {{principal: [1, 1, 1]}}
    shapes:
      - {{sphere: {{radius: 0.05}}, pose: {{xyz: [0, 0, 0]}}, material: wood}}
      - {{sphere: {{radius: 0.05}}, pose: {{xyz: [{wide}, 0, 0.2]}}, material: wood}}
"""
POST = (
    "  post: {{fixed: true, shapes: [{{box: {{size: [{thick}, 3, 3]}}, pose: {{xyz: [9, 0, 2]}}, material: wood}}]}}\n"
)


@pytest.mark.parametrize(
    ("wide", "thick", "jams"),
    [(0.3, 0.2, True), (0.3, 0.5, False), (0.0, 0.1, True)],  # √(0.3² + 0.2²) = 0.36 m between centres; 0.2 m
)
def test_a_clamp_jams_on_a_body_that_fits_between_its_shapes(tmp_path, wide, thick, jams):
    assert found(tmp_path, CLAMP.format(wide=wide) + POST.format(thick=thick)).jams is jams


def test_a_single_shape_cannot_clamp_and_fixed_bodies_can(tmp_path):
    post = POST.format(thick=0.1)
    assert not found(tmp_path, balls(1.0, 2.0) + post).jams
    arm = (
        "  arm: {parent: ball_0, joint: {type: fixed, origin: {xyz: [0.4, 0, 0]}}, mass: 1,"
        " shapes: [{sphere: {radius: 0.1}, material: wood}]}\n"
    )
    assert found(tmp_path, balls(1.0) + arm + post).jams


SLAB = "  slab: {{pose: {{xyz: [0, 0, 1]}}, mass: 1, shapes: [{{box: {{size: {size}}}, material: wood}}]}}\n"
SLOT = """  slot:
    fixed: true
    shapes:
      - {{box: {{size: [0.1, 2, 2]}}, pose: {{xyz: [-{at}, 0, 2], rpy: [0, 0, {turn}]}}, material: wood}}
      - {{box: {{size: [0.1, 2, 2]}}, pose: {{xyz: [{at}, 0, 2], rpy: [0, 0, {turn}]}}, material: wood}}
"""


@pytest.mark.parametrize(
    ("size", "at", "turn", "jams"),
    [
        ("[0.2, 0.1, 0.3]", 0.2, 0, True),  # 0.3 m between walls, 0.1 m wide, 0.37 m long
        ("[0.2, 0.1, 0.3]", 0.2, 0.02, True),
        ("[0.2, 0.1, 0.15]", 0.2, 0, False),  # 0.27 m long
        ("[0.5, 0.4, 0.35]", 0.2, 0, False),  # does not fit
    ],
)
def test_a_body_jams_in_a_slot_that_it_fits_and_is_longer_than_wide(tmp_path, size, at, turn, jams):
    assert found(tmp_path, SLAB.format(size=size) + SLOT.format(at=at, turn=turn)).jams is jams


def test_a_ball_does_not_jam_in_a_slot_and_a_slab_under_a_shelf_may(tmp_path):
    assert not found(tmp_path, balls(1.0) + SLOT.format(at=0.25, turn=0)).jams
    shelf = "  shelf: {{fixed: true, shapes: [{{box: {{size: [1, 1, 0.1]}}, pose: {{xyz: [1, 0, {z}]}}, material: wood}}]}}\n"
    slab = SLAB.format(size="[0.2, 0.1, 0.3]")
    assert found(tmp_path, slab + shelf.format(z=0.4)).jams
    assert not found(tmp_path, slab + shelf.format(z=0.5)).jams


def test_a_body_that_touches_a_single_wall_does_not_jam(tmp_path):
    slot = SLOT.format(at=0.2, turn=0)
    first, second = slot.rsplit("material: wood", 1)
    path = tmp_path / "world.yaml"
    text = WORLD.format(more=SLAB.format(size="[0.2, 0.1, 0.3]") + f"{first}material: air{second}")
    path.write_text(text.replace("materials: {", "materials: {air: {friction: 0.5, restitution: 0}, ", 1))
    world = simspec.load(path, sets=["contact.pairs=[{between: [wood, air], collide: false}]"]).resolve()
    assert not reach(world, "wood", "wood").jams


FINGER = (
    "  finger: {{mass: 1, joint: {{type: slide, axis: [1, 0, 0]}},"
    " shapes: [{{{shape}, pose: {{xyz: [0, 0, 3]}}, material: wood}}]}}\n"
)
SMALL_BOX = BOX.format(name="box", x=2, size="[0.2, 0.2, 0.1]")


@pytest.mark.parametrize(
    ("shape", "more", "squeezes"),
    [
        ("box: {size: [0.1, 0.1, 0.1]}", SMALL_BOX, True),
        ("cylinder: {radius: 0.1, length: 0.1}", SMALL_BOX, True),
        ("sphere: {radius: 0.1}", SMALL_BOX, False),
        ("box: {size: [0.1, 0.1, 0.1]}", balls(1.0), False),
    ],
)
def test_a_finger_on_a_joint_presses_faces(tmp_path, shape, more, squeezes):
    assert found(tmp_path, FINGER.format(shape=shape) + more).squeezes is squeezes


def test_many_alike_are_found_by_their_extremes(tmp_path):
    masses = [1.0] * 20 + [7.0] + [1.0] * 20
    assert found(tmp_path, balls(*masses)).ratio == pytest.approx(7.0)


# --- engines ------------------------------------------------------------------------------------------------------

EXACT = ("pybullet", "dart", "ode")
"""Engines without a declared deviation in these probes at a ratio of masses of 10."""


@pytest.mark.parametrize("engine", EXACT)
@pytest.mark.parametrize("name", [name for name in PROBES if name not in ("slide-spin", *JAMMING, "squeeze")])
def test_engines_keep_to_the_coupled_law(engine, name, tmp_path):
    if not installed(engine):
        pytest.skip(f"{engine} is not installed")
    for restitution in (0.0, 0.5) if name in IMPACTS else (0.0,):
        wanted = coupled(restitution=restitution)
        if engine == "pybullet":  # a body that slides on a plane under a heavier body stops early, as declared
            wanted = dataclasses.replace(wanted, reach=dataclasses.replace(ALL, plane=False))
        found_figures = figures(engine, PROBES[name], wanted, tmp_path / str(restitution))
        assert [figure for figure in found_figures if not figure.passed] == []


@pytest.mark.parametrize(
    ("name", "friction", "timestep", "cone"),
    [
        ("clamp", 0.05, 0.001, "pyramid-inscribed"),  # both bounds of a point are reached at once
        ("clamp", 0.05, 0.004, "elliptic"),
        ("rod", 0.65, 0.004, "pyramid-circumscribed"),  # bounds of two points follow from each other
        ("rod", 0.65, 0.004, "elliptic"),  # friction turns the slip that it is laid against
    ],
)
def test_ode_solves_steps_that_its_passes_did_not_solve(name, friction, timestep, cone, tmp_path):
    """Cases that were off by 10 to 60 % while each point was carried on by itself."""
    if not installed("ode"):
        pytest.skip("ode is not installed")
    wanted = dataclasses.replace(coupled(friction=friction, timestep=timestep), friction_cone=cone)
    assert [figure for figure in figures("ode", PROBES[name], wanted, tmp_path) if not figure.passed] == []


def test_drake_has_crossing_edges_by_pressure_alone(tmp_path):
    """Its corners and one point for each pair let the upper box sink; the error of Drake's faces is within tolerance."""
    if not installed("drake"):
        pytest.skip("drake is not installed")
    cross = PROBES["cross"]
    corners = figures("drake", cross, coupled(), tmp_path / "corners")
    assert all(not figure.passed for figure in corners if figure.probe == "cross")
    faces = figures("drake", cross, coupled(), tmp_path / "faces", settings={"hydroelastic_faces": True})
    assert [figure for figure in faces if not figure.passed] == []


def test_physx_has_friction_in_a_step_that_begins_just_before_an_impact(tmp_path):
    if not installed("physx"):
        pytest.skip("physx is not installed")
    for timestep in (0.001, 0.004):
        for name, probe in ((name, run.PROBES[name]) for name in ("oblique", "strike")):
            shown = figures("physx", probe, coupled(timestep=timestep), tmp_path / f"{name}{timestep}")
            assert [figure for figure in shown if not figure.passed] == []


@pytest.mark.parametrize("name", JAMMING)
@pytest.mark.parametrize("friction", [0.05, 0.3])
def test_a_clamp_jams_in_a_direct_solver_and_falls_where_friction_makes_no_normal_force(name, friction, tmp_path):
    probe, wanted = run.PROBES[name], coupled(friction=friction)
    for engine, settings, stands in (("ode", {}, True), ("dart", {"contact_solver": "dantzig"}, False)):
        if not installed(engine):
            continue
        shown = figures(engine, probe, wanted, tmp_path / engine, settings=settings)
        assert [figure.passed for figure in shown] == [stands]
    assert shown[0].without == pytest.approx(GRAVITY * 0.3**2 / 2.0, rel=0.01)  # free fall


def test_fingers_press_evenly_in_a_direct_solver_and_turn_boxes_where_sweeps_end_early(tmp_path):
    """A body with 0.8 times the friction that holds it falls with 0.2 g, straight."""
    probe, wanted = run.PROBES["squeeze"], coupled()
    slips = next(figure for figure in probe.wanted(wanted) if figure.probe == "squeeze-slips")
    assert slips.expected == pytest.approx(0.1, abs=0.001)
    assert slips.without == pytest.approx(5.0 * slips.expected)
    for engine, passed in (("ode", [True] * 3), ("dart", [False] * 3)):
        if installed(engine):
            shown = figures(engine, probe, wanted, tmp_path / engine)
            assert [figure.passed for figure in shown] == passed


def test_a_clamp_is_probed_where_possible_and_stops_within_two_metres():
    for probe in (PROBES[name] for name in JAMMING):
        assert probe.applies(coupled(friction=0.05))
        assert not probe.applies(coupled(friction=0.02))
        assert not probe.applies(dataclasses.replace(coupled(), reach=dataclasses.replace(ALL, jams=False)))
        assert {case.ratio for case in probe.cases(coupled())} == set(leaning.STANDS)


@pytest.mark.parametrize("engine", ["mujoco", "pybullet", "dart", "drake", "ode", "gazebo", "rapier", "physx"])
@pytest.mark.parametrize(
    ("feature", "probe"),
    [(Feature.MASS_RATIO, "stack"), (Feature.SELF_LOCKING, "jam"), (Feature.EVEN_PRESSURE, "squeeze")],
)
@pytest.mark.parametrize("timestep", [1, 16])
def test_deviations_under_default_settings_must_be_accepted_by_name(engine, feature, probe, timestep, tmp_path):
    """Support is decided with the settings that are in force, stated or not."""
    kind = find_engine(engine)
    more = balls(1.0, 1000.0) + CLAMP.format(wide=0.3) + POST.format(thick=0.1)
    path = tmp_path / "world.yaml"
    path.write_text(
        WORLD.format(more=more).replace(
            "timestep: 1 ms, duration: 0.01 s", f"timestep: {timestep} ms, duration: 0.16 s"
        )
    )
    world = simspec.load(path).resolve()
    settings, there = in_force(engine)(world), reach(world, "wood", "wood")
    if engine == "dart":
        settings = {**settings, "contact_solver": "nsgs"}
    counting = [
        row
        for row in kind.CONTACT_DEVIATIONS
        if row.probe.startswith(probe)
        and not row.probe.endswith("-plane")
        and (row.probe not in SLIDING or (there.corners and engine != "mujoco"))  # its native friction has another name
        and row.counts_for(law(timestep=1e-3 * timestep).pair, "elliptic", 1e-3 * timestep, settings, there.ratio)
    ]
    refined = kind.SUPPORT[feature].refine(world)
    assert (refined is not None and refined.level is Level.EXACT) == (not counting)


BOUNCING = (
    *((engine, 0.5, 0.5, 1, "elliptic", {}) for engine in ("pybullet", "ode", "gazebo", "rapier", "physx")),
    ("dart", 0.5, 0.5, 1, "elliptic", {"contact_solver": "nsgs"}),
    ("mujoco", 0.4, 0.4, 3, "elliptic", {}),
    ("mujoco", 0.5, 1.0, 1, "elliptic", {}),
    ("mujoco", 1.1, 0.7, 0.7, "pyramid-inscribed", {}),
    ("mujoco", 0.15, 0.6, 6, "elliptic", {"friction": "coulomb"}),
    ("pybullet", 0.3, 0.8, 3, "pyramid-circumscribed", {}),
    ("dart", 0.1, 0.7, 6, "elliptic", {"contact_solver": "dantzig"}),
    ("ode", 0.3, 1.0, 3, "elliptic", {"solver": "quick-step"}),
    ("gazebo", 0.1, 0.7, 6, "pyramid-circumscribed", {}),
    ("rapier", 0.1, 0.8, 12, "elliptic", {}),
)
"""Engine, friction, restitution, timestep (ms), cone and settings: values between the measured ones, but for the first six."""
REST_AND_SLIDE = ("rod", "clamp", "pile", *JAMMING, "squeeze", "cross", "carrier", "slide-spin")


def beyond_declared(engine, probes, wanted, tmp_path, settings):
    """The figures of some probes that the engine's declared deviations do not cover."""
    kind = find_engine(engine)
    in_force = {name: setting.default for name, setting in kind.SETTINGS.items()} | settings
    cases = [(PROBES[name], wanted, wanted) for name in probes if PROBES[name].applies(wanted)]
    shown = itertools.chain.from_iterable(figures_of_each(engine, cases, tmp_path, settings))
    covered = (run.deviating(figure, wanted, kind, in_force, kind.version()) for figure in shown)
    return [figure for figure in covered if not figure.passed]


@pytest.mark.parametrize(("friction", "restitution", "timestep"), [(0.5, 0.5, 1), (0.4, 0.7, 3)])
def test_a_rod_with_restitution_slips_within_its_declared_deviation(friction, restitution, timestep, tmp_path):
    """The first is the law of the self-test's world "ground"; MuJoCo's contact with restitution has no cushion."""
    if not installed("mujoco"):
        pytest.skip("mujoco is not installed")
    wanted = coupled(friction=friction, restitution=restitution, timestep=1e-3 * timestep)
    assert beyond_declared("mujoco", ("rod",), wanted, tmp_path, {}) == []


@nightly
@pytest.mark.parametrize(("engine", "friction", "restitution", "timestep", "cone", "settings"), BOUNCING)
def test_materials_with_restitution_are_within_declared_deviations(
    engine, friction, restitution, timestep, cone, settings, tmp_path
):
    """In every coupled probe in which exact bodies rest or slide, whatever their restitution."""
    if not installed(engine):
        pytest.skip(f"{engine} is not installed")
    wanted = coupled(friction=friction, restitution=restitution, timestep=1e-3 * timestep)
    wanted = dataclasses.replace(wanted, friction_cone=cone)
    probes = [name for name in REST_AND_SLIDE if name != "squeeze" or engine not in ("rapier", "physx")]
    assert beyond_declared(engine, probes, wanted, tmp_path, settings) == []


@pytest.mark.parametrize(
    ("name", "compiled"),
    [
        ("rod", {"friction": 0.4}),
        ("clamp", {"friction": 0.45}),
        ("pile", {"friction": 0.45}),
        ("strike", {"friction": 0.5, "restitution": 0.4}),
        ("row", {"friction": 0.5, "restitution": 0.4}),
        ("edge", {"friction": 0.5, "restitution": 0.4}),
        ("slide-spin", {"friction": 0.45}),
        ("carrier", {"friction": 0.2}),
        ("stack-slides", {"friction": 0.47}),
    ],
)
def test_a_wrong_number_is_seen(name, compiled, tmp_path):
    """The motion of DART under another law than that of the expected figures."""
    restitution = 0.3 if name in IMPACTS else 0.0
    wanted = coupled(friction=0.5, restitution=restitution)
    found_figures = figures("dart", PROBES[name], wanted, tmp_path, compiled=coupled(**compiled))
    assert any(not figure.passed for figure in found_figures)
