"""Prove that engines hold a world: compile, read the text, load, ask, probe, compare; the result is a certificate."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from simspec.compiler import Compiled, compile_world, write_folder
from simspec.dialects.kit.contract import dialects
from simspec.dynamics.oracle import Oracle, random_states
from simspec.engines.kit import process
from simspec.engines.kit.capabilities import DOUBLE, Capability
from simspec.engines.kit.contract import Engine
from simspec.engines.kit.inventory import WORLD_LABEL
from simspec.engines.kit.process import DEADLINE, Answer, Operation, Reply, at_work, start
from simspec.engines.kit.registry import find_engine
from simspec.engines.kit.warm import WarmProcesses
from simspec.errors import EngineError, Location, UnsupportedError
from simspec.files import scratch_folder
from simspec.outputs.writing import Artifacts
from simspec.proof import convergence, forces, limits, motion
from simspec.proof import probes as control
from simspec.proof.accelerations import Accelerations
from simspec.proof.accelerations import plan as plan_accelerations
from simspec.proof.certificate import Certificate, EngineProof, MotionLimit
from simspec.proof.checks import PRECISIONS, Check, MotionPlan, Part, Precision, failed, inventory_checks
from simspec.proof.comparator import compare
from simspec.proof.contact.probe import ProbeFigure
from simspec.proof.contact.run import contact_checks, measure, not_measured
from simspec.proof.contact.scope import scope
from simspec.proof.convergence import LimitMotion
from simspec.proof.expected import (
    MATRIX,
    approximations,
    by_steps,
    left_out,
    motionless,
    not_checked,
    not_checked_parts,
    of_files_alone,
    shortfalls,
    unchecked,
    uncomparable,
)
from simspec.proof.forces import FORCES_CHECK, PRESCRIBED_CHECK, SLIDING_CHECK
from simspec.proof.limits import BALLS_CHECK, STOPS_CHECK
from simspec.proof.motion import MOTION, OracleMotion
from simspec.proof.probes import (
    FEW_STATES,
    LARGE,
    QUANTITIES,
    STATES,
    dynamics_checks,
    dynamics_operation,
    kinematics_checks,
)
from simspec.proof.touch import plan as touch
from simspec.proof.touch.plan import Meetings, touch_checks
from simspec.world.canonical import sha256
from simspec.world.contact_pairs import meeting_laws
from simspec.world.types import ReadBack, World

LEVELS = ("L0", "L1", "L2", "L3", "L4", "L5", "L6", "L7")
"""L1, L2's fields and L4's come from one read-back; L5 is contact, measured in worlds of its own (``proof/contact/run.py``); L7
is control, in worlds that have it."""

UNREAD = "text"
"""Name of the check that fails when the independent reader refuses the files."""


@dataclass(frozen=True)
class Experiment:
    """A motion that engines repeat: its level, the parts of a proof that it makes (an engine that lacks one does not run it),
    and how it is planned (None: the world has none)."""

    level: str
    parts: tuple[Part, ...]
    plan: Callable[[World, Oracle, Precision], MotionPlan | None]
    limit: bool | None = None
    """Whether it is of engines with another method of integration than semi-implicit Euler, or of the others; None: of all."""


EXPERIMENTS: Mapping[str, Experiment] = {
    "motion": Experiment(
        "L6", (MOTION,), lambda world, *given: None if motionless(world) else motion.plan(world, *given), limit=False
    ),
    "limit": Experiment(
        "L6",
        (MOTION,),
        lambda world, *given: None if motionless(world) else convergence.plan(world, *given),
        limit=True,
    ),
    "trials": Experiment("L6", (("L6", SLIDING_CHECK),), forces.plan_friction),
    "stopped": Experiment("L6", (("L6", STOPS_CHECK), ("L6", BALLS_CHECK)), limits.plan),
    "respond": Experiment("L7", (("L7", "step response"),), control.plan),
    "pushed": Experiment("L7", (("L7", FORCES_CHECK),), forces.plan),
    "prescribed": Experiment("L7", (("L7", PRESCRIBED_CHECK),), forces.plan_motions),
}
"""By the operation of an engine."""


@dataclass(frozen=True)
class Probes:
    """The oracle's side, computed once for all engines: states, meetings, and the plans of experiments by name."""

    oracle: Oracle
    q: np.ndarray
    v: np.ndarray
    meetings: Meetings
    plans: Mapping[str, MotionPlan]
    precision: Precision = PRECISIONS[DOUBLE]
    levels: frozenset[str] = frozenset(LEVELS)
    _others: dict[Precision, Probes] = dataclasses.field(default_factory=dict, compare=False, repr=False)

    def of(self, engine: type[Engine]) -> Probes:
        """These probes, or the same for the numbers and the method of ``engine``: made once."""
        precision = precision_of(engine, self.oracle.world)
        if precision == self.precision:
            return self
        if precision not in self._others:
            plans = _plans(self.oracle, precision, self.levels)
            self._others[precision] = dataclasses.replace(self, plans=plans, precision=precision, _others={})
        return self._others[precision]

    def steps(self, engine: type[Engine]) -> Accelerations | None:
        """The accelerations that stand for what ``engine`` does not return; None where it returns all."""
        kinds = by_steps(self.oracle.world, engine)
        return plan_accelerations(self.oracle, self.q, self.v, self.of(engine).precision, kinds) if kinds else None

    @property
    def chaos(self) -> str:
        """Why the motion cannot be compared in any engine; "" where it can, or there is none."""
        planned = self.plans.get("motion") or self.plans.get("limit")
        return planned.chaos if isinstance(planned, (OracleMotion, LimitMotion)) else ""

    def operations(self, engine: type[Engine]) -> list[Operation]:
        """The operations for ``engine``, by its capabilities; :func:`engine_checks` reads the answers."""
        world = self.oracle.world
        lacking = unchecked(world, engine)
        operations = [
            Operation("read_back", world=world),
            Operation("kinematics", {}, {"q": self.q, "v": self.v}, world),
        ]
        quantities = [name for name in QUANTITIES if name not in engine.LACKS]
        if quantities:
            operations.append(dynamics_operation(self.oracle, self.q, self.v, quantities))
        if steps := self.steps(engine):
            operations.append(steps.operation(world))
        if ("L4", MATRIX) not in lacking:
            velocity = np.zeros((1, self.oracle.nv))
            operations.append(Operation("touching", {}, {"q": self.meetings.q, "v": velocity}, world))
        for name, plan in self.of(engine).plans.items():
            if lacking.keys().isdisjoint(EXPERIMENTS[name].parts) and (operation := plan.operation(world)) is not None:
                operations.append(operation)
        return operations


