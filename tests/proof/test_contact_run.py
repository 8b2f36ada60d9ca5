"""Level L5: figures measured of the files of a scenario, figures from the cache, and engines that fail."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from simspec.compiler import compile_world, write_folder
from simspec.dialects.kit.defects import NAMES
from simspec.engines.kit.capabilities import Deviation
from simspec.engines.kit.process import Reply
from simspec.engines.kit.registry import find_engine
from simspec.errors import EngineError, Problem, UnsupportedError
from simspec.outputs.writing import Artifacts
from simspec.proof.certificate import Certificate, EngineProof
from simspec.proof.contact import run, scope, size, stacks
from simspec.proof.contact.probe import ProbeFigure, ProbeLaw
from simspec.proof.selftest import defects_of
from simspec.proof.selftest_worlds import WORLDS
from simspec.proof.verify import verify
from simspec.support.features import Feature
from simspec.world.types import Hardness, PairContact
from tests import worlds
from tests.caches import cache_home
from tests.declared import with_the_cone
from tests.installed import JOINTED
from tests.nightly import NIGHTLY

pytestmark = pytest.mark.usefixtures("warm_engines")

ENGINES = with_the_cone(Feature.RESTITUTION)
QUICK = ("mujoco", "ode")
"""In which every probe takes ten seconds; in the others every commit measures the laws of other tests."""
SAID_TWICE = ("ode", "physx", "rapier")
"""For engines with the cone in the sidecar too, files that contradict each other are rejected."""
PAIRS = {("ice", "ice"): 0.1, ("ice", "rubber"): 0.3, ("rubber", "rubber"): 0.2}
DEADLINE = 120.0
ASIDE = {"pybullet": ("push-oblong", "stop-oblong"), "mujoco": ("oblique",), "rapier": ("push-oblong", "stop-oblong")}
"""Probes in which an engine declares a deviation under the elliptic cone, at 1 ms and μ up to 0.3, without restitution."""

PROBES = (
    "push",
    "push-oblong",
    "stop",
    "stop-oblong",
    "stick",
    "restitution",
    "rest",
    "steady",
    "overlap",
    "oblique",
    "oblique-separation",
)
"""Of figures of a pair with friction and without restitution."""


@pytest.fixture(autouse=True)
def empty_cache(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", cache_home(tmp_path))


sampled = run._sampled
"""Which of the cached figures are measured again."""


@pytest.fixture
def few_probes(monkeypatch):
    """The push alone: one short trial for each pair; and nothing that the cache knows is measured again."""
    monkeypatch.setattr(run, "_sampled", list)
    monkeypatch.setattr(run, "PROBES", {"push": run.PROBES["push"]})
    monkeypatch.setattr(size, "size_trial", lambda world: None)


def installed(engine):
    if find_engine(engine).version() is None:
        pytest.skip(f"{engine} is not installed")
    return engine


def files(world, engine, folder):
    write_folder(compile_world(world, [engine])[engine].files, folder)
    return folder


def measured(world, engine, folder, use_cache=True, python=None, deadline=DEADLINE):
    with run.measure(world, engine, folder, python, deadline, use_cache) as measuring:
        return measuring.wait()[0]


def wrong(figures):
    """Probe and subject of every figure that fails."""
    return {(figure.probe, figure.subject) for figure in figures if not figure.passed}


# --- what is measured ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("engine", [pytest.param(name, marks=() if name in QUICK else NIGHTLY) for name in ENGINES])
def test_every_pair_is_measured_by_every_probe_that_applies(engine, tmp_path):
    world = worlds.table(PAIRS)
    found = measured(world, installed(engine), files(world, engine, tmp_path / engine))
    assert wrong(found) == set()
    subjects = {", ".join(pair) for pair in PAIRS}
    for probe in PROBES:
        assert {figure.subject for figure in found if figure.probe == probe} == subjects
    # bodies slide with spin wherever there is friction; other coupled probes depend on the contacts that the world can have
    coupled = {name for law in run.laws(world) for name, probe in run.COUPLED.items() if probe.applies(law)}
    endings = ("-slips", "-energy", "-sideways", "-plane")
    there = {functools.reduce(str.removesuffix, endings, figure.probe) for figure in found}
    slid = {"stack-stays"} if stacks.SlidingStack.NAME in coupled else set()
    assert there == {*PROBES, *coupled, *slid, "size"}
    for probe, drawn in (("push", 0), ("push-oblong", 24)):
        push = {figure.subject: figure for figure in found if figure.probe == probe}
        for (first, second), friction in PAIRS.items():
            entry = push[f"{first}, {second}"]
            assert entry.expected == pytest.approx(friction)
            assert len(entry.points) == drawn
    # an oblong slider is where an engine says that its friction is not against the slip, an impact where most of it is missing
    alone = {figure.probe for figure in found if figure.deviation and figure.probe in PROBES}
    assert alone - {"overlap"} == set(ASIDE.get(engine, ()))
    checks = run.contact_checks(found)
    assert all(check.level == "L5" and check.passed and check.worst <= 1.0 for check in checks)
    assert sum(check.count for check in checks) == len(found)


@pytest.mark.parametrize("engine", ENGINES)
def test_the_content_of_the_files_is_measured_and_not_the_world(engine, tmp_path, few_probes):
    """Half the friction of one pair, in files that stand for the whole world."""
    world = worlds.table(PAIRS)
    halved = worlds.table({**PAIRS, ("rubber", "rubber"): 0.1})
    found = measured(world, installed(engine), files(halved, engine, tmp_path / engine))
    assert wrong(found) == {("push", "rubber, rubber")}
    (figure,) = (figure for figure in found if not figure.passed)
    assert figure.measured == pytest.approx(0.1, rel=0.02)
    (check,) = run.contact_checks(found)
    assert not check.passed
    assert check.worst == pytest.approx(0.1 / figure.tolerance, rel=0.05)
    assert check.where == "rubber, rubber"


@pytest.mark.parametrize(
    ("defect", "probe"),
    [
        ("pair value", "push"),
        ("cone", "push"),
        ("hardness", "overlap, push"),
        ("torsional friction", "torsional"),
        ("rolling friction", "rolling"),
    ],
)
@pytest.mark.parametrize("engine", ENGINES)
def test_planted_defects_are_measured(engine, defect, probe, tmp_path, monkeypatch):
    monkeypatch.setattr(run, "PROBES", {name: run.PROBES[name] for name in probe.split(", ")})
    monkeypatch.setattr(size, "size_trial", lambda world: None)
    world = WORLDS[NAMES[defect]](installed(engine))
    plant = defects_of(find_engine(engine).DIALECT)[defect]
    if isinstance(plant, str):  # files of this format cannot hold the defect, and say why
        assert plant
        return
    refused: tuple[Problem, ...] = ()
    try:
        sound = compile_world(world, [engine])[engine].files
    except UnsupportedError as error:  # a gap: refused by the name of the feature
        refused = tuple(error.problems)
    if refused:
        assert any(problem.message.startswith(f"{find_engine(engine).TITLE} does not support") for problem in refused)
        return
    write_folder(sound, tmp_path / "sound")
    write_folder(plant(sound), tmp_path / "planted")
    assert wrong(measured(world, engine, tmp_path / "sound")) == set()
    if defect == "cone" and engine in SAID_TWICE:
        with pytest.raises(ValueError, match=r"friction cone of world\.json is not the sidecar's"):
            measured(world, engine, tmp_path / "planted")
        return
    assert wrong(measured(world, engine, tmp_path / "planted"))


@pytest.mark.parametrize("engine", ENGINES)
def test_a_restitution_that_is_not_there_is_measured(engine, tmp_path, monkeypatch):
    monkeypatch.setattr(run, "PROBES", {"restitution": run.PROBES["restitution"]})
    monkeypatch.setattr(size, "size_trial", lambda world: None)
    world = WORLDS["bouncing"](installed(engine))
    pairs = tuple(dataclasses.replace(pair, restitution=0.3) for pair in world.contact.pairs)
    dull = dataclasses.replace(world, contact=dataclasses.replace(world.contact, pairs=pairs))
    assert wrong(measured(world, engine, files(world, engine, tmp_path / "sound"))) == set()
    found = measured(world, engine, files(dull, engine, tmp_path / "dull"))
    assert all(figure.measured == pytest.approx(0.3, abs=0.05) for figure in found)
    assert wrong(found) == {("restitution", "rubber, rubber")}


@pytest.mark.parametrize("engine", ENGINES)
def test_probes_take_the_steps_of_the_files(engine, tmp_path, few_probes):
    world = worlds.ball_with_law()
    slow = dataclasses.replace(world, physics=dataclasses.replace(world.physics, timestep=0.004))
    place = files(slow, installed(engine), tmp_path / engine)
    with run.measure(world, engine, place, None, DEADLINE, False) as measuring:
        (operation,) = measuring.operations
        assert operation.parameters["timestep"] == 0.004


def test_l5_is_part_of_a_certificate_and_survives_its_json(tmp_path, few_probes):
    engine = installed(ENGINES[0])
    world = worlds.table(PAIRS)
    place = files(worlds.table({**PAIRS, ("ice", "ice"): 0.3}), engine, tmp_path / engine)
    found = verify(world, [engine], artifacts={engine: place})
    proof = found.engines[engine]
    assert [(check.name, check.passed) for check in proof.level("L5")] == [("push, in tolerances", False)]
    assert {figure.subject for figure in proof.contact} == {", ".join(pair) for pair in PAIRS}
    assert Certificate.from_json(found.to_json()) == found
    assert "L5" not in {check.level for check in verify(world, [engine], levels=["L1"]).engines[engine].checks}


def test_a_figure_without_a_number_survives_json():
    figure = ProbeFigure("push", "a, b", "crashed", "", "", 0.0, None, 0.0)
    (check,) = run.contact_checks([figure])
    assert not check.passed
    assert "crashed" in check.detail
    proof = EngineProof("1", "abc", (check,), contact=(figure,))
    found = Certificate("x", "", "", {"engine": proof})
    assert Certificate.from_json(found.to_json()) == found


@pytest.mark.parametrize("engine", sorted(set(ENGINES) & set(JOINTED)))
def test_a_world_without_contact_has_no_contact_checks(engine):
    found = verify(worlds.damped_springs(), [installed(engine)])
    assert found.valid
    assert found.engines[engine].level("L5") == []


# --- declared deviations ------------------------------------------------------------------------------------------


def deviating(figure, *declared, **pair):
    law = ProbeLaw(PairContact("a", "b", **({"friction": 0.5, "restitution": 0.2} | pair)), "elliptic", 0.002)
    return run.deviating(figure, law, SimpleNamespace(CONTACT_DEVIATIONS=declared), {"solver": "fast"})


FIGURE = ProbeFigure("push", "a, b", "", "friction", "", 0.5, 0.45, 0.005)


@pytest.mark.parametrize(
    ("declared", "counts"),
    [
        (Deviation("push", 0.12, "hops"), True),
        (Deviation("push", 0.06, "hops", relative=False), True),
        (Deviation("push", 0.08, "too small"), False),
        (Deviation("stop", 0.12, "of another probe"), False),
        (Deviation("push", 0.12, "larger friction", friction=0.6), False),
        (Deviation("push", 0.12, "larger steps", timestep=0.003), False),
        (Deviation("push", 0.12, "these", friction=0.5, timestep=0.002, restitution=0.2), True),
        (Deviation("push", 0.12, "livelier", restitution=0.3), False),
        (Deviation("push", 0.12, "pyramid", friction_cone="pyramid-inscribed"), False),
        (Deviation("push", 0.12, "cone", friction_cone="elliptic"), True),
        (Deviation("push", 0.12, "soft", hardness="native"), False),
        (Deviation("push", 0.12, "hard", hardness="common"), True),
        (Deviation("push", 0.12, "solver", setting=("solver", "fast")), True),
        (Deviation("push", 0.12, "other solver", setting=("solver", "exact")), False),
    ],
)
def test_a_declared_deviation_counts_where_it_says(declared, counts):
    found = deviating(FIGURE, declared)
    assert found.passed is counts
    assert found.measured == FIGURE.measured
    if declared.why != "too small":
        assert found.deviation == (declared.why if counts else "")


def test_the_largest_declared_deviation_counts():
    small, large = Deviation("push", 0.11, "small"), Deviation("push", 0.3, "large")
    found = deviating(FIGURE, small, large, Deviation("push", 0.2, "middle"))
    assert (found.deviation, found.tolerance) == ("large", pytest.approx(0.15))


def test_figures_within_tolerance_need_no_deviation():
    fine = dataclasses.replace(FIGURE, measured=0.501)
    assert deviating(fine, Deviation("push", 0.3, "hops")) == fine


# --- the cache ----------------------------------------------------------------------------------------------------


class Replayed:
    """A process that replays the answers to an equal request."""

    def __init__(self, reply):
        self.reply = reply

    def wait(self, doing=None):
        return self.reply


REPLIES: dict[str, Reply] = {}
"""Answers of engine processes in this module, by their whole request."""


def whole_request(engine, operations) -> str:
    """Engine, operations and artifacts, as words. Where artifacts are is not a part of it."""
    said = [engine]
    for operation in operations:
        parameters = dict(operation.parameters)
        folder = Path(parameters.pop("artifacts"))
        said += [operation.op, repr(parameters), Artifacts.read(folder).sha256]
        said += [f"{name} {value.shape} {value.tobytes().hex()}" for name, value in sorted(operation.arrays.items())]
    return "\n".join(said)


def processes(monkeypatch):
    """The number of operations of each engine process that is requested from here on. Equal earlier requests with the same
    files are replayed: the test counts the requests."""
    started = []

    @contextlib.contextmanager
    def counting(engine, artifacts, operations, **more):
        started.append(len(operations))
        text = whole_request(engine, operations)
        if text in REPLIES:
            yield Replayed(REPLIES[text])
            return
        with original(engine, artifacts, operations, **more) as running:
            REPLIES[text] = running.wait()
            yield Replayed(REPLIES[text])

    original = run.start
    monkeypatch.setattr(run, "start", counting)
    return started


def test_cached_figures_are_not_measured_again(tmp_path, few_probes, monkeypatch):
    engine = installed(ENGINES[0])
    world = worlds.table(PAIRS)
    place = files(world, engine, tmp_path / engine)
    started = processes(monkeypatch)
    first = measured(world, engine, place)
    assert started == [3]
    assert measured(world, engine, place) == first
    assert started == [3]
    measured(world, engine, place, use_cache=False)
    assert started == [3, 3]


def test_for_a_new_material_only_its_pairs_are_measured(tmp_path, few_probes, monkeypatch):
    engine = installed(ENGINES[0])
    small = worlds.table(dict.fromkeys(PAIRS, 0.3))
    large = worlds.table(dict.fromkeys([*PAIRS, ("ice", "steel"), ("rubber", "steel"), ("steel", "steel")], 0.3))
    started = processes(monkeypatch)
    measured(small, engine, files(small, engine, tmp_path / "small"))
    found = measured(large, engine, files(large, engine, tmp_path / "large"))
    assert started == [3, 3]
    assert len(found) == 6


@pytest.mark.parametrize("change", ["friction", "cone", "timestep", "setting", "version", "code"])
def test_changes_that_affect_a_figure_are_measured_again(change, tmp_path, few_probes, monkeypatch):
    engine = installed("dart")
    world = worlds.ball_with_law()
    other = {
        "friction": lambda: worlds.ball_with_law(friction=0.4),
        "cone": lambda: dataclasses.replace(
            world, contact=dataclasses.replace(world.contact, friction_cone="pyramid-circumscribed")
        ),
        "timestep": lambda: dataclasses.replace(world, physics=dataclasses.replace(world.physics, timestep=0.002)),
        "setting": lambda: worlds.with_options(world, engine, settings=(("iterations", 123),)),
    }.get(change, lambda: world)()
    started = processes(monkeypatch)
    measured(world, engine, files(world, engine, tmp_path / "one"))
    if change == "version":
        monkeypatch.setattr(find_engine(engine), "version", classmethod(lambda kind: "0.0"))
    if change == "code":
        monkeypatch.setattr(scope, "code_digest", lambda: "other code")
    measured(other, engine, files(other, engine, tmp_path / "other"))
    assert started == [1, 1]


def edited(entry: dict, **more) -> str:
    return json.dumps(entry | more)


DAMAGE = {
    "empty": lambda entry: "",
    "truncated": lambda entry: json.dumps(entry)[:200],
    "nothing in it": lambda entry: json.dumps({"simspec_cache": 1}),
    "a figure edited": lambda entry: edited(entry, figures=[entry["figures"][0] | {"measured": 0.123}]),
    "a tolerance edited": lambda entry: edited(entry, figures=[entry["figures"][0] | {"tolerance": 1e9}]),
    "not a number": lambda entry: edited(entry, figures=[entry["figures"][0] | {"measured": float("nan")}]),
    "another entry's": lambda entry: edited(entry, key="0" * 64),
    "another version": lambda entry: edited(entry, simspec_cache=2),
    "no figures": lambda entry: edited(entry, figures=[], sha256=scope._content([])),
    "deep": lambda entry: '{"simspec_cache": ' + "[" * 100_000,
}


@pytest.mark.parametrize("damage", DAMAGE)
def test_a_damaged_entry_is_measured_again(damage, tmp_path, few_probes, monkeypatch):
    engine = installed(ENGINES[0])
    world = worlds.ball_with_law()
    place = files(world, engine, tmp_path / engine)
    started = processes(monkeypatch)
    first = measured(world, engine, place)
    (entry,) = scope.ENTRIES.folder().iterdir()
    entry.write_text(DAMAGE[damage](json.loads(entry.read_text())))
    assert measured(world, engine, place) == first
    assert started == [1, 1]
    assert measured(world, engine, place) == first
    assert started == [1, 1]


@pytest.mark.parametrize("text", ["[1]", '[{"probe": "push"}]', "mine"])
def test_files_that_are_no_cache_entries_are_unchanged(text, tmp_path, few_probes, monkeypatch):
    engine = installed(ENGINES[0])
    world = worlds.ball_with_law()
    place = files(world, engine, tmp_path / engine)
    started = processes(monkeypatch)
    first = measured(world, engine, place)
    (entry,) = scope.ENTRIES.folder().iterdir()
    entry.write_text(text)
    assert measured(world, engine, place) == first
    assert started == [1, 1]
    assert entry.read_text() == text


def test_the_key_is_of_all_code_and_of_the_processor(monkeypatch):
    engine = find_engine(installed(ENGINES[0]))
    name = scope.key(engine, "x")
    for change in ("code_digest", "environment"):
        with monkeypatch.context() as patched:
            patched.setattr(scope, change, lambda: "other")
            assert scope.key(engine, "x") != name
    with monkeypatch.context() as patched:
        patched.setattr(scope, "engine_digest", lambda engine: "other code")
        assert scope.key(engine, "x") != name
    assert scope.key(engine, "x") == name
    environment = scope.environment()
    assert set(environment) == {"simspec", "numpy", "python", "platform", "processor"}


def test_a_single_cached_figure_is_measured_again(tmp_path, few_probes, monkeypatch):
    world = worlds.table(PAIRS)
    artifacts = files(world, ENGINES[0], tmp_path / "files")
    first = measured(world, installed(ENGINES[0]), artifacts)
    assert not any(figure.cached for figure in first)
    monkeypatch.setattr(run, "_sampled", sampled)
    again = measured(world, ENGINES[0], artifacts)
    assert [figure.cached for figure in again].count(False) == 1
    assert [figure.measured for figure in again] == pytest.approx([figure.measured for figure in first], rel=1e-4)
    proof = EngineProof("1", "0" * 64, (), contact=tuple(again))
    assert proof.declared.cached == len(PAIRS) - 1
    assert '"cached"' not in Certificate("w", "0" * 64, "o", {ENGINES[0]: proof}).to_json()


@pytest.mark.parametrize("edit", [{"measured": 0.1005}, {"expected": 0.2}, {"tolerance": 0.5}, {"without": 0.09}])
def test_a_poisoned_figure_of_the_cache_fails_when_it_is_measured_again(edit, tmp_path, few_probes, monkeypatch):
    world = worlds.table({("ice", "ice"): 0.1})
    artifacts = files(world, ENGINES[0], tmp_path / "files")
    (figure,) = measured(world, installed(ENGINES[0]), artifacts)
    monkeypatch.setattr(run, "_sampled", sampled)
    monkeypatch.setattr(scope, "read", lambda name: [dataclasses.replace(figure, **edit)])
    (differs,) = [entry for entry in measured(world, ENGINES[0], artifacts) if not entry.passed]
    assert "the cache has" in differs.case
    assert "--no-cache" in differs.case


def test_of_parts_that_are_as_far_off_any_may_be_the_worst():
    cached = ProbeFigure("stop", "ice, ice", "24 directions", "distance", "m", 0.08, 0.08001, 0.001, worst="75°")
    other = dataclasses.replace(cached, expected=0.06, measured=0.05999, tolerance=0.0008, worst="315°")
    assert scope.differing([cached], [other]) == []
    assert scope.differing([cached], [dataclasses.replace(other, measured=0.0602)])
    assert scope.differing([cached], [dataclasses.replace(other, worst=cached.worst)])


def test_a_cache_that_others_may_write_is_not_used(tmp_path, few_probes, monkeypatch):
    world = worlds.table({("ice", "ice"): 0.1})
    artifacts = files(world, ENGINES[0], tmp_path / "files")
    place = tmp_path / "shared"
    place.mkdir()
    place.chmod(0o777)
    monkeypatch.setenv("XDG_CACHE_HOME", str(place))
    with run.measure(world, installed(ENGINES[0]), artifacts, None, DEADLINE, True) as measuring:
        found, complaints = measuring.wait()
    assert not wrong(found)
    assert complaints == [f"the cache {place / 'simspec' / 'contact'} is not used: all users can write {place}"]
    assert not list(place.iterdir())


def test_a_folder_that_cannot_be_written_costs_time_only(tmp_path, few_probes, monkeypatch):
    engine = installed(ENGINES[0])
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    world = worlds.ball_with_law()
    with run.measure(world, engine, files(world, engine, tmp_path / engine), None, DEADLINE, True) as measuring:
        found, complaints = measuring.wait()
    assert wrong(found) == set()
    assert "is not writable" in complaints[0]


def test_entries_are_in_the_users_cache_folder(monkeypatch, tmp_path):
    assert scope.ENTRIES.folder() == tmp_path / "cache" / "simspec" / "contact"
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert scope.ENTRIES.folder() == tmp_path / "home" / ".cache" / "simspec" / "contact"


# --- engines that fail --------------------------------------------------------------------------------------------


class Crashed:
    """A process that ended without a result."""

    def wait(self, doing=None):
        raise EngineError("some", "the process was ended by signal 11 (SIGSEGV) without a result")


def test_a_crash_is_the_figure_of_the_probe_that_crashes(tmp_path, few_probes, monkeypatch):
    engine = installed(ENGINES[0])
    world = worlds.table(PAIRS)
    place = files(world, engine, tmp_path / engine)
    original, calls = run.call, []

    def call(name, artifacts, operations, **more):
        calls.append(more["deadline"])
        if len(calls) == 2:
            raise EngineError(name, "the process was ended by signal 11 (SIGSEGV) without a result")
        return original(name, artifacts, operations, **more)

    monkeypatch.setattr(run, "call", call)
    with run.measure(world, engine, place, None, DEADLINE, True) as measuring:
        found, _ = dataclasses.replace(measuring, running=Crashed()).wait()
    assert len(calls) == len(found) == 3
    assert all(0.0 < left <= DEADLINE for left in calls)
    assert wrong(found) == {("push", "ice, rubber")}
    (bad,) = (figure for figure in found if not figure.passed)
    assert bad.measured is None
    assert "SIGSEGV" in bad.case
    assert "SIGSEGV" in run.contact_checks(found)[0].detail
    # figures of a crash are not kept
    assert len(list(scope.ENTRIES.folder().iterdir())) == 2


def test_after_the_deadline_nothing_is_tried_again(tmp_path, few_probes, monkeypatch):
    engine = installed(ENGINES[0])
    world = worlds.table(PAIRS)
    monkeypatch.setattr(run, "call", lambda *given, **more: pytest.fail("tried again"))
    with run.measure(world, engine, files(world, engine, tmp_path / engine), None, DEADLINE, True) as measuring:
        found, _ = dataclasses.replace(measuring, running=Crashed(), ends=0.0).wait()
    assert [figure.measured for figure in found] == [None] * 3


@pytest.mark.parametrize("engine", ENGINES)
def test_files_that_cannot_be_probed_are_a_failed_check(engine, tmp_path, few_probes, monkeypatch):
    """Here, settings that the engine does not know."""
    world = worlds.ball_with_law()
    place = files(world, installed(engine), tmp_path / engine)
    original = run.law_of_files

    def actual(*given):
        found = original(*given)
        return dataclasses.replace(
            found, timestep=found.timestep, options=dataclasses.replace(found.options, settings=(("nonsense", 1),))
        )

    monkeypatch.setattr(run, "law_of_files", actual)
    proof = verify(world, [engine], artifacts={engine: place}).engines[engine]
    (check,) = proof.level("L5")
    assert not check.passed
    assert "nonsense" in check.detail


def test_motion_with_nan_gives_a_figure_without_a_value(tmp_path, few_probes, monkeypatch):
    engine = installed(ENGINES[0])
    world = worlds.ball_with_law()
    with run.measure(world, engine, files(world, engine, tmp_path / engine), None, DEADLINE, False) as measuring:
        answers = measuring.running.wait().answers
        broken = [
            dataclasses.replace(
                answer, arrays={name: np.full_like(value, np.nan) for name, value in answer.arrays.items()}
            )
            for answer in answers
        ]
        running = SimpleNamespace(wait=lambda doing: SimpleNamespace(answers=broken))
        found, _ = dataclasses.replace(measuring, running=running).wait()
    assert [figure.measured for figure in found] == [None]
    assert not run.contact_checks(found)[0].passed


def test_hardness_in_the_files_counts(tmp_path, monkeypatch):
    """Where an engine holds hardness with its pairs, softer files are measured as such."""
    monkeypatch.setattr(run, "PROBES", {"rest": run.PROBES["rest"]})
    monkeypatch.setattr(size, "size_trial", lambda world: None)
    engine = installed("mujoco")
    world = worlds.ball_with_law(friction=0.0)
    soft = worlds.ball_with_law(friction=0.0, hardness=Hardness("time-constant", time_constant=0.05, damping_ratio=1.0))
    soft = worlds.with_options(soft, engine, accept=("contact.hardness.time-constant",))
    assert wrong(measured(world, engine, files(soft, engine, tmp_path / "soft")))
