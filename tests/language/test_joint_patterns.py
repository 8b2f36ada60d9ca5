"""Patterns in tables by joint: initial positions and velocities, gains, commands; the exact name has precedence."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simspec.errors import SpecError
from simspec.language.arrays import MOST_PATTERNS, entry_of, matches
from simspec.language.load import Spec

INERTIA = {"mass": 1, "inertia": {"principal": [0.1, 0.1, 0.1]}}


def moving(parent, **joint):
    return {"parent": parent, **INERTIA, "joint": {"axis": [0, 0, 1], **joint}}


BODIES = {
    "palm": {},
    "a": moving("palm", name="index_0", type="hinge"),
    "b": moving("a", name="index_1", type="hinge"),
    "c": moving("palm", name="thumb_0", type="hinge", limits={"position": [0.3, 1.4]}, position=0.3),
    "d": moving("palm", name="slider", type="slide"),
    "e": {"parent": "palm", **INERTIA, "joint": {"name": "eye", "type": "ball"}},
    "f": moving("palm", name="index_2", type="hinge"),
}
FOLLOW = {"tip": {"follow": {"joint": "index_2", "leader": "index_0", "ratio": 2}}}


def hand(said=None, **more):
    placed = {"use": "hand", "fixed": True, **(said or {})}
    return {"name": "scene", "physics": {"duration": 0.1}, "models": {"hand": placed}, **more}


@pytest.fixture
def make(tmp_path, monkeypatch):
    """Worlds of a hand that a placement says more of, by joint: where it begins, and how fast."""
    monkeypatch.chdir(tmp_path)

    def write(states=None, constraints=None):
        model = {"bodies": BODIES, "states": states or {}, "constraints": constraints or {}}
        (tmp_path / "hand.yaml").write_text(json.dumps({"simspec": 1, "name": "hand", "model": model}))

    def made(said=None, states=None, constraints=None, **more):
        write(states, constraints)
        data = hand(said, **more)
        data["models"]["hand"]["use"] = "hand.yaml"
        return Spec.from_data(data)

    return made


def starts(spec, of="position"):
    joints = [body.joint for body in spec.resolve().bodies]
    return {joint.name.removeprefix("hand/"): getattr(joint, of) for joint in joints}


def refused(made, *arguments, **more):
    with pytest.raises(SpecError) as error:
        made(*arguments, **more).resolve()
    (problem,) = error.value.problems
    return problem


def test_a_pattern_means_every_joint_that_it_matches_and_a_name_comes_first(make):
    found = starts(make({"positions": {"index_*": 0.5, "index_1": 0.7}}))
    assert (found["index_0"], found["index_1"], found["index_2"]) == ((0.5,), (0.7,), (0.5,))
    assert (found["thumb_0"], found["slider"]) == ((0.3,), (0.0,))
    assert starts(make({"positions": {"index_1": 0.7, "index_*": 0.5}}))["index_1"] == (0.7,)


def test_velocities_and_states_too_and_the_placement_says_more(make):
    states = {"home": {"positions": {"*_0": 0.4}, "velocities": {"index_*": 2}}}
    spec = make({"state": "home", "positions": {"index_0": 0.1}}, states=states)
    assert (starts(spec)["index_0"], starts(spec)["thumb_0"]) == ((0.1,), (0.4,))
    assert starts(spec, "velocity")["index_2"] == (2.0,)


def test_an_orientation_means_balls_and_a_number_does_not(make):
    found = starts(make({"positions": {"e*": {"rpy": [0, 0, "90 deg"]}, "ind*": "10 deg"}}))
    assert found["eye"] == pytest.approx((0.5**0.5, 0, 0, 0.5**0.5))
    assert found["index_0"] == pytest.approx((0.17453292519943295,))


def test_patterns_leave_followers_out(make):
    found = starts(make({"positions": {"index_*": 0.2}}, constraints=FOLLOW))
    assert (found["index_0"], found["index_2"]) == ((0.2,), (0.4,)), "where its leader wants it"
    assert starts(make({"positions": {"index_*": 0.2}}))["index_2"] == (0.2,), "where it follows none"
    tip = {"tip": {"follow": {"joint": "hand/index_2", "leader": "hand/index_0", "ratio": 2}}}
    data = hand({"use": "hand.yaml", "positions": {"index_*": 0.2}}, constraints=tip)
    assert starts(Spec.from_data(data))["index_2"] == (0.4,)


def test_equal_patterns_agree(make):
    assert starts(make({"positions": {"index_*": 0.5, "*_1": 0.5}}))["index_1"] == (0.5,)


@pytest.mark.parametrize(
    ("said", "path", "message", "hint"),
    [
        ({"positions": {"ring_*": 0.5}}, "positions.ring_*", "no joint of the model that 'ring_*' could mean", None),
        ({"positions": {"ey*": 0.5}}, "positions.ey*", "no joint of the model", None),
        ({"positions": {"palm*": 0.5}}, "positions.palm*", "no joint of the model", None),
        ({"velocities": {"x*": 0.5}}, "velocities.x*", "no joint of the model", None),
        ({"positions": {"index_*": 0.5, "*_1": 0.6}}, "positions.*_1", "index_1 has two values: from '*_1'", "precedence"),
        ({"positions": {"*_0": 0.1}}, "positions.*_0", "beyond the joint's limits of thumb_0", None),
        ({"positions": {"*": 0.5}}, "positions.*", "hinges and slides", "separate patterns"),
        ({"positions": {"index_*": "1 mm"}}, "positions.index_*", "expected an angle", None),
        ({"positions": {"hand/index_0": 1}}, "positions.hand/index_0", "without the model's name", "'index_0'"),
        ({"positions": {"hand/index_*": 1}}, "positions.hand/index_*", "without the model's name", "'index_*'"),
        ({"positions": {"index 0": 1}}, "positions.index 0", "not a valid name or pattern", "'index_0'"),
        ({"positions": {"index0": 1}}, "positions.index0", "the model has no joint 'index0'", "'index_0'"),
        ({"positions": {f"*{'a' * k}": 1 for k in range(MOST_PATTERNS + 1)}}, "positions", "too many entries", None),
    ],
)  # fmt: skip
def test_wrong_tables_are_rejected(make, said, path, message, hint):
    problem = refused(make, said)
    assert problem.path == f"models.hand.{path}"
    assert message in problem.message
    assert hint is None or hint in (problem.hint or "")


def test_a_start_is_located_at_its_pattern(make, tmp_path):
    make()
    (tmp_path / "scene.yaml").write_text(
        "simspec: 1\nname: scene\nphysics: {duration: 0.1}\nmodels:\n  hand:\n    use: hand.yaml\n    fixed: true\n"
        "    positions:\n      index_1: 0.1\n      'index_*': 400 deg\n"
    )
    from simspec.language.load import load

    spec = load(tmp_path / "scene.yaml")
    assert spec.locate("bodies.hand/a.joint.position").line == 10
    assert spec.locate("bodies.hand/b.joint.position").line == 9


def test_a_bare_angle_of_many_turns_is_warned_of_at_its_pattern(make):
    (warning,) = [
        warning for warning in make({"positions": {"index_*": 90}}).warnings() if "without a unit" in warning.message
    ]
    assert warning.path == "models.hand.positions.index_*"


def test_an_override_may_be_a_pattern_or_precede_a_pattern(make, tmp_path):
    from simspec.language.load import load

    make()
    (tmp_path / "scene.yaml").write_text(
        "simspec: 1\nname: scene\nphysics: {duration: 0.1}\nmodels:\n"
        "  hand: {use: hand.yaml, fixed: true, positions: {'index_*': 0.5}}\n"
        "control: {drive: {joints: ['hand/index_*'], kp: {'*': 40}, kd: 1}}\n"
    )
    sets = (
        "models.hand.positions.index_0=0.6",
        "models.hand.positions.thumb_*=0.4",
        "control.drive.kp.hand/index_1=45",
    )
    world = load(tmp_path / "scene.yaml", sets=sets).resolve()
    found = {body.joint.name: body.joint.position for body in world.bodies}
    assert (found["hand/index_0"], found["hand/index_1"], found["hand/thumb_0"]) == ((0.6,), (0.5,), (0.4,))
    assert dict(zip(world.controllers[0].joints, world.controllers[0].kp, strict=True))["hand/index_1"] == 45.0
    assert sorted(world.controllers[0].kp) == [40.0, 40.0, 45.0]


def actuated(commands, **state):
    actuators = {f"m{k}": {"joint": f"index_{k}", "law": "effort"} for k in range(3)}
    data = hand({"use": "hand.yaml", "actuators": actuators, **state})
    data["control"] = {"all": {"actuators": ["hand/*"], **({"commands": commands} if commands else {})}}
    return data


def test_commands_of_actuators_take_patterns(make):
    make()
    world = Spec.from_data(actuated({"hand/m*": 3, "hand/m1": 4})).resolve()
    efforts = dict(zip(world.trajectory.joints, world.trajectory.efforts[0], strict=True))
    assert efforts == {"hand/index_0": 3.0, "hand/index_1": 4.0, "hand/index_2": 3.0}
    state = {"states": {"pressed": {"commands": {"*": 2, "m0": 1}}}, "state": "pressed"}
    world = Spec.from_data(actuated(None, **state)).resolve()
    assert sorted(world.trajectory.efforts[0]) == [1.0, 2.0, 2.0]


@pytest.mark.parametrize(
    ("commands", "state", "path"),
    [
        ({"hand/x*": 1}, {}, "control.all.commands.hand/x*"),
        ({"hand/m*": 1, "*m1": 2}, {}, "control.all.commands.*m1"),
        ({f"{'*' * k}m1": 1 for k in range(1, MOST_PATTERNS + 2)}, {}, "control.all.commands"),
        (None, {"x*": 1}, "models.hand.states.pressed.commands.x*"),
        (None, {"m*": 1, "*1": 2}, "models.hand.states.pressed.commands.*1"),
        (None, {"hand/m1": 1}, "models.hand.states.pressed.commands.hand/m1"),
    ],
)
def test_commands_that_mean_nothing_or_two_things(make, commands, state, path):
    make()
    said = {"states": {"pressed": {"commands": state}}, "state": "pressed"} if state else {}
    problem = refused(lambda: Spec.from_data(actuated(commands, **said)))
    assert problem.path == path


ENTRIES = st.dictionaries(st.text("ab*", min_size=1, max_size=4), st.integers(0, 2), max_size=6)


@given(ENTRIES, st.lists(st.text("ab", min_size=1, max_size=4), max_size=8, unique=True))
def test_an_exact_name_precedes_patterns_and_contradictory_patterns_are_an_error(entries, names):
    found, clashes = entry_of(entries, lambda entry: [name for name in names if matches(entry, name)])
    for name in names:
        fitting = [entry for entry in entries if matches(entry, name)]
        values = {entries[entry] for entry in fitting}
        assert (name in found) == bool(fitting)
        if name in entries:
            assert found[name] == name
        elif fitting:
            assert found[name] in fitting
        assert (name in {clash.name for clash in clashes}) == (name not in entries and len(values) > 1)


# --- points of a trajectory -------------------------------------------------------------------------------------------

CONTROL = {"hand": {"law": "pd", "joints": ["hand/index_0", "hand/index_1", "hand/thumb_0"], "kp": 4, "kd": 0.1}}
WITHIN = {"positions": {"thumb_0": 0.3}}


def moved(make, *points, **more):
    points = [{"at": index, "positions": positions} for index, positions in enumerate(points)]
    return make(WITHIN, control=CONTROL, trajectory={"interpolation": "linear", "points": points}, **more)


def test_points_of_a_trajectory_take_patterns(make):
    """A pattern means driven joints alone: index_2 matches too, and no controller drives it."""
    path = moved(make, {"hand/index_*": "10 deg", "hand/thumb_0": 0.4}, {"hand/index_*": 0.2, "hand/thumb_0": 0.5})
    found = path.resolve().trajectory
    columns = dict(zip(found.joints, zip(*found.positions, strict=True), strict=True))
    ten = pytest.approx((0.17453292519943295, 0.2))
    assert columns == {"hand/index_0": ten, "hand/index_1": ten, "hand/thumb_0": (0.4, 0.5)}


def test_the_world_is_that_of_the_names(make):
    patterns = moved(make, {"*": 0.4, "hand/index_1": 0.1}, {"*": 0.5, "hand/index_1": 0.2}).resolve()
    names = [
        {"hand/index_0": 0.4, "hand/index_1": 0.1, "hand/thumb_0": 0.4},
        {"hand/index_0": 0.5, "hand/index_1": 0.2, "hand/thumb_0": 0.5},
    ]
    assert patterns == moved(make, *names).resolve()


def test_points_may_say_the_same_joints_differently(make):
    """The whole hand at first, then finger by finger."""
    mixed = moved(
        make, {"*": 0.4}, {"hand/index_*": 0.1, "hand/thumb_0": 0.5}, {"*": 0.4, "hand/index_0": 0.2}
    ).resolve()
    names = [
        {"hand/index_0": index, "hand/index_1": other, "hand/thumb_0": thumb}
        for index, other, thumb in ((0.4, 0.4, 0.4), (0.1, 0.1, 0.5), (0.2, 0.4, 0.4))
    ]
    assert mixed == moved(make, *names).resolve()


@pytest.mark.parametrize(
    ("points", "words"),
    [
        ([{"*": 0.4}, {"hand/index_*": 0.1}], ["not the joints of the first point", "differs in hand/thumb_0"]),
        ([{"*": 0.4}, {"hand/index_*": 0.1, "hand/no": 1, "hand/thumb_0": 1}], ["differs in hand/no"]),
        ([{"*": 0.4}, {"*": 0.1, "hand/no*": 1}], ["no driven joint that 'hand/no*' could mean"]),
        ([{"hand/eye*": 0.1}], ["no driven joint that 'hand/eye*' could mean", "hand/index_0"]),
        ([{"hand/*_2": 0.1}], ["no driven joint that 'hand/*_2' could mean"]),
        ([{"*index*": 0.1, "*_1": 0.1}, {"*index*": 0.1, "*_1": 0.2}], ["hand/index_1 has two values"]),
        ([{"hand/index_*": 0.1}, {"hand/index_0": 0.1}], ["not the joints of the first point"]),
        ([{"hand/index_*/x": 0.1}], ["not a valid name or pattern"]),
        ([{"*": 0.1}], ["hand/thumb_0 exceeds its limits"]),
    ],
)
def test_points_that_no_joint_can_follow(make, points, words):
    text = str(refused(moved, make, *points))
    for word in words:
        assert word in text
