"""A session knows what was done since loading, begins anew by loading, and lets questions share a load."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

from simspec.compiler import compile_world, write_folder
from simspec.contact import Rules
from simspec.dialects.kit.sidecar import SIDECAR, SIDECAR_SCHEMA
from simspec.dynamics.oracle import Oracle, random_states
from simspec.engines.kit.capabilities import METHODS, Capability, NativeLaw, ServoLaw
from simspec.engines.kit.contract import Engine
from simspec.engines.kit.operations import OPERATIONS
from simspec.engines.kit.process import Operation, call
from simspec.engines.kit.session import Condition, Session
from simspec.errors import EngineError
from simspec.proof.probes import dynamics_operation
from simspec.support.declarations import EXACT
from simspec.support.features import Feature
from tests import worlds
from tests.installed import JOINTED

HAS: dict[str, Any] = {
    name: lambda self, *arguments, name=name: self.note(name)
    for methods in METHODS.values()
    for name in (*methods, "read_back", "set_state", "get_state", "body_states", "contacts", "step", "actuate", "log")
}


class Noting(type("Able", (Engine,), HAS, abstract=True)):
    """Notes its requests."""

    NAME: ClassVar = "noting"
    DIALECT, DISTRIBUTION, EXTRA = "none", "numpy", "none"
    RULES, LAYERS = Rules("max", "max"), False
    SUPPORT: ClassVar = dict.fromkeys(Feature, EXACT)
    SETTINGS: ClassVar = {}
    NATIVE_LAW: ClassVar = NativeLaw(ServoLaw.MOTOR, accuracy=1e-9)
    made: ClassVar[list[Noting]] = []

    def __init__(self):
        self.requests: list[str] = []
        self.made.append(self)

    def note(self, name):
        self.requests.append(name)
        return name

    def load(self, folder, sidecar):
        self.note(f"load {sidecar['what']}")

    def close(self):
        self.note("close")


class Refusing(Noting):
    NAME: ClassVar = "refusing"

    def load(self, folder, sidecar):
        raise EngineError(self.NAME, "refuses it")

    def close(self):
        super().close()
        raise ValueError("half-loaded")


@pytest.fixture
def folder(tmp_path):
    Noting.made.clear()
    (tmp_path / SIDECAR).write_text(f'{{"schema": {SIDECAR_SCHEMA}, "what": "this"}}')
    return tmp_path


ASKING = {
    "read_back",
    "get_state",
    "body_states",
    "bias_force",
    "energy",
    "contacts",
    "collision_units",
    "detect_units",
}
CHANGING = {
    "step": (1,),
    "actuate": (0, 0),
    "track": (0, 0, 0, 0, 0),
    "disable_contact": (),
    "disable_dry_friction": ([1],),
}


@pytest.mark.parametrize("name", sorted(ASKING))
def test_questions_leave_it_clean(folder, name):
    session = Session(Noting, folder)
    assert session.condition is Condition.FRESH
    getattr(session, name)()
    assert (session.condition, session.clean) == (Condition.QUERIED, True)
    assert Noting.made[0].requests == ["load this", name]


@pytest.mark.parametrize("name", CHANGING)
def test_changes_are_known(folder, name):
    session = Session(Noting, folder)
    getattr(session, name)(*CHANGING[name])
    assert (session.condition, session.clean) == (Condition.CHANGED, False)
    session.get_state()
    session.set_state(np.zeros(1), np.zeros(1))
    assert session.condition is Condition.CHANGED, "a state does not undo what was changed"


def test_a_set_state_is_placed_and_a_lent_engine_is_changed(folder):
    session = Session(Noting, folder)
    session.set_state(np.zeros(1), np.zeros(1))
    assert (session.condition, session.clean) == (Condition.PLACED, False)
    assert session.lend() is Noting.made[0]
    assert session.condition is Condition.CHANGED


def test_a_world_without_dry_friction_is_not_requested_to_disable_it(folder):
    session = Session(Noting, folder)
    session.disable_dry_friction(np.zeros(0, np.int64))
    assert session.condition is Condition.FRESH
    assert Noting.made[0].requests == ["load this"]


def test_reset_loads_another_engine_and_closes_the_first(folder):
    with Session(Noting, folder) as session:
        session.step()
        session.reset()
        assert session.condition is Condition.FRESH
        first, second = Noting.made
        assert first.requests == ["load this", "step", "close"]
        session.step()
    assert second.requests == ["load this", "step", "close"]
    with pytest.raises(RuntimeError, match="the session is closed"):
        session.step()
    session.reset()
    session.step()
    assert len(Noting.made) == 3


def test_a_failed_load_is_closed_and_reports_its_reason(folder):
    with pytest.raises(EngineError, match="refusing: refuses it"):
        Session(Refusing, folder)
    assert Noting.made[0].requests == ["close"]


def test_the_error_of_the_block_is_raised(folder):
    class Complaining(Noting):
        def close(self):
            raise ValueError("closing")

    with pytest.raises(KeyError, match="mine"), Session(Complaining, folder):
        raise KeyError("mine")
    with pytest.raises(ValueError, match="closing"), Session(Complaining, folder):
        pass


def test_an_unknown_engine_and_missing_artifacts_are_reported(folder):
    with pytest.raises(EngineError, match="no such engine"):
        Session("bullet9", folder)
    with pytest.raises(FileNotFoundError):
        Session(Noting, folder / "nowhere")


def test_every_operation_has_its_requirements():
    stepping = {"motion", "pushed", "prescribed", "trials", "drive", "respond", "stopped", "windows", "run"}
    stepping |= {"limit", "accelerations"}
    other = {"foreign"}  # it loads a file of its own
    assert {name for name, operation in OPERATIONS.items() if operation.needs is Condition.FRESH} == stepping | other
    assert OPERATIONS["read_back"].needs is Condition.QUERIED, "it reads the initial state, too"


@pytest.mark.usefixtures("warm_engines")
@pytest.mark.parametrize("name", JOINTED)
def test_queries_share_a_load_and_answer_as_after_a_separate_load(name, tmp_path):
    world = worlds.with_options(
        worlds.gripper(),
        name,
        accept=(
            "contact.cone.elliptic",
            *worlds.FRICTION,
            "joint.limits.position",
            "shape.box",
        ),
    )
    folder = tmp_path / name
    write_folder(compile_world(world, [name])[name].files, folder)
    oracle = Oracle(world)
    q, v = random_states(world, 3)
    state = {"q": q, "v": v}
    static = {"q": q[0], "v": 0.0 * v[0], "effort": 0.0 * v[0], "rubbing": np.zeros(0, np.int64)}
    questions = {
        "read_back": Operation("read_back", world=world),
        "kinematics": Operation("kinematics", {}, state, world),
        "dynamics": dynamics_operation(oracle, q, v),
        "touching": Operation("touching", {}, state, world),
        "motion": Operation("motion", {"steps": 5, "every": 5}, static, world),
    }
    order = ["read_back", "read_back", "kinematics", "dynamics", "touching", "read_back", "motion", "kinematics"]
    shared = call(name, folder, [questions[op] for op in order]).answers
    assert [answer.load_seconds > 0.0 for answer in shared] == [True, False, False, False, False, True, True, True]
    answers = {op: call(name, folder, [question]).answers[0] for op, question in questions.items()}
    for op, together in zip(order, shared, strict=True):
        alone = answers[op]
        assert together.read_back == alone.read_back
        assert together.result == alone.result
        assert together.arrays.keys() == alone.arrays.keys()
        for key, value in alone.arrays.items():
            np.testing.assert_array_equal(together.arrays[key], value)


def test_capabilities_that_are_lacking_raise_their_reason(folder):
    class Plain(Noting):
        LACKS: ClassVar = {Capability.ENERGY: "it has none"}

    with Session(Plain, Path(folder)) as session, pytest.raises(EngineError, match="it has none"):
        session.energy()
