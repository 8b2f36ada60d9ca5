"""The key of a cell changes exactly when what is run could change."""

from __future__ import annotations

import copy

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simspec.errors import SpecError
from simspec.experiments.after_sweep import older_sweeps
from simspec.experiments.cases import case_of
from simspec.experiments.plan import plan_sweep
from simspec.language.load import Spec, load
from simspec.stored import StudyModels
from tests.experiments.swept import SWEEP, VERSIONS, data


def keys(plain, engines=("mujoco",), versions=VERSIONS):
    return [cell.key for cell in plan_sweep(Spec.from_data(plain), engines=engines, versions=versions)]


PLAIN = keys(data())

names = st.from_regex(r"[a-z][a-z0-9_]{0,8}", fullmatch=True)
wholes = st.integers(1, 50)
NO_RUN_DEPENDS_ON: dict[str, st.SearchStrategy] = {
    "name": names,
    "description": st.text("abc ", max_size=9),
    "expect": st.sampled_from([[], [{"stays_within": {"body": "ball", "lower": [-9, -9, -9], "upper": [9, 9, 9]}}]]),
    "sweep": st.fixed_dictionaries({"repeat": st.just(1), "only_cases": st.just(False)}),
    "dart": st.fixed_dictionaries({"settings": st.fixed_dictionaries({"iterations": wholes})}),
    "pybullet": st.fixed_dictionaries({"accept": st.just(["contact.cone.elliptic"])}),
    "show": st.sampled_from([[], ["ball"], ["ball", "rod"]]),
}


@settings(max_examples=60, deadline=None)
@given(st.fixed_dictionaries({}, optional=NO_RUN_DEPENDS_ON))
def test_changes_without_effect_on_runs_leave_keys_unchanged(parts):
    changed = data()
    for name, value in parts.items():
        if name in ("dart", "pybullet"):
            changed["engines"][name] = value
        elif name == "show":
            changed["record"]["show"] = value
        else:
            changed[name] = value
    assert keys(changed) == PLAIN


def _set(path, value):
    """A change of the scenario's data at a path."""

    def change(plain):
        holder = plain
        *steps, last = path
        for step in steps:
            holder = holder.setdefault(step, {}) if isinstance(holder, dict) else holder[step]
        holder[last] = value

    return change


masses = st.floats(0.5, 50, allow_nan=False)
RUNS_DEPEND_ON = (
    st.builds(lambda v: _set(("bodies", "rod", "mass"), v), masses)
    | st.builds(lambda v: _set(("bodies", "ball", "mass"), v + 1), masses)
    | st.builds(lambda v: _set(("bodies", "ball", "pose", "xyz"), [1, v, 1]), masses)
    | st.builds(lambda n, v: _set(("bodies", f"new_{n}"), {"fixed": v}), names, st.just(True))
    | st.builds(lambda v: _set(("bodies", "rod", "joint", "damping"), v), masses)
    | st.builds(lambda v: _set(("physics", "gravity", 2), -v), masses)
    | st.builds(lambda v: _set(("physics", "duration"), f"{20 * v + 20} ms"), wholes)
    | st.builds(lambda v: _set(("record", "every"), f"{v} ms"), st.sampled_from([1, 2, 5, 20]))
    | st.builds(lambda v: _set(("record", "channels"), v), st.sampled_from([["pose"], ["pose", "energy"]]))
    | st.builds(lambda v: _set(("engines", "mujoco", "settings", "iterations"), v + 50), wholes)
    | st.builds(lambda v: _set(("engines", "mujoco", "settings", "impratio"), v), masses)
    | st.builds(lambda v: _set(("engines", "mujoco", "accept"), [v]), st.just("joint.limits.position"))
    | st.builds(
        lambda v: _set(("engines", "mujoco", "at_timestep"), [{"above": "2 ms", "settings": {"iterations": v}}]), wholes
    )
    | st.builds(lambda v: _set(("contact", "materials"), {"m": {"friction": v}}), masses)
)


@settings(max_examples=120, deadline=None)
@given(RUNS_DEPEND_ON)
def test_anything_else_changes_keys(change):
    changed = data()
    change(changed)
    assert set(keys(changed)).isdisjoint(PLAIN)


