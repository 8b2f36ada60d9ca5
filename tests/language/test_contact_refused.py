"""Contact laws that an engine cannot have: refused when compiling, with the place in the spec, the pair and the way out."""

from __future__ import annotations

import pytest

from simspec.compiler import compile_world
from simspec.contact import MOST_SPLIT_MATERIALS
from simspec.engines.kit.registry import engines
from simspec.errors import UnsupportedError
from simspec.language.load import load
from simspec.language.models import Contact
from simspec.support.declarations import Level
from simspec.support.features import Feature
from simspec.testing.worlds import accepting
from tests.declared import PYRAMID_ALONE, SQUARE, TOUCHING
from tests.language.contact_specs import BODIES, written

CONES = {
    "elliptic": Feature.CONE_ELLIPTIC,
    "pyramid-inscribed": Feature.CONE_PYRAMID_INSCRIBED,
    "pyramid-circumscribed": Feature.CONE_PYRAMID_CIRCUMSCRIBED,
}
LAYERED = [name for name in TOUCHING if engines()[name].LAYERS]
CROSSED = [
    (name, quantity)
    for name, engine in engines().items()
    for quantity in ("rolling_friction", "torsional_friction")
    if getattr(engine.RULES, quantity) == "cross"
]


def refused(path, engine):
    spec = load(path)
    with pytest.raises(UnsupportedError) as caught:
        compile_world(spec.resolve(), [engine], spec.locate)
    return caught.value.problems


FREE = [name for name, engine in engines().items() if engine.SUPPORT[Feature.JOINT_FREE].level is Level.EXACT]
"""Those of which a spec with free bodies accepts nothing but what it says of contact."""


@pytest.mark.parametrize("cone", CONES)
@pytest.mark.parametrize("engine", FREE)
def test_a_cone_that_an_engine_lacks_is_refused_where_it_is_written(engine, cone, tmp_path):
    path = written(
        tmp_path, f"  friction_cone: {cone}", BODIES.replace("sphere: {radius: 0.1}", "box: {size: [2, 1, 1]}")
    )
    support = engines()[engine].SUPPORT[CONES[cone]]
    support = support.in_world(load(path).resolve())
    if support.level in (Level.UNSUPPORTED, Level.APPROXIMATE):
        problem, *others = sorted(refused(path, engine), key=lambda entry: CONES[cone].value not in entry.message)
        # an engine may have boxes on boxes approximately, whatever the cone
        assert all(Feature.SHAPE_BOX.value in other.message for other in others)
        assert CONES[cone].value in problem.message
        assert engines()[engine].TITLE in problem.message
        assert problem.location.line == 5
        assert f"--engine {engine}" in problem.hint or f"accept: [{CONES[cone].value}]" in problem.hint
    else:
        before = load(path).resolve()
        world = accepting(before, engine)
        assert {*world.options(engine).accept} - {*before.options(engine).accept} <= {Feature.SHAPE_BOX.value}
        compile_world(world, [engine])


@pytest.mark.parametrize("engine", [name for name in TOUCHING if name not in (*PYRAMID_ALONE, *SQUARE)])
def test_the_elliptic_cone_of_a_ball_is_refused_by_none(engine, tmp_path):
    """Deviations of an engine need not be accepted where no body shows them."""
    spec = load(written(tmp_path, "  friction_cone: elliptic"))
    compile_world(spec.resolve(), [engine], spec.locate)


IMPACT = Feature.IMPACT_FRICTION.value
UNSAID = BODIES.partition("engines:")[0]
"""The bodies, without what is accepted of them."""


def test_friction_that_is_missing_in_impacts_is_refused_where_it_is_written(tmp_path):
    """File, line, and both ways out: accept it, or have it computed."""
    pair = "  pairs:\n    - {between: [rubber, steel], friction: 0.7}"
    path = written(tmp_path, pair, UNSAID)
    (problem,) = refused(path, "mujoco")
    assert (problem.location.file, problem.location.line) == (str(path), 6)
    assert problem.path == "contact.pairs.rubber.steel.friction"
    assert f"only approximately: {engines()['mujoco'].SUPPORT[Feature.IMPACT_FRICTION].how}" in problem.message
    assert "settings: {friction: coulomb}" in problem.message
    assert problem.hint == f"accept it by name: engines.mujoco.accept: [{IMPACT}], or --accept {IMPACT}"
    for way in (f"accept: [{IMPACT}]", "settings: {friction: coulomb}"):
        spec = load(written(tmp_path, pair, f"{UNSAID}engines: {{mujoco: {{{way}}}}}\n"))
        decisions = compile_world(spec.resolve(), ["mujoco"], spec.locate)["mujoco"].decisions
        (level,) = [decision.level for decision in decisions if decision.feature is Feature.IMPACT_FRICTION]
        assert level is (Level.APPROXIMATE if "accept" in way else Level.OUTSIDE)


