"""The path of a world through a command: each step once for each engine (``docs/design/architecture.md``)."""

from __future__ import annotations

import functools
from collections import Counter

import pytest

from simspec import cli, compiler
from simspec.dialects.kit.contract import Dialect, dialects
from simspec.dynamics.oracle import Oracle
from tests.caches import cache_home
from tests.installed import INSTALLED, LEFT_OUT

pytestmark = pytest.mark.usefixtures("warm_engines")

SPEC = """simspec: 1
name: ball
physics: {timestep: 1 ms, duration: 20 ms}
bodies:
  ball:
    pose: {xyz: [0, 0, 1]}
    shapes: [{sphere: {radius: 50 mm}, density: 1000}]
  floor: {fixed: true, shapes: [{plane: {}}]}
contact:
  materials: {rubber: {friction: 0, restitution: 0.5}}
engines:
  mujoco: {accept: [material.restitution]}
  dart: {accept: [material.restitution]}
  gazebo: {accept: [material.restitution]}
"""
"""A world that one engine does not support: it is negotiated for that one, and nothing more."""
TAKEN = tuple(name for name in INSTALLED if name != "drake")
NAMED = tuple(word for name in TAKEN for word in ("--engine", name))


@pytest.fixture
def steps(tmp_path, monkeypatch):
    """Counts (step, engine) of the steps that the world ``ball`` takes in this process."""
    counts = Counter()

    def count(owner, name, key):
        whole = getattr(owner, name)

        @functools.wraps(whole)
        def counted(*given, **named):
            counts[key(*given)] += 1
            return whole(*given, **named)

        monkeypatch.setattr(owner, name, counted)

    def of(world, step, engine=""):
        return (step, engine) if world.name == "ball" else ("of another world", step)

    count(compiler, "needed_decisions", lambda world, label, *more: of(world, "negotiate", label))
    for dialect in {type(dialect) for dialect in dialects().values()}:
        count(dialect, "lower", lambda self, world, target: of(world, "lower", target.engine))
    count(compiler, "canonical_json", lambda world: of(world, "canonical JSON"))
    count(Dialect, "read", lambda self, folder: ("read", folder.name))
    # engines in single precision have oracles with other directions of gravity, too
    down = (0.0, 0.0, -9.81)
    count(Oracle, "__init__", lambda self, world: of(world, "oracle" if world.physics.gravity == down else "tilted"))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", cache_home(tmp_path))
    (tmp_path / "ball.yaml").write_text(SPEC)
    return counts


def expected(*once: str, refused: bool) -> dict[tuple[str, str], int]:
    """Each step of ``once`` one time for each engine; an engine that refuses is tried again with all features accepted."""
    counts = {(step, name): 1 for step in ("negotiate", "lower", *once) for name in TAKEN}
    return counts | ({("negotiate", "drake"): 2} if refused else {})


def taken(counts: Counter[tuple[str, str]], *left_out: str) -> dict[tuple[str, str], int]:
    """But for engines that are not installed, for which some commands compile too."""
    return {
        key: count
        for key, count in counts.items()
        if key[0] not in ("of another world", "tilted", *left_out) and key[1] not in LEFT_OUT
    }


@pytest.mark.parametrize("words", [(), NAMED], ids=["all", "named"])
@pytest.mark.parametrize("command", [("compile",), ("verify", "--no-cache"), ("run", "--no-repeats")])
def test_a_command_compiles_once_for_each_engine(steps, command, words):
    name, *options = command
    more = ["--all-engines"] if name == "run" and not words else []
    assert cli.main([name, "ball.yaml", *options, *more, *words]) == 0
    read = () if name == "compile" else ("read",)
    world = {("canonical JSON", ""): 1} | ({} if name == "compile" else {("oracle", ""): 1})
    assert taken(steps) == expected(*read, refused=not words) | world


def test_looking_whether_files_are_current_compiles_once(steps):
    assert cli.main(["compile", "ball.yaml"]) == 0
    steps.clear()
    assert cli.main(["compile", "--check", "ball.yaml"]) == 1, "there is no certificate yet"
    assert taken(steps, "canonical JSON") == expected(refused=True)
