"""Problems of a spec are reported all at once, each with its place, the value found, allowed values, and a hint."""

# ruff: noqa: E501 (a case is a line, so that cases can be compared)
from __future__ import annotations

import re

import pytest

from simspec.errors import SpecError
from simspec.language.load import load

HEAD = "simspec: 1\nname: x\n"
BALL = "shapes: [{sphere: {radius: 1}, material: m}]"
MATERIAL = "contact: {materials: {m: {friction: 1}}}\n"
SOLID = "inertia: {principal: [1, 1, 1]}"


def problems(folder, text, **more):
    path = folder / "spec.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(SpecError) as error:
        load(path, **more).resolve()
    return error.value.problems


def body(text):
    return f"{HEAD}{MATERIAL}bodies:\n  a: {{{text}}}\n"


def joint(text, more=""):
    return body(f"mass: 1, {SOLID}, joint: {{{text}}}{more}")


CASES = {
    # name: (text, path, message, found, allowed, hint); the last three are looked for only where given
    "unknown key": (body(f"mas: 1, {SOLID}"), "bodies.a.mas", "unknown key 'mas'", None, "mass", "did you mean 'mass'?"),
    "unknown key at the top": (f"{HEAD}bodys: {{}}\n", "bodys", "unknown key", None, "bodies", "'bodies'"),
    "key of another place": (body(f"mass: 1, {SOLID}, stiffness: 3"), "bodies.a.stiffness", "unknown key", None, None, "stiffness: \\.\\.\\."),
    "wrong unit": (body(f"mass: 3 deg, {SOLID}"), "bodies.a.mass", r"expected a mass \(kg\), found 'deg'", "'3 deg'", "kg", None),
    "no number": (body(f"mass: heavy, {SOLID}"), "bodies.a.mass", "found no number", "'heavy'", None, None),
    "true for a number": (body(f"mass: true, {SOLID}"), "bodies.a.mass", "expected a mass", "true", "a number", None),
    "nothing for a number": (body(f"mass: , {SOLID}"), "bodies.a.mass", "expected a mass", "nothing", "a number", None),
    "negative mass": (body(f"mass: -1, {SOLID}"), "bodies.a.mass", "at least 0", "-1", "≥ 0", None),
    "no mass": (body(""), "bodies.a", "needs a mass", None, None, "density"),
    "mass 0": (body(f"mass: 0, {SOLID}"), "bodies.a.mass", "above 0", "0", None, None),
    "mass without inertia": (body("mass: 1"), "bodies.a", "needs moments of inertia", None, None, None),
    "inertia without mass": (body(SOLID), "bodies.a", "inertia without mass", None, None, None),
    "mass and density": (
        body("mass: 1, shapes: [{sphere: {radius: 1}, material: m, density: 1}]"),
        "bodies.a.mass", "exclude each other", None, None, None,
    ),
    "inertia and density": (
        body(f"{SOLID}, shapes: [{{sphere: {{radius: 1}}, material: m, density: 1}}]"),
        "bodies.a.inertia", "exclude each other", None, None, None,
    ),
    "one density missing": (
        body("shapes: [{sphere: {radius: 1}, material: m, density: 1}, {sphere: {radius: 1}, material: m}]"),
        "bodies.a.shapes.1", "no density", None, None, "massless",
    ),
    "triangle inequality, principal": (
        body("mass: 1, inertia: {principal: [1, 1, 3]}"),
        "bodies.a.inertia.principal", r"triangle inequality.* 1, 1, 3 kg m², and 3 > 1 \+ 1 = 2", None, None, None,
    ),
    "triangle inequality, tensor": (
        body("mass: 1, inertia: {tensor: {xx: 2, yy: 2, zz: 1, xy: 1.5}}"),
        "bodies.a.inertia.tensor", r"triangle inequality.*3.5 > 0.5 \+ 1 = 1.5", None, None, None,
    ),
    "negative moment": (
        body("mass: 1, inertia: {tensor: {xx: 1, yy: 1, zz: 1, xy: 5}}"),
        "bodies.a.inertia.tensor", "negative: -4, 1, 6", None, None, None,
    ),
    "moment of a wire": (
        body("mass: 1, inertia: {principal: [1, 1, 0]}"), "bodies.a.inertia", "above 0", "1, 1, 0", None, None,
    ),
    "tensor turned": (
        body("mass: 1, inertia: {tensor: {xx: 1, yy: 1, zz: 1}, rpy: [0, 0, 1]}"),
        "bodies.a.inertia.rpy", "given in the body's axes", None, None, None,
    ),
    "rpy and quat": (
        body(f"mass: 1, {SOLID}, pose: {{rpy: [0, 0, 0], quat: [1, 0, 0, 0]}}"),
        "bodies.a.pose.quat", "rpy and quat exclude each other", None, "rpy or quat", None,
    ),
    "quaternion of x y z": (
        body(f"mass: 1, {SOLID}, pose: {{quat: [0, 0, 0, 0]}}"), "bodies.a.pose.quat", "unit length", "length 0", None, None,
    ),
    "two numbers for three": (
        body(f"mass: 1, {SOLID}, pose: {{xyz: [1, 2]}}"), "bodies.a.pose.xyz", "a list of 3 lengths", "2 values", None, None,
    ),
    "unit within a list": (
        body(f"mass: 1, {SOLID}, pose: {{xyz: [1, 2 s, 3]}}"), "bodies.a.pose.xyz.1", "wrong unit", "'2 s'", None, None,
    ),
    "zero axis": (joint("type: hinge, axis: [0, 0, 0]"), "bodies.a.joint.axis", "no direction", None, None, None),
    "no axis": (joint("type: slide"), "bodies.a.joint", "needs an axis", None, None, "axis:"),
    "axis on a ball": (joint("type: ball, axis: [0, 0, 1]"), "bodies.a.joint.axis", "is not allowed", None, None, None),
    "armature on a free joint": (joint("type: free, armature: 1"), "bodies.a.joint.armature", "has two parts", None, None, None),
    "rest on a ball": (
        joint("type: ball, spring: {stiffness: 1, rest: 1}"), "bodies.a.joint.spring.rest", "at zero", None, None, None,
    ),
    "limits on a fixed joint": (
        joint("type: fixed, limits: {position: [0, 1]}"), "bodies.a.joint.limits", "does not move", None, None, None,
    ),
    "position of a free joint": (
        joint("type: free, position: 3"), "bodies.a.joint.position", "`pose`", None, None, None,
    ),
    "joint type": (joint("type: hinj"), "bodies.a.joint.type", "not an allowed word", "'hinj'", "slide", "'hinge'"),
    "joint without type": (joint("damping: 1"), "bodies.a.joint.type", "type is missing", None, "hinge", None),
    "lower above upper": (
        joint("type: hinge, axis: [0, 0, 1], limits: {position: [90 deg, -1]}"),
        "bodies.a.joint.limits.position", "lower limit is above the upper", "90 deg", None, "-1",
    ),
    "limit of a wrong unit": (
        joint("type: slide, axis: [0, 0, 1], limits: {position: [0, 90 deg]}"),
        "bodies.a.joint.limits.position.1", "expected a length", None, None, None,
    ),
    "damping of a wrong unit": (
        joint("type: slide, axis: [0, 0, 1], damping: 1 N m s/rad"), "bodies.a.joint.damping", "wrong unit", None, "N s/m", None,
    ),
    "negative damping": (joint("type: hinge, axis: [0, 0, 1], damping: -1"), "bodies.a.joint.damping", "at least 0", "-1", None, None),
    "start beyond a limit": (
        joint("type: hinge, axis: [0, 0, 1], limits: {position: [0, 1]}, position: 2"),
        "bodies.a.joint.position", "beyond the joint's limits", "2", "0 to 1", None,
    ),
    "misspelt type": (joint("typ: hinge, axis: [0, 0, 1]"), "bodies.a.joint.typ", "unknown key", None, "type", "'type'"),
    "misspelt parameter": (
        f"{HEAD}bodies: {{}}\nexpect: [{{energy_conserved: {{tolerence: 1 %}}}}]\n",
        "expect.0.energy_conserved.tolerence", "unknown key", None, "tolerance", "'tolerance'",
    ),
    "number for an orientation": (joint("type: ball, position: 1"), "bodies.a.joint.position", "an orientation", "1", "rpy", None),
    "unknown key of an orientation": (
        joint("type: ball, position: {rpi: [0, 0, 0]}"), "bodies.a.joint.position.rpi", "unknown key", None, None, "'rpy'",
    ),
    "pose and origin": (
        joint("type: hinge, axis: [0, 0, 1], origin: {xyz: [0, 0, 1]}", ", pose: {xyz: [0, 0, 1]}"),
        "bodies.a.pose", "exclude each other", None, None, None,
    ),
    "fixed and joint": (joint("type: ball", ", fixed: true"), "bodies.a.joint", "exclude each other", None, None, None),
    "velocity of a hinge": (
        joint("type: ball", ", velocity: {linear: [0, 0, 1]}"), "bodies.a.velocity", "free roots", None, None, "joint",
    ),
    "missing parent": (
        f"{HEAD}bodies:\n  arm: {{mass: 1, {SOLID}}}\n  b: {{parent: amr, mass: 1, {SOLID}, joint: {{type: ball}}}}\n",
        "bodies.b.parent", "there is no body 'amr'", "amr", None, "did you mean 'arm'?",
    ),
    "cycle": (
        f"{HEAD}bodies:\n"
        + "".join(f"  {a}: {{parent: {b}, mass: 1, {SOLID}, joint: {{type: ball}}}}\n" for a, b in ("ab", "bc", "ca")),
        "bodies.a.parent", "a -> b -> c -> a", None, None, None,
    ),
    "own parent": (
        f"{HEAD}bodies:\n  a: {{parent: a, mass: 1, {SOLID}, joint: {{type: ball}}}}\n",
        "bodies.a.parent", "a -> a", None, None, None,
    ),
    "child without joint": (
        f"{HEAD}bodies:\n  a: {{mass: 1, {SOLID}}}\n  b: {{parent: a, mass: 1, {SOLID}}}\n",
        "bodies.b", "needs a joint", None, None, "type: fixed",
    ),
    "free child": (
        f"{HEAD}bodies:\n  a: {{mass: 1, {SOLID}}}\n  b: {{parent: a, mass: 1, {SOLID}, joint: {{type: free}}}}\n",
        "bodies.b.joint.type", "only roots are free", None, "hinge", None,
    ),
    "pose of a child": (
        f"{HEAD}bodies:\n  a: {{mass: 1, {SOLID}}}\n  b: {{parent: a, mass: 1, {SOLID}, joint: {{type: ball}}, pose: {{}}}}\n",
        "bodies.b.pose", "is only for roots", None, None, "origin",
    ),
    "two roots": (
        f"{HEAD}model:\n  bodies:\n    a: {{mass: 1, {SOLID}}}\n    b: {{mass: 1, {SOLID}}}\n",
        "model.bodies.b", "exactly one root", "a, b", "one", None,
    ),
    "model and bodies": (
        f"{HEAD}model: {{bodies: {{a: {{mass: 1, {SOLID}}}}}}}\nbodies: {{}}\n", "bodies", "exclude each other", None, None, None,
    ),
    "nothing": (HEAD, "", "nothing to simulate", None, None, None),
    "the same key twice": (
        f"{HEAD}bodies:\n  a: {{mass: 1, {SOLID}}}\n  a: {{mass: 1, {SOLID}}}\n",
        "bodies.a", "the key 'a' is duplicated", "first at 4:3", None, None,
    ),
    "the same joint twice": (
        f"{HEAD}bodies:\n  a: {{mass: 1, {SOLID}, joint: {{type: ball, name: j}}}}\n"
        f"  b: {{mass: 1, {SOLID}, joint: {{type: ball, name: j}}}}\n",
        "bodies.b.joint.name", "the joint name 'j' is taken", "j", None, None,
    ),
    "an element's name twice": (
        f"{HEAD}bodies:\n  a: {{mass: 1, {SOLID}, array: {{line: 2, step: [1, 0, 0]}}}}\n  a_1: {{mass: 1, {SOLID}}}\n",
        "bodies.a_1", "two bodies would be called 'a_1'", "bodies.a at", None, None,
    ),
    "the same shape twice": (
        body("mass: 1, shapes: [{name: s, sphere: {radius: 1}, material: m}, {name: s, sphere: {radius: 1}, material: m}]"),
        "bodies.a", "two shapes would be called 's'", None, None, None,
    ),
    "world": (f"{HEAD}bodies:\n  world: {{mass: 1, {SOLID}}}\n", "bodies.world", "name of the world itself", None, None, None),
    "two shapes in one": (
        body("mass: 1, shapes: [{sphere: {radius: 1}, box: {size: [1, 1, 1]}, material: m}]"),
        "bodies.a.shapes.0.box", "sphere and box exclude each other", None, None, None,
    ),
    "no shape": (body("mass: 1, shapes: [{material: m}]"), "bodies.a.shapes.0", "expected one of sphere", None, None, None),
    "misspelt shape": (
        body("mass: 1, shapes: [{shpere: {radius: 1}, material: m}]"),
        "bodies.a.shapes.0.shpere", "unknown key", None, None, "'sphere'",
    ),
    "radius 0": (
        body("mass: 1, shapes: [{sphere: {radius: 0}, material: m}]"), "bodies.a.shapes.0.sphere.radius", "above 0", None, None, None,
    ),
    "null plane": (body("fixed: true, shapes: [{plane: , material: m}]"), "bodies.a.shapes.0.plane", "a mapping", "nothing", None, "{}"),
    "moving plane": (
        body(f"mass: 1, {SOLID}, shapes: [{{plane: {{}}, material: m}}]"), "bodies.a.shapes.0.plane", "moves", None, None, None,
    ),
    "useless shape": (
        body("mass: 1, shapes: [{sphere: {radius: 1}, collision: false, visual: false}]"),
        "bodies.a.shapes.0.visual", "have no effect", None, None, None,
    ),
    "unknown material": (
        body("mass: 1, shapes: [{sphere: {radius: 1}, material: n}]"),
        "bodies.a.shapes.0.material", "there is no material 'n'", None, "m", None,
    ),
    "no material": (
        f"{HEAD}bodies:\n  a: {{mass: 1, shapes: [{{sphere: {{radius: 1}}}}]}}\n",
        "bodies.a.shapes.0", "needs a material", None, None, "contact: {materials",
    ),
    "one of two materials": (
        f"{HEAD}contact: {{materials: {{m: {{}}, n: {{}}}}}}\nbodies:\n  a: {{mass: 1, shapes: [{{sphere: {{radius: 1}}}}]}}\n",
        "bodies.a.shapes.0", "needs a material", None, "m, n", None,
    ),
    "pair of no material": (
        f"{HEAD}contact: {{materials: {{m: {{}}}}, pairs: [{{between: [m, k], friction: 1}}]}}\nbodies:\n  a: {{mass: 1, {SOLID}}}\n",
        "contact.pairs.0.between.1", "there is no material 'k'", None, "m", None,
    ),
    "pair twice": (
        f"{HEAD}contact: {{materials: {{m: {{}}, n: {{}}}}, pairs: [{{between: [m, n], friction: 1}}, "
        f"{{between: [n, m], friction: 2}}]}}\nbodies:\n  a: {{mass: 1, {SOLID}}}\n",
        "contact.pairs.1", "m and n is duplicated", "pair 0", None, None,
    ),
    "unknown group": (body(f"mass: 1, {SOLID}, collision_group: g"), "bodies.a.collision_group", "does not define 'g'", "g", "default", None),
    "ignored group without bodies": (
        f"{HEAD}contact: {{groups: {{g: {{ignores: [h]}}}}}}\nbodies:\n  a: {{mass: 1, {SOLID}}}\n",
        "contact.groups.g.ignores.0", "no body is in a group 'h'", None, "g", None,
    ),
    "excluded body": (
        f"{HEAD}contact: {{exclude: [[arm, ar]]}}\nbodies:\n  arm: {{mass: 1, {SOLID}}}\n",
        "contact.exclude.0.1", "there is no body 'ar'", "ar", None, "'arm'",
    ),
    "restitution": (f"{HEAD}contact: {{materials: {{m: {{restitution: 110 %}}}}}}\nbodies: {{}}\n", "contact.materials.m.restitution", "at most 1", None, None, None),
    "cone": (f"{HEAD}contact: {{friction_cone: pyramid}}\nbodies: {{}}\n", "contact.friction_cone", "not an allowed word", None, "elliptic", "pyramid-"),
    "rule": (f"{HEAD}contact: {{combine: average}}\nbodies: {{}}\n", "contact.combine", "not an allowed word", None, "mean", None),
    "duration": (
        f"{HEAD}physics: {{timestep: 3 ms, duration: 1}}\nbodies: {{}}\n",
        "physics.duration", "whole number of timesteps", "333.33", "0.999 s or 1.002 s", None,
    ),
    "interval of the record": (
        f"{HEAD}physics: {{timestep: 2 ms}}\nrecord: {{every: 5 ms}}\nbodies: {{}}\n",
        "record.every", "whole number of timesteps", None, "0.004 s or 0.006 s", None,
    ),
    "too many steps": (f"{HEAD}physics: {{timestep: 1e-9, duration: 1e9}}\nbodies: {{}}\n", "physics.duration", "too many steps", None, None, None),
    "timestep 0": (f"{HEAD}physics: {{timestep: 0}}\nbodies: {{}}\n", "physics.timestep", "above 0", None, None, None),
    "channel": (f"{HEAD}record: {{channels: [poses]}}\nbodies: {{}}\n", "record.channels.0", "not an allowed word", None, None, "'pose'"),
    "grid and line": (
        body(f"mass: 1, {SOLID}, array: {{grid: [1, 1, 1], spacing: 1, line: 3, step: [1, 0, 0]}}"),
        "bodies.a.array.line", "grid and line exclude each other", None, None, None,
    ),
    "grid without spacing": (body(f"mass: 1, {SOLID}, array: {{grid: [1, 1, 1]}}"), "bodies.a.array", "grid needs spacing", None, None, None),
    "spacing of a ring": (
        body(f"mass: 1, {SOLID}, array: {{ring: 3, radius: 1, spacing: 1}}"), "bodies.a.array.spacing", "belongs to grid", None, None, None,
    ),
    "bomb of an array": (
        body(f"mass: 1, {SOLID}, array: {{grid: [9999, 9999, 9999], spacing: 1}}"),
        "bodies.a.array.grid", "too many elements", None, "100000", None,
    ),
    "half an element": (body(f"mass: 1, {SOLID}, array: {{ring: 2.5, radius: 1}}"), "bodies.a.array.ring", "whole number", "2.5", None, None),
    "jitter without seed": (
        body(f"mass: 1, {SOLID}, array: {{ring: 2, radius: 1, jitter: {{uniform: 1 mm}}}}"),
        "bodies.a.array.jitter.seed", "seed is missing", None, None, None,
    ),
    "expectation": (
        f"{HEAD}bodies: {{}}\nexpect: [{{energy_rises: {{tolerance: 1 %}}}}]\n",
        "expect.0.energy_rises", "unknown key", None, None, "energy_never_rises",
    ),
    "parameter missing": (
        f"{HEAD}bodies: {{}}\nexpect: [{{energy_conserved: {{}}}}]\n",
        "expect.0.energy_conserved.tolerance", "tolerance is missing", None, None, None,
    ),
    "parameter of a wrong unit": (
        f"{HEAD}bodies: {{}}\nexpect: [{{no_penetration_deeper_than: {{depth: 1 ms}}}}]\n",
        "expect.0.no_penetration_deeper_than.depth", "wrong unit", None, None, None,
    ),
    "expected body": (
        f"{HEAD}bodies:\n  arm: {{mass: 1, {SOLID}}}\nexpect: [{{position: {{body: amr, xyz: [0, 0, 0], tolerance: 1}}}}]\n",
        "expect.0.position.body", "there is no body 'amr'", "amr", None, "'arm'",
    ),
    "time after the end": (
        f"{HEAD}physics: {{duration: 1}}\nbodies:\n  arm: {{mass: 1, {SOLID}}}\n"
        "expect: [{position: {body: arm, xyz: [0, 0, 0], tolerance: 1, at: 2 s}}]\n",
        "expect.0.position.at", "after the end", "2 s", "0 to 1 s", None,
    ),
    "time not recorded": (
        f"{HEAD}physics: {{duration: 1}}\nrecord: {{every: 10 ms}}\nbodies:\n  arm: {{mass: 1, {SOLID}}}\n"
        "expect: [{position: {body: arm, xyz: [0, 0, 0], tolerance: 1, at: 15 ms}}]\n",
        "expect.0.position.at", "nothing is recorded", None, "0.01 s or 0.02 s", None,
    ),
    "momentum under gravity": (
        f"{HEAD}bodies:\n  arm: {{mass: 1, {SOLID}}}\nexpect: [{{momentum_conserved: {{tolerance: 1 %}}}}]\n",
        "expect.0.momentum_conserved", "without gravity", "-9.81", None, None,
    ),
    "box inside out": (
        f"{HEAD}bodies:\n  arm: {{mass: 1, {SOLID}}}\nexpect: [{{stays_within: {{body: arm, lower: [0, 2, 0], upper: [1, 1, 1]}}}}]\n",
        "expect.0.stays_within.lower.1", "lower is above upper", "2 > 1", None, None,
    ),
    "setting": (f"{HEAD}bodies: {{}}\nengines: {{e: {{settings: {{a: [1]}}}}}}\n", "engines.e.settings.a", "expected a number, a word", None, None, None),
    "list for a mapping": (f"{HEAD}bodies: []\n", "bodies", "expected a mapping", None, None, None),
    "mapping for a list": (body("fixed: true, shapes: {sphere: {radius: 1}}"), "bodies.a.shapes", "expected a list", None, None, None),
    "number for a mapping": (f"{HEAD}physics: 3\nbodies: {{}}\n", "physics", "expected a mapping", "3", "gravity", None),
    "version": ("simspec: 2\nname: x\nbodies: {}\n", "simspec", "version 1", "2", "1", None),
    "no version": ("name: x\nbodies: {}\n", "simspec", "simspec is missing", None, "1", None),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_a_problem_has_its_path_message_value_and_hint(tmp_path, case):
    text, path, message, found, allowed, hint = CASES[case]
    all_found = problems(tmp_path, text)
    assert len(all_found) == 1, "\n".join(map(str, all_found))
    problem = all_found[0]
    assert problem.path == path
    assert re.search(message, problem.message)
    for part, wanted in (("found", found), ("allowed", allowed), ("hint", hint)):
        if wanted is not None:
            assert re.search(re.escape(wanted) if part != "hint" else wanted, getattr(problem, part) or "nothing"), part
    assert problem.location is not None
    assert problem.location.file.endswith("spec.yaml")


@pytest.mark.parametrize(("excess", "fine"), [(0.0, True), (5e-10, True), (5e-9, False)])
@pytest.mark.parametrize("form", ["principal: [0.1, 0.2, {}]", "tensor: {{xx: 0.1, yy: 0.2, zz: {}}}"])
def test_a_flat_body_may_be_off_by_the_last_digits_of_its_figures(tmp_path, excess, fine, form):
    path = tmp_path / "flat.yaml"
    path.write_text(body(f"mass: 1, inertia: {{{form.format(0.3 * (1 + excess))}}}"))
    if fine:
        load(path)
    else:
        with pytest.raises(SpecError, match="triangle inequality"):
            load(path)


NAMES = ("a b", "a<b", "a&b", 'a"b', "a'b", "a/b", "é", "1a", "", "-a", "a" * 300, "a\nb", "a.b")


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("place", ["name", "bodies", "models", "materials", "groups", "joint", "shape", "engines"])
def test_names_that_could_break_a_file_are_refused_by_name(tmp_path, place, name):
    import json

    quoted = json.dumps(name)
    ball = f"{{mass: 1, {SOLID}}}"
    text = {
        "name": f"simspec: 1\nname: {quoted}\nbodies: {{a: {ball}}}\n",
        "bodies": f"{HEAD}bodies: {{{quoted}: {ball}}}\n",
        "models": f"{HEAD}models: {{{quoted}: {{bodies: {{a: {ball}}}}}}}\n",
        "materials": f"{HEAD}contact: {{materials: {{{quoted}: {{}}}}}}\nbodies: {{a: {ball}}}\n",
        "groups": f"{HEAD}contact: {{groups: {{{quoted}: {{ignores: []}}}}}}\nbodies: {{a: {ball}}}\n",
        "joint": joint(f"type: ball, name: {quoted}"),
        "shape": body(f"mass: 1, shapes: [{{sphere: {{radius: 1}}, material: m, name: {quoted}}}]"),
        "engines": f"{HEAD}bodies: {{a: {ball}}}\nengines: {{{quoted}: {{}}}}\n",
    }[place]
    found = problems(tmp_path, text)
    assert any("name" in problem.message or "not YAML" in problem.message for problem in found)


def test_a_suggested_name_may_be_used(tmp_path):
    (found,) = problems(tmp_path, f"simspec: 1\nname: Größe <1>\nbodies: {{a: {{mass: 1, {SOLID}}}}}\n")
    clean = re.search(r"did you mean '(.*)'", found.hint)[1]
    path = tmp_path / "good.yaml"
    path.write_text(f"simspec: 1\nname: {clean}\nbodies: {{a: {{mass: 1, {SOLID}}}}}\n")
    assert load(path).name == clean


MANY = """\
simspec: 1
name: many
phisics: {}
physics: {gravity: [0, 0, x], timestep: 3 deg}
contact:
  materials: {slick: {friction: -1}}
bodies:
  a: {mass: -1, pose: {rpy: [0, 0, 0], quat: [1, 0, 0, 0]}}
  b: {parent: absent, mass: 1, joint: {type: hinge, axis: [0, 0, 0], limits: {position: [1, -1]}}}
  c: {parent: d, mass: 1, joint: {type: ball}}
  d: {parent: c, mass: 1, joint: {type: bal}}
  e: {mass: 1, inertia: {principal: [1, 1, 3]}}
  f: {shapes: [{sphere: {radius: 5 s}, material: slik}]}
  g: {}
models:
  m: {use: nope.yaml}
expect:
  - position: {body: a, xyz: [1, 2]}
engines:
  e: {setings: {}}
"""
PLACES = "3:1 4:27 4:41 6:33 8:13 8:40 9:15 9:53 9:79 10:15 11:41 12:26 13:34 13:50 14:3 16:12 18:5 18:25 20:7"


def test_all_problems_at_once_in_the_order_of_the_file(tmp_path):
    found = problems(tmp_path, MANY)
    assert " ".join(f"{entry.location.line}:{entry.location.column}" for entry in found) == PLACES
    assert len(found) == len(set(found))


def test_a_problem_is_reported_once_even_where_several_would_notice(tmp_path):
    """A value that could not be read is not reported again by what needs it."""
    found = problems(tmp_path, joint("type: slide, axis: [1, 0, 0], spring: {stiffness: .nan}, position: .inf"))
    assert [(problem.path, problem.message) for problem in found] == [
        ("bodies.a.joint.spring.stiffness", "numbers must be finite"),
        ("bodies.a.joint.position", "numbers must be finite"),
    ]
