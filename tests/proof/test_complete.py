"""The complete self-test: mutations are caught by the proof, refused by the engine, missed or inert."""

from __future__ import annotations

import dataclasses
import json
import subprocess
import sys
from types import SimpleNamespace

import pytest

from simspec.commands import verify as command
from simspec.compiler import missing_options
from simspec.dialects.kit.mutations import Inert, Mutation, MutationTable
from simspec.engines.kit.registry import engines, find_engine
from simspec.errors import UnsupportedError
from simspec.proof import complete, selftest
from simspec.proof.complete import CompleteTest, Verdict, complete_self_test
from simspec.proof.mutation_worlds import STAND_INS, WORLDS

pytestmark = pytest.mark.usefixtures("warm_engines")

SITES = {"inertial@mass": "caught", "joint@type": "caught", "mujoco": "refused", "mujoco@model": "inert"}


@pytest.fixture(scope="module")
def tested():
    return complete_self_test(["mujoco"], worlds=["ball joint"], only=lambda mutation: mutation.site in SITES)


def test_mutations_are_caught_refused_or_inert(tested):
    found = {(verdict.site, verdict.verdict) for verdict in tested.verdicts}
    assert ("inertial@mass", "caught") in found
    assert ("inertial@mass", "refused") in found, "a body without mass"
    assert all(verdict.by and verdict.why for verdict in tested.verdicts if verdict.verdict == "caught")
    assert tested.missed == ()
    assert ("mujoco@model", "inert") in found
    assert tested.versions["mujoco"]


@pytest.mark.parametrize("seen", ["whole", "glimpsed", "together"])
def test_mutations_declared_inert_must_not_change_the_motion(seen, monkeypatch):
    """A declaration that covers something that acts is not believed: where each moves alone, where glimpses show it, and
    where they show nothing, and several move together."""
    monkeypatch.setattr(complete, "SHORT", 60.0 if seen == "whole" else 0.0)
    if seen == "together":
        monkeypatch.setattr(complete, "glimpses_of", lambda world, scenes, course: scenes[-1:])
    real = complete.table_of

    def generous(name):
        return dataclasses.replace(real(name), inert=(Inert("*", "because"),))

    monkeypatch.setattr(complete, "table_of", generous)
    blind = lambda *_: []  # noqa: E731 - a proof that sees nothing
    monkeypatch.setattr(complete, "read_back_checks", blind)
    monkeypatch.setattr(complete, "engine_checks", lambda *_: ([], {}))

    def verdicts_of():
        found = complete_self_test(
            ["mujoco"], worlds=["ball joint"], only=lambda mutation: mutation.site in ("inertial@mass", "mujoco@model")
        )
        return found, {(verdict.site, verdict.kind): verdict.verdict for verdict in found.verdicts}

    _, verdicts = verdicts_of()
    assert verdicts["inertial@mass", "scaled"] == "caught", "a mutation of the motion gets the whole proof first"
    monkeypatch.setattr(complete._WorldBench, "_proven", lambda *_: None)
    found, verdicts = verdicts_of()
    assert verdicts["inertial@mass", "scaled"] == "missed"
    assert verdicts["mujoco@model", "word"] == "inert"
    assert not found.passed


@pytest.mark.parametrize(
    ("refused", "tried"), [("", "whole other"), ("whole", "part other"), ("whole part", "bit other")]
)
def test_a_stand_in_is_tried_where_the_world_itself_is_refused(refused, tried, monkeypatch):
    monkeypatch.setattr(complete, "WORLDS", dict.fromkeys(("whole", "part", "bit", "other")))
    monkeypatch.setattr(complete, "STAND_INS", {"whole": "part", "part": "bit"})
    bench = SimpleNamespace(verdicts=lambda only: [])
    monkeypatch.setattr(
        complete._WorldBench, "of", lambda engine, name, python: "no" if name in refused.split() else bench
    )
    done = []
    found = complete_self_test(["mujoco"], keep=lambda world, verdicts, seconds: done.append(world))
    assert done == tried.split()
    assert {*done, *(name.removeprefix("mujoco, ") for name in found.skipped)} == {"whole", "part", "bit", "other"}


