"""A joint at a model's attachment: each type of joint, in files and in models written in the scenario; errors."""

from __future__ import annotations

import pytest

from simspec.errors import SpecError
from simspec.language.load import Spec, load
from simspec.world.types import Pose
from tests.files import write

MASS = {"mass": 1, "inertia": {"principal": [1, 1, 1]}}
ARM = """simspec: 1
name: arm
model:
  bodies:
    base: {ROOT, mass: 1, inertia: {principal: [1, 1, 1]}}
    tip: {parent: base, mass: 1, inertia: {principal: [1, 1, 1]}, joint: {type: hinge, axis: [0, 0, 1]}}
"""
HINGE = {"type": "hinge", "axis": [0, 1, 0], "damping": 0.1, "limits": {"position": [-1, 1]}, "armature": 0.02}


def scene(folder, root="pose: {xyz: [0, 0, 1]}", **words):
    write({"arm.yaml": ARM.replace("ROOT", root)}, folder)
    trunk = {"bodies": {"trunk": MASS}, "frames": {"mount": {"body": "trunk", "pose": {"xyz": [0, 2, 0]}}}}
    return Spec.from_data(
        {"name": "scene", "models": {"trunk": trunk, "arm": {"use": "arm.yaml", **words}}}, folder=folder
    )


def root(spec):
    return next(body for body in spec.resolve().bodies if body.name == "arm/base").joint


def test_a_model_is_attached_by_a_joint(tmp_path):
    joint = root(
        scene(tmp_path, attach="trunk/trunk", pose={"xyz": [1, 0, 0]}, joint=HINGE, positions={"base_joint": 0.5})
    )
    assert (joint.name, joint.kind, joint.parent) == ("arm/base_joint", "hinge", "trunk/trunk")
    assert joint.origin == Pose((1.0, 0.0, 1.0))
    assert (joint.axis, joint.damping, joint.armature, joint.position) == ((0.0, 1.0, 0.0), 0.1, 0.02, (0.5,))
    assert joint.position_limits == (-1.0, 1.0)


def test_origin_is_another_word_for_pose(tmp_path):
    place = {"xyz": [1, 0, 0], "rpy": [0, 0, 1]}
    for carrier in ("trunk/trunk", "trunk/mount"):
        words = {"attach": carrier}
        by_pose = root(scene(tmp_path, pose=place, joint=HINGE, **words))
        assert root(scene(tmp_path, joint={**HINGE, "origin": place}, **words)) == by_pose
    assert by_pose.origin.position == (1.0, 2.0, 1.0)


@pytest.mark.parametrize(
    ("joint", "kind"),
    [
        ({"type": "slide", "axis": [0, 0, 1], "name": "rail"}, "slide"),
        ({"type": "ball", "position": {"rpy": [0.1, 0, 0]}}, "ball"),
        ({"type": "fixed"}, "fixed"),
    ],
)
@pytest.mark.parametrize("start", ["pose: {}", "fixed: true", "velocity: {linear: [1, 0, 0]}", "joint: {type: fixed}"])
def test_joints_of_each_type_replace_a_root_that_is_fixed_or_free(joint, kind, start, tmp_path):
    found = root(scene(tmp_path, start, attach="trunk/trunk", joint=joint))
    assert (found.kind, found.parent) == (kind, "trunk/trunk")
    assert found.name == f"arm/{joint.get('name', 'base_joint')}"
    to_world = root(scene(tmp_path, start, joint=joint))
    assert (to_world.kind, to_world.parent) == (kind, None)


def test_a_free_joint_has_damping(tmp_path):
    found = root(scene(tmp_path, "fixed: true", joint={"type": "free", "damping": {"linear": 1, "angular": 2}}))
    assert (found.kind, found.damping, found.angular_damping) == ("free", 1.0, 2.0)


