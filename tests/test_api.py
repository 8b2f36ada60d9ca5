"""The public API: lazy, complete, and as documented."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

import simspec

pytestmark = pytest.mark.usefixtures("warm_engines")

PAGE = Path(__file__).resolve().parent.parent / "docs" / "reference" / "python-api.md"


def test_the_documented_session_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"^```python\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    assert len(blocks) >= 8
    session: dict[str, object] = {}
    for block in blocks:
        exec(compile(block, str(PAGE), "exec"), session)  # the page's own code is what is tested
    printed = capsys.readouterr().out
    assert "~ physics.timestep: 0.001 -> 0.002" in printed
    assert "timestep" in printed  # the hint for the misspelt key
    assert simspec.load_run(tmp_path / "runs/double-pendulum/mujoco").engine == "mujoco"


@pytest.mark.parametrize("name", simspec.__all__)
def test_every_public_name_is_there_and_documented(name):
    value = getattr(simspec, name)
    assert (value.__doc__ or "").strip()
    assert name in dir(simspec)


def test_an_unknown_attribute_is_an_error():
    with pytest.raises(AttributeError, match="no attribute 'simulate'"):
        _ = simspec.simulate  # type: ignore[attr-defined]


def test_importing_simspec_imports_nothing_heavy():
    code = "import simspec, sys; print(sorted(m for m in sys.modules if m.startswith('simspec.') or m in HEAVY))"
    heavy = {"numpy", "pydantic", "typer", "rich", "jinja2", "pyarrow", "ruamel.yaml", "importlib.metadata"}
    done = subprocess.run(
        [sys.executable, "-c", code.replace("HEAVY", repr(heavy))], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[]"


def test_notebook_representations_are_short():
    import simspec
    from simspec.proof.certificate import Certificate, EngineProof
    from tests.runner.synthetic import free_body, run, world

    big = simspec.load(simspec.find_spec("stack-cylinders")).resolve()
    spheres = world(*(free_body(f"ball_{k}") for k in range(300)))
    first, second = run(spheres), run(spheres, engine="second")
    shown = [
        *(big, big.contact, big.trajectory, *big.controllers, first, simspec.diff(first, second)),
        *simspec.compile(big, ["mujoco"]).values(),
        Certificate("x", "0" * 64, "pin", {"a": EngineProof("1.0", "0" * 64, ())}),
        simspec.Study(big, None, {"a": first}, {}, {}, {}, ()),
        simspec.load(simspec.find_spec("stack-cylinders")),
    ]
    for value in shown:
        assert 10 < len(repr(value)) < 200, repr(value)[:300]


BALL = {
    "simspec": 1,
    "name": "falling-ball",
    "physics": {"duration": 0.1, "timestep": "1 ms"},
    "bodies": {"ball": {"mass": 2.0, "inertia": {"principal": [0.01, 0.01, 0.01]}, "pose": {"xyz": [0, 0, 1]}}},
    "record": {"every": "10 ms"},
    "sweep": {"over": {"bodies.ball.mass": [1, 2]}, "engines": ["mujoco"]},
}


def test_worlds_and_runs_have_methods_that_need_no_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    world = simspec.Spec.from_data(BALL).resolve()
    assert world.compile("mujoco").files == simspec.compile(world, ["mujoco"])["mujoco"].files
    assert world.verify(["mujoco"]).valid
    run, other = world.run("mujoco"), world.run("dart")
    assert run.diff(other, tolerance=1e-3).within
    with world.session("mujoco") as session:
        q, _ = session.get_state()
        session.step(10)
        session.reset()
        assert (session.get_state()[0] == q).all()
    assert not list(tmp_path.iterdir())


def test_a_session_keeps_its_temporary_folder_as_long_as_it_exists():
    session = simspec.Spec.from_data(BALL).resolve().session("mujoco")
    folder = session.artifacts
    session.close()
    assert folder.is_dir()
    del session
    assert not folder.exists()


def test_a_spec_runs_its_sweep(tmp_path):
    spec = simspec.Spec.from_data(BALL)
    swept = spec.sweep(jobs=1)
    assert [dict(cell.overrides) for cell, _ in swept.rows()] == [{"bodies.ball.mass": 1}, {"bodies.ball.mass": 2}]
    assert [run.world.bodies[0].inertial.mass for _, run in swept.runs()] == [1.0, 2.0]
    assert not swept.outcome.unproven
    folder = swept.store.path
    del swept
    assert not folder.exists()
    for ran in (2, 0):
        assert spec.sweep(["mujoco"], store=tmp_path / "store", verify=False).outcome.ran == ran