def test_a_process_without_a_result_fails_only_the_operation_that_ended_it(monkeypatch):
    from simspec.engines.kit.process import Answer
    from simspec.errors import EngineError

    sizes = []

    def call(engine, folder, operations, python, deadline):
        sizes.append(len(operations))
        texts = [(folder / operation.parameters["artifacts"] / "model.xml").read_text() for operation in operations]
        if any(' mass="-' in text for text in texts):
            raise EngineError(engine, "the process was ended by signal 11 (SIGSEGV) without a result")
        return type("Reply", (), {"answers": [Answer({"refused": "just so"}, {}, 0.0, 0.0, []) for _ in operations]})()

    bench = complete._WorldBench.of("mujoco", "ball joint")
    monkeypatch.setattr(selftest, "call", call)
    verdicts = bench.verdicts(lambda verdict: verdict.site in ("inertial@mass", "inertial@pos"))
    assert all(verdict.verdict == "refused" for verdict in verdicts)
    ended = [verdict for verdict in verdicts if "SIGSEGV" in verdict.why]
    assert [(verdict.site, verdict.kind) for verdict in ended] == [("inertial@mass", "sign")]
    assert sizes[0] == len(verdicts)


@pytest.mark.parametrize("missed", [True, False])
def test_the_command_lists_missed_defects(missed, monkeypatch, capsys):
    place = ("model.xml", "scaled", "joint@damping", "joint[a]@damping", "1 to 1.01")
    verdicts = (
        Verdict("one", "world", *place, "missed" if missed else "caught", "L2", "damping"),
        Verdict("one", "world", *place, "inert", why="a reason"),
    )
    found = CompleteTest(verdicts, {"one, other": "it cannot"}, {"one": "1.2"}, 60.0, {"one": ("stale@row",)})
    monkeypatch.setattr(complete, "complete_self_test", lambda engines, pythons, progress: found)
    assert command.complete_self_test(["one"], {}, as_json=True) == int(missed)
    answer = json.loads(capsys.readouterr().out)
    assert answer["passed"] is not missed
    assert answer["rows"][-1] == {
        "engine": "one",
        "kind": "all",
        "planted": 2,
        "caught": int(not missed),
        "refused": 0,
        "inert": 1,
        "missed": int(missed),
    }
    assert answer["inert"] == [{"engine": "one", "reason": "a reason", "count": 1}]
    assert answer["mutations"][0]["place"] == "joint[a]@damping"
    assert answer["unused"] == {"one": ["stale@row"]}
    assert command.complete_self_test(["one"], {}, as_json=False) == int(missed)
    said = capsys.readouterr().out
    assert ("MISSED one, world: model.xml joint[a]@damping: scaled 1 to 1.01" in said) == missed
    assert "one, other: it cannot" in said
    assert "one: declared inert, and no change needs it: stale@row" in said
    assert f"missed {int(missed)} of 2 changes" in said


def test_complete_goes_with_the_self_test_alone():
    for words in (["verify", "--complete"], ["verify", "bouncing-ball", "--complete"]):
        done = subprocess.run([sys.executable, "-m", "simspec", *words], capture_output=True, text=True, check=False)
        assert done.returncode == 2, done.stderr


def test_the_table_counts_by_engine_and_kind():
    verdicts = tuple(
        Verdict("one", "world", "file", kind, "site", "place", "change", verdict)
        for kind, verdict in (("scaled", "caught"), ("scaled", "missed"), ("word", "inert"))
    )
    found = CompleteTest(verdicts)
    assert found.rows() == [
        ("one", "scaled", (2, 1, 0, 0, 1)),
        ("one", "word", (1, 0, 0, 1, 0)),
        ("one", "all", (3, 1, 0, 1, 1)),
    ]
    assert not found.passed
    assert CompleteTest(verdicts[::2]).passed
    assert not CompleteTest(()).passed, "nothing planted is nothing shown"


def test_rows_that_no_change_needs_are_named(tested):
    """Rows without a match, and rows with matches that are all caught or refused before a motion is requested."""
    needed, stale = Inert("mujoco@model", "a name"), Inert("nothing@*", "of nothing", ("word",))
    caught = Inert("inertial@mass", "caught", file="*.xml")
    table = MutationTable(inert=(needed, stale, caught))
    assert needed.name in {verdict.row for verdict in tested.verdicts if verdict.verdict == "inert"}
    assert complete.unused_rows(table, tested.verdicts) == ("nothing@*; word", "inertial@mass; *.xml")
    assert tested.unused == {}, "nothing is known of rows when only some changes were tried"


@pytest.mark.parametrize(("engine", "acts"), [("mujoco", True), ("mjwarp", False)])
def test_the_same_motion_is_as_near_as_numbers_of_the_engine_are(engine, acts, monkeypatch):
    """Round-off of singles by another order of sums is not an effect of a change; that of doubles is much smaller."""
    monkeypatch.setattr(complete._WorldBench, "__init__", lambda self: None)
    bench, row, found = complete._WorldBench(), Inert("*", "because"), complete._MutationVerdicts()
    change = Mutation("model.xml", "scaled", "geom@quat", "geom@quat", "[0] 1 to 1.01", "")
    object.__setattr__(bench, "engine", find_engine(engine))
    object.__setattr__(bench, "table", MutationTable(inert=(row,)))
    assert bench._note(change, 4.1e-5, found) is acts
    assert bench._note(change, 1e-3, found)
    assert change.name in found.acting