def prepare(world: World, levels: Iterable[str] = LEVELS, precision: str = DOUBLE, order: int = 0) -> Probes:
    """Choose the probes for ``world`` and run the oracle. ``precision``, and ``order`` of the method: of the first engine;
    others get theirs from :meth:`Probes.of`."""
    levels, numbers = set(levels), PRECISIONS[precision].of_order(order)
    oracle = touch.oracle_of(world)
    q, v = random_states(world, STATES if oracle.nv <= LARGE else FEW_STATES)
    meetings = touch.meetings_of(world) if "L4" in levels else touch.nothing(oracle)
    return Probes(oracle, q, v, meetings, _plans(oracle, numbers, levels), numbers, frozenset(levels))


def _prepare_first(world: World, levels: Iterable[str], engine: type[Engine]) -> Probes:
    """The probes for the numbers and the method of the first engine."""
    precision = precision_of(engine, world)
    return prepare(world, levels, precision.name, precision.order)


def precision_of(engine: type[Engine], world: World) -> Precision:
    """The numbers by which an engine computes, with the order of its method in ``world``."""
    method = engine.method(world)
    return PRECISIONS[engine.PRECISION].of_order(method.order if method else 0)


def _plans(oracle: Oracle, precision: Precision, levels: Iterable[str]) -> dict[str, MotionPlan]:
    """The plans of the experiments of ``levels``, by the operation."""
    planned = {
        name: experiment.plan(oracle.world, oracle, precision)
        for name, experiment in EXPERIMENTS.items()
        if experiment.level in levels and experiment.limit in (None, precision.order > 0)
    }
    return {name: plan for name, plan in planned.items() if plan is not None}