def test_the_order_of_bodies_is_that_of_the_world():
    turned = data()
    turned["bodies"] = dict(reversed(turned["bodies"].items()))
    assert keys(turned) != PLAIN


def test_versions_the_engine_and_its_label_change_keys():
    newer = {**VERSIONS, "mujoco": {**VERSIONS["mujoco"], "engine_version": "2"}}
    more = {**VERSIONS, "mujoco": {**VERSIONS["mujoco"], "numpy_version": "2"}}
    turned = {**VERSIONS, "mujoco": dict(reversed(VERSIONS["mujoco"].items()))}
    every = [keys(data(), versions=entry) for entry in (newer, more)] + [
        keys(data(), [name]) for name in ("dart", "mujoco@3.8")
    ]
    assert len({entry for found in every for entry in found} | set(PLAIN)) == 5
    assert keys(data(), versions=turned) == PLAIN


def test_parts_of_a_sweep_that_are_not_there_change_no_key():
    """A sweep that grows keeps the keys of the cells that it had."""
    small = keys(data(sweep={"over": {"bodies.rod.mass": [1, 2]}}))
    grown = keys(
        data(sweep={"over": {"bodies.rod.mass": [1, 3, 2]}, "perturb": {"amount": 1e-9, "seeds": 2}, "repeat": 2})
    )
    cases = keys(data(sweep={"cases": {"light": {"bodies.rod.mass": 1}, "heavy": {"bodies.rod.mass": 2}}}))
    assert set(small) < set(grown)
    assert set(cases) == {*PLAIN, *small}, "the name of a case is no part of what is run"


def test_the_order_in_which_values_are_put_in_changes_no_key():
    over = {"bodies.rod.mass": [1, 2], "bodies.ball.mass": [3]}
    turned = dict(reversed(over.items()))
    assert set(keys(data(sweep={"over": over}))) == set(keys(data(sweep={"over": turned})))


def test_values_of_other_engines_and_of_no_run_change_no_key():
    sweep = {
        "over": {"bodies.rod.mass": [1, 2], "engines.dart.settings.iterations": [10, 20]},
        "together": [{"expect.0.position.tolerance": [0.1, 0.2, 0.3]}],
    }
    mujoco = keys(data(sweep=sweep))
    assert (len(mujoco), len(set(mujoco))) == (12, 2)
    dart = keys(data(sweep=sweep), ["dart"])
    assert (len(dart), len(set(dart))) == (12, 4)


paths = st.sampled_from(
    ["bodies.rod.mass", "bodies.ball.mass", "bodies.rod.joint.damping", "engines.dart.settings.iterations"]
)
grids = st.dictionaries(paths, st.lists(st.integers(1, 4), min_size=1, max_size=3, unique=True), min_size=1, max_size=3)


@settings(max_examples=25, deadline=None)
@given(grids, st.sampled_from(["mujoco", "dart"]))
def test_equal_keys_are_equal_cases(grid, engine):
    """Cells of one key have one case: a store that skips by the key of a cell skips nothing that is not there."""
    plan = plan_sweep(Spec.from_data(data(sweep={"over": grid})), engines=[engine], versions=VERSIONS)
    by_key: dict[str, set[str]] = {}
    by_case: dict[str, set[str]] = {}
    for cell in plan:
        case = case_of(plan, cell).key(VERSIONS[engine])
        by_key.setdefault(cell.key, set()).add(case)
        by_case.setdefault(case, set()).add(cell.key)
    assert all(len(cases) == 1 for cases in by_key.values())
    assert all(len(found) == 1 for found in by_case.values()), "of these values no two mean the same"


MODEL = """\
simspec: 1
name: link
model:
  bodies:
    link: {mass: 1, inertia: {principal: [1, 1, 1]}}
"""


@pytest.fixture
def folder(tmp_path):
    scenario = {"simspec": 1, "name": "s", "physics": {"duration": "10 ms"}, "models": {"a": {"use": "link.yaml"}}}
    (tmp_path / "link.yaml").write_text(MODEL, encoding="utf-8")
    (tmp_path / "heavy.yaml").write_text(MODEL.replace("mass: 1", "mass: 2"), encoding="utf-8")
    (tmp_path / "again.yaml").write_text(
        "# another comment\n" + MODEL.replace("name: link", "name: other"), encoding="utf-8"
    )
    return tmp_path, scenario