def test_a_root_with_a_joint_in_the_model_is_attached_by_it(tmp_path):
    start = "joint: {type: hinge, axis: [1, 0, 0]}"
    found = root(scene(tmp_path, start, attach="trunk/trunk"))
    assert (found.kind, found.parent, found.axis) == ("hinge", "trunk/trunk", (1.0, 0.0, 0.0))
    with pytest.raises(SpecError, match="the root 'base' has a joint of its own") as error:
        scene(tmp_path, start, attach="trunk/trunk", joint=HINGE)
    (problem,) = error.value.problems
    assert (problem.path, problem.found, problem.hint) == ("models.arm.joint", "a hinge joint", "remove this one")


def test_the_same_for_models_written_in_the_scenario_in_arrays_and_mirrored(tmp_path):
    model = {"bodies": {"base": {**MASS, "pose": {"xyz": [0, 0, 1]}}}, "joint": HINGE}
    data = {"name": "scene", "models": {"arm": {**model, "array": {"line": 2, "step": [1, 0, 0]}}}}
    spec = Spec.from_data(data)
    assert [body.joint.kind for body in spec.resolve().bodies] == ["hinge", "hinge"]
    assert Spec.from_data(spec.data).resolve() == spec.resolve()
    turned = Spec.from_data({"name": "scene", "models": {"arm": {**model, "mirror": "z"}}}).resolve().bodies[0].joint
    # the mirror is of the model; its place and its joint are as the placement says
    assert (turned.axis, turned.origin.position) == ((0.0, 1.0, 0.0), (0.0, 0.0, -1.0))


def test_places_of_a_joint_are_in_the_scenario(tmp_path):
    write({"arm.yaml": ARM.replace("ROOT", "pose: {}")}, tmp_path)
    text = "simspec: 1\nname: scene\nmodels:\n  arm:\n    use: arm.yaml\n"
    text += "    joint: {type: hinge, axis: [0, 1, 0], damping: 0.1}\n"
    (tmp_path / "scene.yaml").write_text(text)
    place = load(tmp_path / "scene.yaml").locate("bodies.arm/base.joint.damping")
    assert (place.file.endswith("scene.yaml"), place.line, place.column) == (True, 6, 52)
    heavier = load(tmp_path / "scene.yaml", sets=["models.arm.joint.damping=0.3"])
    assert heavier.resolve().bodies[0].joint.damping == 0.3


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ({"joint": {"type": "hinge"}}, "a hinge joint needs an axis"),
        ({"joint": {**HINGE, "damping": "1 kg"}}, "wrong unit: expected an angular damping"),
        ({"joint": {"type": "free"}}, "a model that is attached to a body does not move freely"),
        ({"joint": {**HINGE, "origin": {}}, "pose": {}}, "pose and joint.origin exclude each other"),
        ({"joint": HINGE, "positions": {"base_joint": 2}}, "the initial position is beyond the joint's limits"),
    ],
)
def test_errors_of_a_joint_are_at_the_placement(words, message, tmp_path):
    with pytest.raises(SpecError) as error:
        scene(tmp_path, attach="trunk/trunk", **words)
    (problem,) = error.value.problems
    assert problem.message.startswith(message)
    assert problem.path.startswith("models.arm")


def test_a_joint_to_the_world_excludes_fixed_kinematic_and_a_velocity(tmp_path):
    for key, value in (("fixed", True), ("kinematic", True), ("velocity", {"linear": [1, 0, 0]})):
        with pytest.raises(SpecError) as error:
            scene(tmp_path, joint=HINGE, **{key: value})
        assert error.value.problems[0].path == f"models.arm.{key}"


def test_a_moving_root_needs_a_mass(tmp_path):
    write({"arm.yaml": ARM.replace("ROOT, mass: 1, inertia: {principal: [1, 1, 1]}", "pose: {}")}, tmp_path)
    trunk = {"bodies": {"trunk": MASS}}
    for joint in ({"type": "fixed"}, HINGE):
        models = {"trunk": trunk, "arm": {"use": "arm.yaml", "attach": "trunk/trunk", "joint": joint}}
        data = {"name": "scene", "models": models}
        if joint is HINGE:
            with pytest.raises(SpecError, match="a moving body needs a mass"):
                Spec.from_data(data, folder=tmp_path)
        else:
            assert Spec.from_data(data, folder=tmp_path).resolve()