def verify(
    world: World,
    engines: Sequence[str],
    *,
    compiled: Mapping[str, Compiled] | None = None,
    artifacts: Mapping[str, Path] | None = None,
    levels: Iterable[str] = LEVELS,
    pythons: Mapping[str, str] | None = None,
    locate: Callable[[str], Location | None] = lambda path: None,
    deadline: float = DEADLINE,
    progress: Callable[[str], None] | None = None,
    probes: Probes | None = None,
    cache: bool = True,
    warm: WarmProcesses | None = None,
) -> Certificate:
    """Hold what every engine of ``engines`` makes of ``world`` against the world and the oracle.

    ``compiled``: the world compiled for these engines (default: compiled here); ``artifacts``: folders of its files
    by engine (default: written to a temporary one); ``pythons``: interpreters by engine;
    ``locate``: places in the spec, for errors; ``progress``: called with a line when something begins; ``probes``: from
    :func:`prepare`, to use again; ``cache``: take contact figures that were measured before; ``warm``: processes that engines
    are forked from (default: its own, since an engine is started twice where there is contact).
    An engine that fails is a failed check with its message, the others go on. Of one that is not installed
    (``Engine.FILES_ALONE``) the files are checked alone: its proof says that, and is not valid.
    Raises UnsupportedError when the world cannot be compiled for one of the engines.
    """
    say = progress or (lambda text: None)
    levels = set(levels)
    if compiled is None:
        compiled = compile_world(world, engines, locate, pythons=pythons)
    not_compared = left_out(world, levels)
    with contextlib.ExitStack() as stack:
        warm = warm or stack.enter_context(WarmProcesses())
        proofs = _of_files_alone(world, compiled, artifacts or {}, not_compared)
        order, compiled = tuple(compiled), {name: entry for name, entry in compiled.items() if name not in proofs}
        if not compiled:
            return Certificate(world.name, sha256(world), _oracle_version(), proofs)
        for name in compiled:
            process.begin(name, (pythons or {}).get(name), warm)
        folders = dict(artifacts or {})
        if not set(compiled) <= set(folders):
            place = stack.enter_context(scratch_folder("verify"))
            for name in compiled.keys() - folders.keys():
                folders[name] = place / name
                write_folder(compiled[name].files, folders[name])
        say("choosing probes")
        probes = probes or _prepare_first(world, levels, find_engine(next(iter(compiled))))
        running = {}
        refused: dict[str, EngineError] = {}
        for name in compiled:
            try:
                python = (pythons or {}).get(name)
                operations = probes.operations(find_engine(name))
                requested = start(name, folders[name], operations, python=python, deadline=deadline, warm=warm)
                running[name] = stack.enter_context(requested)
            except EngineError as error:
                refused[name] = error
        texts: dict[str, list[Check]] = {}
        read: dict[str, ReadBack] = {}
        replies: dict[str, Reply] = {}
        for name, compilation in compiled.items():
            say(f"verifying {name}")
            texts[name], understood = _text_checks(world, compilation, folders[name])
            if understood is not None:
                read[name] = understood
            try:
                if name in running:
                    replies[name] = running[name].wait(doing=functools.partial(at_work, say, f"verifying {name}"))
            except EngineError as error:
                refused[name] = error
        figures: dict[str, list[ProbeFigure]] = {}
        contact: dict[str, list[Check]] = {}
        if "L5" in levels and meeting_laws(world):
            sound = {name: (folders[name], read[name]) for name in replies if name in read}
            say("measuring contact")
            figures, contact = _contact(world, sound, pythons or {}, deadline, cache, say, warm)
        for name, compilation in compiled.items():
            checks = [*texts[name], *contact.get(name, [])]
            answered = replies.get(name) if name not in refused else refused[name]
            proof = _engine_proof(world, compilation, folders[name], checks, answered, probes, not_compared)
            proofs[name] = dataclasses.replace(proof, **_measured(world, levels, figures.get(name, ())))
    return Certificate(world.name, sha256(world), _oracle_version(), {name: proofs[name] for name in order})


def _measured(world: World, levels: Collection[str], figures: Sequence[ProbeFigure]) -> dict[str, Any]:
    """The part of a proof about contact: its figures, and their kinds of contact."""
    kinds = scope(world, (figure.probe for figure in figures)) if "L5" in levels else {}
    return {"contact": tuple(figures), "contact_scope": kinds}