def of_folder(folder, scenario):
    plan = plan_sweep(Spec.from_data(scenario, folder=folder), engines=["dart"], versions=VERSIONS)
    return [cell.key for cell in plan]


def test_model_files_count_by_content(folder):
    place, scenario = folder
    before = of_folder(place, scenario)
    (place / "link.yaml").write_text((place / "again.yaml").read_text(encoding="utf-8"), encoding="utf-8")
    assert of_folder(place, scenario) == before, "a comment and a model's own name"
    (place / "link.yaml").write_text(MODEL.replace("[1, 1, 1]", "[1, 1, 1.5]"), encoding="utf-8")
    assert of_folder(place, scenario) != before


def test_files_that_a_sweep_names_count_by_content(folder):
    place, scenario = folder
    swept = {**scenario, "sweep": {"over": {"models.a.use": ["link.yaml", "heavy.yaml"]}}}
    first, second = of_folder(place, swept)
    (place / "heavy.yaml").write_text(MODEL.replace("mass: 1", "mass: 3"), encoding="utf-8")
    again = of_folder(place, swept)
    assert again[0] == first
    assert again[1] != second
    whole = {**scenario, "sweep": {"over": {"models.a": [{"use": "link.yaml"}, {"use": "heavy.yaml"}]}}}
    before = of_folder(place, whole)
    (place / "heavy.yaml").write_text(MODEL.replace("mass: 1", "mass: 4"), encoding="utf-8")
    assert [entry == two for entry, two in zip(before, of_folder(place, whole), strict=True)] == [True, False]


def test_a_file_that_is_not_there_is_a_problem_of_its_cells(folder):
    place, scenario = folder
    swept = {**scenario, "sweep": {"over": {"models.a.use": ["link.yaml", "nothing.yaml", "../../secret.yaml"]}}}
    plan = plan_sweep(Spec.from_data(swept, folder=place), engines=["dart"], versions=VERSIONS)
    first, second, third = plan
    case_of(plan, first)
    with pytest.raises(SpecError, match="no such file"):
        case_of(plan, second)
    with pytest.raises(SpecError, match="leaves the project folder"):
        case_of(plan, third)


def test_a_model_file_that_changes_meanwhile_is_that_of_the_plan(folder):
    place, scenario = folder
    path = place / "s.yaml"
    swept = {**scenario, "sweep": {"over": {"physics.gravity": [[0, 0, -1], [0, 0, -2]]}}}
    path.write_text(Spec.from_data(swept, folder=place).to_yaml(), encoding="utf-8")
    plan = plan_sweep(load(path), engines=["dart"], versions=VERSIONS)
    (place / "link.yaml").write_text(MODEL.replace("mass: 1", "mass: 9"), encoding="utf-8")
    cases = [case_of(plan, cell) for cell in plan]
    assert [case.world.physics.gravity[2] for case in cases] == [-1.0, -2.0]
    assert [case.world.bodies[0].inertial.mass for case in cases] == [1.0, 1.0]


def test_all_cells_of_a_sweep_have_different_keys():
    swept = keys(copy.deepcopy(data(sweep=SWEEP)), ("mujoco", "dart"))
    assert len(set(swept)) == len(swept)


def test_figures_of_a_study_are_older_where_its_request_or_its_sweeps_changed():
    sweeps = {name: {"asked": "before", "models": []} for name in ("same", "more", "gone")}
    content = {"schema": 1, "source": "s.yaml", "small": False, "study_sha256": "0" * 64, "sweeps": sweeps}
    now = {"same": sweeps["same"], "more": {"asked": "after", "models": []}, "new": sweeps["same"]}
    given = older_sweeps(StudyModels.model_validate(content), now)
    assert given.pop("more").startswith("the study requests something else")
    assert given == {"gone": "the study has no such sweep any more", "new": "the sweep was not measured"}
