"""gz sim's runner on a stand-in of its Python bindings. It is no real gz sim: these tests show that simspec
calls the documented functions as they are documented, with the right numbers, and names what is wrong."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

from simspec import Spec, cli
from simspec.compiler import compile_world, write_folder
from simspec.engines.gzsim import bindings
from simspec.engines.gzsim.engine import GzSim
from simspec.engines.gzsim.simulation import PHYSICS, static_world, stepped_world
from simspec.engines.kit.building import Walk
from simspec.errors import EXIT_ENGINE, EXIT_OK, EngineError, UnsupportedError
from simspec.formats.world import WorldJson
from simspec.proof.judge import judge
from simspec.proof.verify import verify
from simspec.world.types import World
from tests.engines.gzsim.worlds import ARMS, PENDULUM, world_of

STAND_IN = Path(__file__).parent / "stand_in"


@pytest.fixture(autouse=True)
def looked_anew():
    bindings._all.cache_clear()
    yield
    for entry in (bindings._all, bindings.bindings):
        entry.cache_clear()


@pytest.fixture
def stand_in(monkeypatch):
    """The stand-in, found as a gz sim that is installed; ``fault``: its fault."""

    def install(fault: str = "", folder: Path = STAND_IN) -> None:
        monkeypatch.setenv(bindings.FOLDER, str(folder))
        monkeypatch.setenv("GZ_STAND_IN", fault)
        for name in ("GZ_PARTITION", "GZ_IP"):  # which the engine sets in its process, in some tests this one
            monkeypatch.setenv(name, "")
        monkeypatch.setattr(sys, "path", [*sys.path])
        bindings._all.cache_clear()

    return install


def load(world: World, folder: Path) -> GzSim:
    compiled = compile_world(world, ["gzsim"])["gzsim"]
    folder = folder / str(len(list(folder.iterdir())))
    write_folder(compiled.files, folder)
    engine = GzSim()
    engine.load(folder, json.loads(compiled.files["sidecar.json"]))
    return engine


def failures(world: World) -> list[str]:
    """The failed checks of a proof on the stand-in."""
    (proof,) = verify(world, ["gzsim"], deadline=30.0).engines.values()
    return [f"{check.level} {check.name}: {check.detail}" for check in proof.checks if not check.passed]


def test_every_level_that_can_be_queried_is_valid_on_the_stand_in(stand_in):
    """Frames, orders, signs, initial velocities, poses commanded twice and forces for one step: by L1, L2 and L6."""
    stand_in()
    world = world_of(ARMS)
    certificate = verify(world, ["gzsim"])
    proof = certificate.engines["gzsim"]
    assert [check.detail for check in proof.checks if not check.passed] == []
    assert {"L0", "L1", "L2", "L6"} <= {check.level for check in proof.checks}
    assert set(proof.not_checked) >= {"L3", "L4 everything else held", "static.inertial", "joint.velocity_limit"}
    assert proof.verdict.startswith("valid; not checked: L3 (gz sim's Python bindings report no dynamics")
    assert (proof.version, proof.files_alone, judge(certificate, world)) == ("8", False, [])


def test_dry_friction_is_written_and_removed(stand_in):
    stand_in()
    text = PENDULUM.replace("position: 0.4", "position: 0.4, dry_friction: 0.3")
    checks = verify(world_of(text), ["gzsim"]).engines["gzsim"].checks
    assert [check.detail for check in checks if not check.passed] == []
    assert {"dry friction, sliding", "motion"} <= {check.name for check in checks if check.level == "L6"}


def test_efforts_act_the_same_in_a_single_call_and_in_many(stand_in, tmp_path):
    stand_in()
    world = world_of(ARMS)
    effort = np.linspace(-1.0, 1.0, 9)
    found = []
    for counts in ((6,), (1, 2, 3)):
        engine = load(world, tmp_path)
        for count in counts:
            engine.step(count, effort)
        found.append(np.concatenate(engine.get_state()))
        engine.close()
    assert found[0].tolist() == found[1].tolist()


def test_a_state_that_was_set_before_is_written_again(stand_in, tmp_path):
    """gz sim updates only links that have moved by 1e-6 since the last update."""
    stand_in()
    engine = load(world_of(ARMS), tmp_path)
    q, v = engine.get_state()
    v = np.zeros_like(v)
    ends = []
    for push in (0.0, 0.3):  # which is 1e-7 m in a step
        engine.set_state(q, v)
        engine.step(1, np.array([0.0, 0.0, push, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
        ends.append(engine.get_state()[1])
    values = []
    for rate in (1.0, 2.0):
        engine.set_state(q, v + rate)
        values.append(engine.body_states()[1])
    engine.close()
    assert values[1] == pytest.approx(2.0 * values[0], rel=1e-9, abs=1e-12)
    assert np.abs(ends[1] - ends[0]).max() > 5e-5


# --- what is not there, and what is wrong with it ------------------------------------------------------------------


def test_without_it_the_files_alone_are_proven(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv(bindings.FOLDER, str(tmp_path))
    monkeypatch.chdir(tmp_path)
    assert GzSim.version() is None
    assert GzSim.files_alone() == GzSim.FILES_ALONE
    (tmp_path / "pendulum.yaml").write_text(PENDULUM, encoding="utf-8")
    for words in (("run", "pendulum.yaml"), ("verify", "--self-test")):
        assert cli.main([*words, "--engine", "gzsim"]) == EXIT_ENGINE
        assert "gzsim: not installed (" in " ".join(capsys.readouterr().err.split())
    assert cli.main(["verify", "pendulum.yaml", "--engine", "gzsim"]) == EXIT_ENGINE
    said = " ".join(capsys.readouterr().out.split())
    assert "NOT PROVEN" in said
    assert "simspec has never run a real gz sim" in said
    assert cli.main(["compile", "pendulum.yaml", "--engine", "gzsim"]) == EXIT_OK
    capsys.readouterr()
    for words in (("install", "gzsim"), ("doctor", "gzsim")):
        assert cli.main(["engines", *words]) == EXIT_ENGINE
        text = " ".join(capsys.readouterr().out.split())
        assert bindings.FOLDER in text
        assert "Python bindings" in text
    certificate = verify(world_of(PENDULUM), ["gzsim"])
    (proof,) = certificate.engines.values()
    assert ({check.level for check in proof.checks}, proof.passed, proof.valid) == ({"L0"}, True, False)
    assert judge(certificate, world_of(PENDULUM)) == [f"gzsim: {proof.verdict}"]


@pytest.mark.parametrize(
    ("file", "said"),
    [
        ("sim8.cpython-38-x86_64-linux-gnu.so", "is of another Python than this one"),
        ("sim7.cpython-311-x86_64-linux-gnu.so", "is of another gz sim"),
        ("simulator.py", "no gz sim is found here"),
    ],
)
def test_bindings_that_cannot_be_used_are_not_taken(stand_in, tmp_path, file, said):
    (tmp_path / "gz").mkdir()
    (tmp_path / "gz" / file).touch()
    stand_in(folder=tmp_path)
    assert bindings.version() is None
    assert said in bindings.why_not()
    assert GzSim.files_alone() == GzSim.FILES_ALONE


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ("no library", "half installed: gz.sim8 at "),
        ("old", "wrong version: there is no gz.sim8.Link.world_inertial"),
        ("garbage", "a step led to a state that is not finite"),
        ("dies", "the process ended with code 7 without a result"),
        ("stops", "made 1 steps of 2: it refuses the world, or was stopped"),
    ],
)
def test_a_fault_of_the_server_is_named(stand_in, fault, said):
    stand_in(fault)
    (text,) = [line for line in failures(world_of(PENDULUM)) if line.startswith("L1 engine")]
    assert said in text


def test_a_server_that_hangs_is_ended_at_its_deadline(stand_in):
    stand_in("hangs")
    (proof,) = verify(world_of(PENDULUM), ["gzsim"], deadline=1.5).engines.values()
    assert not proof.passed
    assert any("1.5 s" in check.detail for check in proof.checks)


def test_a_library_that_is_missing_ends_with_the_code_of_engines(stand_in, tmp_path, monkeypatch, capsys):
    stand_in("no library")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "pendulum.yaml").write_text(PENDULUM, encoding="utf-8")
    assert cli.main(["run", "pendulum.yaml", "--engine", "gzsim", "--no-verify"]) == EXIT_ENGINE
    assert "half installed" in " ".join(capsys.readouterr().err.split())


def test_a_physics_system_that_does_not_step_is_not_proven(stand_in):
    stand_in("still")
    assert any(line.startswith("L6 motion") for line in failures(world_of(PENDULUM)))


# --- files and refusals --------------------------------------------------------------------------------------------


def test_the_text_has_the_physics_system_and_steps_as_fast_as_it_can(tmp_path):
    write_folder(compile_world(world_of(ARMS), ["gzsim"])["gzsim"].files, tmp_path)
    walk = Walk.of(WorldJson().read(tmp_path))
    for text in (stepped_world(walk), static_world(walk)):
        assert f'<plugin filename="{PHYSICS.file}" name="{PHYSICS.name}"/>' in text
        assert "<real_time_factor>0</real_time_factor>" in text
        assert "<collision" not in text
    assert "<gravity>0 0 0</gravity>" in static_world(walk)
    assert "<max_step_size>1.25e-09</max_step_size>" in static_world(walk)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("physics", {"timestep": "0.00025 s"}), ""),
        (("physics", {"timestep": "0.0000125 s"}), "whole microseconds"),
        (("contact", {"materials": {"rubber": {"friction": 0.5}}}), "report no contacts"),
    ],
)
def test_worlds_that_cannot_be_queried_are_refused(change, said):
    data = yaml.safe_load(PENDULUM)
    name, value = change
    data[name] = value
    if name == "contact":
        data["bodies"]["bob"]["shapes"] = [{"sphere": {"radius": 0.1}, "material": "rubber"}]
    world = Spec.from_data(data).resolve()
    if not said:
        compile_world(world, ["gzsim"])
        return
    with pytest.raises(UnsupportedError, match=said):
        compile_world(world, ["gzsim"])


def test_states_and_efforts_that_are_not_finite_are_refused(stand_in, tmp_path):
    stand_in()
    engine = load(world_of(PENDULUM), tmp_path)
    with pytest.raises(EngineError, match="not finite"):
        engine.set_state(np.array([np.nan]), np.zeros(1))
    with pytest.raises(EngineError, match="not finite"):
        engine.step(1, np.array([np.inf]))
    with pytest.raises(EngineError, match="mass_matrix: gz sim's Python bindings report no dynamics"):
        engine.mass_matrix()
    engine.close()