def _of_files_alone(
    world: World, compiled: Mapping[str, Compiled], artifacts: Mapping[str, Path], not_compared: Mapping[str, str]
) -> dict[str, EngineProof]:
    """The proofs of the engines that are not installed, of which the files can be proven alone."""
    proofs = {}
    for name, compilation in compiled.items():
        engine = find_engine(name)
        if not (alone := engine.files_alone()):
            continue
        with contextlib.ExitStack() as stack:
            folder = artifacts.get(name)
            if folder is None:
                folder = stack.enter_context(scratch_folder("verify")) / name
                write_folder(compilation.files, folder)
            checks, _ = _text_checks(world, compilation, folder)
            parts = of_files_alone(not_compared, alone)
            proof = _proof(compilation, folder, checks, parts, None)
        proofs[name] = dataclasses.replace(proof, version="none", not_compared=dict(not_compared))
    return proofs


def _engine_proof(
    world: World,
    compiled: Compiled,
    folder: Path,
    checks: list[Check],
    answered: Reply | EngineError | None,
    probes: Probes,
    not_compared: Mapping[str, str],
) -> EngineProof:
    """The proof of one engine: ``checks`` of text and contact, and those of what it answered, or the error in its place."""
    engine = find_engine(compiled.engine)
    if probes.of(engine).chaos:
        not_compared = {**not_compared, **uncomparable(world, engine.PRECISION)}
    reply = answered if isinstance(answered, Reply) else None
    unreadable: dict[str, str] = {}
    if reply is not None:
        made, unreadable = engine_checks(world, engine, reply.answers, probes)
        checks = [*checks, *made]
    if isinstance(answered, EngineError):
        checks = [*checks, failed("L1", "engine", str(answered))]
    else:
        lacking = not_checked_parts(world, engine, not_compared)
        checks = [*checks, *shortfalls(world, checks, {**not_compared, **lacking})]
        unreadable = {**lacking, **unreadable}
    proof = _proof(compiled, folder, checks, unreadable, reply)
    convergence = None if reply is None else _convergence(engine, reply.answers, probes)
    return dataclasses.replace(proof, not_compared=dict(not_compared), convergence=convergence)


def _convergence(engine: type[Engine], answers: Sequence[Answer], probes: Probes) -> MotionLimit | None:
    """The figures of a motion in the limit; None where none was finite, or requested."""
    plan = probes.of(engine).plans.get("limit")
    if not isinstance(plan, LimitMotion) or plan.operation(probes.oracle.world) is None:
        return None
    requested = [operation.op for operation in probes.operations(engine)]
    poses = dict(zip(requested, answers, strict=True))["limit"].arrays["pose"] if "limit" in requested else None
    return plan.figures(poses) if poses is not None and np.isfinite(poses).all() else None


def _contact(
    world: World,
    files: Mapping[str, tuple[Path, ReadBack]],
    pythons: Mapping[str, str],
    deadline: float,
    cache: bool,
    say: Callable[[str], None],
    warm: WarmProcesses,
) -> tuple[dict[str, list[ProbeFigure]], dict[str, list[Check]]]:
    """Level L5 in every engine, side by side: figures and checks by engine. ``files``: by engine the folder of artifacts, and
    the model that the independent reader made of it."""
    figures: dict[str, list[ProbeFigure]] = {}
    checks: dict[str, list[Check]] = {}
    with contextlib.ExitStack() as stack:
        measuring = {}
        for name, (folder, read) in files.items():
            try:
                requested = measure(world, name, folder, pythons.get(name), deadline, cache, read, warm)
                measuring[name] = stack.enter_context(requested)
            except (UnsupportedError, EngineError) as error:
                checks[name] = [not_measured(error)]
        for name, measurement in measuring.items():
            try:
                figures[name], complaints = measurement.wait(
                    functools.partial(at_work, say, f"measuring contact in {name}")
                )
                checks[name] = contact_checks(figures[name])
                for complaint in complaints:
                    say(complaint)
            except EngineError as error:
                checks[name] = [not_measured(error)]
    return figures, checks