@pytest.mark.parametrize("large", [True, False])
def test_a_substitute_world_is_omitted_where_the_original_is_supported(large, monkeypatch):
    def bench_of(engine, name, python):
        if name == "model" and not large:
            return "it refuses slides"
        verdicts = (Verdict(engine, name, "file", "word", "site", "place", "change", "caught"),)
        return type("Bench", (), {"verdicts": lambda self, only: verdicts})()

    monkeypatch.setattr(complete._WorldBench, "of", bench_of)
    found = complete_self_test(["mujoco"])
    others = set(STAND_INS.values()) - {"core"}
    assert {verdict.world for verdict in found.verdicts} == set(WORLDS) - others - {"core" if large else "model"}
    assert ("mujoco, core" in found.skipped) == large
    assert found.unused["mujoco"], "no row was needed"
    named = complete_self_test(["mujoco"], worlds=["model", "core"])
    assert {verdict.world for verdict in named.verdicts} == {"core", *(("model",) if large else ())}


NOT_ACCEPTED = {("ode", "settings"), ("ode", "settings on a floor")}
"""With ODE's own motion, which these settings ask for, the proof fails, as is declared: the world is left out, and says so."""


@pytest.mark.parametrize("engine", [name for name, known in engines().items() if not known.FILES_ALONE])
def test_no_world_is_left_out_for_want_of_an_acceptance(engine):
    """Approximate features of an engine are tested, too. Otherwise a new declaration of an approximation would remove the
    mutations of a whole world, and the self-test would pass by trying less."""
    for name, make in WORLDS.items():
        world = make(engine)
        try:
            needed = missing_options(world, engine)
        except UnsupportedError:
            continue  # not supported at all, which is said
        assert not needed or (engine, name) in NOT_ACCEPTED, f"{name}: {needed}"


def test_a_format_without_a_table_gets_an_empty_table(monkeypatch):
    monkeypatch.setattr(complete, "dialects", lambda: {"odd": type("Odd", (), {"__module__": "tests.worlds"})()})
    assert complete.table_of("odd") == MutationTable()


def test_a_table_that_cannot_be_imported_is_an_error(monkeypatch):
    monkeypatch.setattr(complete.importlib, "import_module", _missing_other)
    with pytest.raises(ModuleNotFoundError):
        complete.table_of("mujoco")


def _missing_other(name):
    raise ModuleNotFoundError("something that the table needs", name="numpy")


def test_contact_under_a_friction_that_is_not_the_default_is_among_the_worlds():
    """MuJoCo's other friction is computed outside the engine; its files must be changed too, with something in contact."""
    world = WORLDS["choices"]("mujoco")
    assert dict(world.options("mujoco").settings)["friction"] == "coulomb"
    assert any(pair.friction for pair in world.contact.pairs)
    assert {body.joint.kind for body in world.bodies if any(shape.collision for shape in body.shapes)} == {
        "fixed",
        "free",
    }


def test_mutations_that_leave_the_computed_model_unchanged_are_not_run_alone(monkeypatch):
    """For an engine that hashes its model, such mutations have no short motions, but whole motions together with others."""
    bench = complete._WorldBench.of("mujoco", "ball joint")
    assert bench.made_of == "", "MuJoCo's motions are quick: it hashes nothing"
    local, requested = selftest.call, set()

    def call(engine, folder, operations, python, deadline):
        reply = local(engine, folder, operations, python=python, deadline=deadline)
        requested.update(operation.op for operation in operations)
        for answer in reply.answers:
            if "bodies" in answer.result:
                answer.result["made_of"] = "all"
        return reply

    monkeypatch.setattr(selftest, "call", call)
    monkeypatch.setattr(complete, "SHORT", 0.0)
    bench = dataclasses.replace(bench, made_of="all")
    verdicts = bench.verdicts(lambda entry: entry.site in ("mujoco@model", "visual@rgba", "geom@rgba", "inertial@mass"))
    inert = [verdict for verdict in verdicts if verdict.verdict == "inert"]
    assert inert
    assert len({verdict.verdict for verdict in verdicts}) > 1
    assert "drive" in requested
    assert "windows" not in requested