@pytest.mark.parametrize(
    "contact",
    [
        "  pairs:\n    - {between: [rubber, steel], friction: 0}",
        "  pairs:\n    - {between: [rubber, steel], collide: false}",
        "  exclude: [[ball, floor]]",
        "  hardness: native",
    ],
    ids=["no friction", "passing materials", "excluded bodies", "native"],
)
def test_worlds_without_oblique_impacts_with_friction_need_not_accept_them(contact, tmp_path):
    way = "engines: {mujoco: {accept: [contact.hardness.native]}}\n"  # a declared difference of its own
    spec = load(written(tmp_path, contact, UNSAID + way))
    compile_world(spec.resolve(), ["mujoco"], spec.locate)


def test_the_solver_that_does_not_find_coulombs_law_is_refused(tmp_path):
    way = "{settings: {friction: coulomb, solver: pgs}}"
    (problem,) = refused(
        written(tmp_path, "  friction_cone: elliptic", f"{UNSAID}engines: {{mujoco: {way}}}\n"), "mujoco"
    )
    assert "pgs" in problem.message
    assert problem.location.line == 9
    assert problem.hint == "solver: newton or cg"


def test_every_cone_is_refused_by_some_engine():
    """So that the test above sees all refusals: no cone is exact in every engine, and each is in some."""
    assert set(CONES) == set(Contact.model_json_schema()["properties"]["friction_cone"]["enum"])
    for cone, feature in CONES.items():
        levels = {engine.SUPPORT[feature].level for engine in engines().values()}
        assert levels & {Level.UNSUPPORTED, Level.APPROXIMATE}
        assert cone == "pyramid-inscribed" or levels & {Level.EXACT, Level.VIA_API}


@pytest.mark.parametrize(("engine", "quantity"), CROSSED)
def test_a_torque_that_counts_only_with_sliding_friction_is_not_lost_in_silence(engine, quantity, tmp_path):
    pair = f"  pairs:\n    - {{between: [rubber, steel], friction: 0, {quantity}: 1 mm}}"
    (problem,) = refused(written(tmp_path, pair), engine)
    assert f"{engine} does not support this {quantity.replace('_', ' ')} of rubber and steel" in problem.message
    assert "sliding friction" in problem.hint
    assert "0.001, would be 0" in problem.found
    assert problem.location.line == 6
    spec = load(written(tmp_path, pair.replace("friction: 0,", "friction: 0.01,")))
    compile_world(spec.resolve(), [engine], spec.locate)


def test_some_engine_crosses_its_torques():
    assert CROSSED


@pytest.mark.parametrize("engine", LAYERED)
def test_more_materials_than_are_split_are_refused_by_name(engine, tmp_path):
    """Each ball has its own friction with the floor and one with its like: no rule of two numbers gives that."""
    names = [f"m{index:02}" for index in range(MOST_SPLIT_MATERIALS + 1)]
    materials = ", ".join(f"{name}: {{friction: 0.9}}" for name in names)
    pairs = "\n".join(
        f"    - {{between: [{names[0]}, {name}], friction: {0.1 + 0.01 * i}}}" for i, name in enumerate(names)
    )
    pairs += f"\n    - {{between: [{names[1]}, {names[2]}], friction: 0.77}}"
    balls = "\n".join(
        f"  {name}: {{pose: {{xyz: [{2 * i}, 0, 1]}}, mass: 1, shapes: [{{sphere: {{radius: 0.1}}, material: {name}}}]}}"
        for i, name in enumerate(names)
    )
    path = tmp_path / "many.yaml"
    path.write_text(
        f"simspec: 1\nname: many\ncontact:\n  materials: {{{materials}}}\n  pairs:\n{pairs}\nbodies:\n{balls}\n",
        encoding="utf-8",
    )
    problems = refused(path, engine)
    accepted = [problem.hint.rpartition(" ")[2] for problem in problems if "accept it by name" in (problem.hint or "")]
    if accepted:  # features to accept come first
        with path.open("a", encoding="utf-8") as file:
            file.write(f"engines: {{{engine}: {{accept: [{', '.join(accepted)}]}}}}\n")
        problems = refused(path, engine)
    (problem,) = problems
    assert "friction" in problem.message
    assert f"up to {MOST_SPLIT_MATERIALS} materials" in problem.message
    assert problem.location is not None