def _text_checks(world: World, compiled: Compiled, folder: Path) -> tuple[list[Check], ReadBack | None]:
    """The checks of level L0, and the model that the independent reader made of the files; None where it refuses them."""
    engine, dialect = find_engine(compiled.engine), dialects()[compiled.dialect]
    try:
        read = dialect.read(folder)
    except (
        ValueError,
        LookupError,
        TypeError,
        OSError,
        SyntaxError,
    ) as error:  # a reader's ways to refuse a damaged file
        message = f"the independent reader refuses the files: {type(error).__name__}: {error}"
        return [failed("L0", UNREAD, message)], None
    return compare(dialect.received(world), read, engine.RULES, engine.LAYERS, text=True), read


def read_back_checks(world: World, engine: type[Engine], read_back: ReadBack) -> list[Check]:
    """The engine's read-back against the world, as its dialect writes it: levels L1, L2 and L4."""
    label, world = sha256(world), dialects()[engine.DIALECT].received(world)
    cone, options = world.contact.friction_cone, world.options(engine.NAME)
    accepted = engine.ACCEPTED_CONES.get(cone) if f"contact.cone.{cone}" in options.accept else None
    checks = compare(
        world,
        read_back,
        engine.RULES,
        engine.LAYERS,
        accepted_cone=accepted,
        hull_precision=engine.HULL_PRECISION,
        precision=PRECISIONS[engine.PRECISION],
    )
    if Capability.INVENTORY in engine.LACKS:
        return checks
    expected = dict(engine.expected_inventory(world, read_back.neutral))
    expected |= {name: label for name in (WORLD_LABEL,) if name in expected}  # files name the world of the spec
    return checks + inventory_checks(expected, read_back.inventory, PRECISIONS[engine.PRECISION])


def engine_checks(
    world: World, engine: type[Engine], answers: Sequence[Answer], probes: Probes
) -> tuple[list[Check], dict[str, str]]:
    """The checks of the answers to ``probes.operations(engine)``, and the fields that are not readable back."""
    probes = probes.of(engine)
    oracle, q, v, numbers = probes.oracle, probes.q, probes.v, probes.precision
    requested = [operation.op for operation in probes.operations(engine)]
    by_operation = dict(zip(requested, answers, strict=True))
    read_back = by_operation["read_back"].read_back
    if read_back is None:
        raise ValueError("the answer to read_back contains no model")
    arrays = {name: answer.arrays for name, answer in by_operation.items()}
    checks = read_back_checks(world, engine, read_back)
    framed = read_back.frames is not None
    checks += kinematics_checks(world, oracle, q, v, arrays["kinematics"], numbers, framed)
    if "dynamics" in arrays:
        checks += dynamics_checks(world, oracle, q, v, arrays["dynamics"], numbers)
    if "accelerations" in arrays and (steps := probes.steps(engine)):
        checks += steps.checks(world, arrays["accelerations"], numbers)
    if "touching" in arrays:
        units = [(unit["body"], unit["shapes"]) for unit in by_operation["touching"].result["units"]]
        rounding = {(body.name, shape.name): shape.rounding for body in read_back.bodies for shape in body.shapes}
        touching = (units, arrays["touching"]["units"], engine.overlooks(world), rounding)
        checks += touch_checks(world, probes.meetings, *touching)
    for name, plan in probes.plans.items():
        if name in arrays:
            checks += plan.checks(world, arrays[name], engine.DRY_FRICTION_CREEP)
        elif isinstance(plan, LimitMotion) and plan.unseen:
            checks += plan.unmeasured()
    return checks, not_checked(world, read_back)


def _proof(
    compiled: Compiled, folder: Path, checks: list[Check], unreadable: dict[str, str], reply: Reply | None
) -> EngineProof:
    version = reply.versions["engine_version"] if reply else str(find_engine(compiled.engine).version())
    numbers = find_engine(compiled.engine).PRECISION
    seconds = round(reply.wall_seconds, 3) if reply else 0.0  # as a certificate prints it
    checks = sorted(checks, key=lambda check: check.level)
    return EngineProof(
        version,
        Artifacts.read(folder).sha256,
        tuple(checks),
        approximations(compiled.decisions),
        unreadable,
        seconds,
        precision=numbers,
    )


def _oracle_version() -> str:
    import pinocchio

    return f"pinocchio {pinocchio.__version__}"
