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
from simspec.engines.kit.process import DEADLINE, Answer, Operation, Reply, at_work, start
from simspec.engines.kit.registry import find_engine
from simspec.engines.kit.warm import WarmProcesses
from simspec.errors import EngineError, Location, UnsupportedError
from simspec.files import scratch_folder
from simspec.outputs.writing import Artifacts
from simspec.proof import control, forces, limits, motion
from simspec.proof import forces as dry_friction
from simspec.proof.certificate import Certificate, EngineProof
from simspec.proof.checks import PRECISIONS, Check, Precision, failed
from simspec.proof.comparator import compare, inventory_checks
from simspec.proof.contact.probe import Figure
from simspec.proof.contact.run import contact_checks, measure, not_measured
from simspec.proof.contact.scope import scope
from simspec.proof.control import Response, control_checks
from simspec.proof.expected import (
    MATRIX,
    approximations,
    left_out,
    motionless,
    not_checked,
    not_checked_parts,
    of_files_alone,
    shortfalls,
    unchecked,
    uncomparable,
)
from simspec.proof.forces import (
    FORCES_CHECK,
    PRESCRIBED_CHECK,
    SLIDING_CHECK,
    DryFriction,
    Followed,
    Pushed,
    dry_friction_checks,
    forces_checks,
)
from simspec.proof.limits import BALLS_CHECK, STOPS_CHECK, SumLimits, stops_checks
from simspec.proof.motion import Motion, motion_checks
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
from simspec.proof.touch.judge import touch_checks
from simspec.proof.touch.plan import Meetings
from simspec.world.canonical import sha256
from simspec.world.contact_pairs import meeting_laws
from simspec.world.types import ReadBack, World

LEVELS = ("L0", "L1", "L2", "L3", "L4", "L5", "L6", "L7")
"""L1, L2's fields and L4's come from one read-back; L5 is contact, measured in worlds of its own (``proof/contact/run.py``); L7
is control, in worlds that have it."""

UNREAD = "text"
"""Name of the check that fails when the independent reader refuses the files."""


@dataclass(frozen=True)
class Probes:
    """The oracle's side, computed once for all engines: states, meetings, motion."""

    oracle: Oracle
    q: np.ndarray
    v: np.ndarray
    meetings: Meetings
    motion: Motion | None
    response: Response | None = None
    rubbing: DryFriction | None = None
    pushed: Pushed | None = None
    followed: Followed | None = None
    stops: SumLimits | None = None
    precision: Precision = PRECISIONS[DOUBLE]
    _others: dict[str, Probes] = dataclasses.field(default_factory=dict, compare=False, repr=False)

    def of(self, engine: type[Engine]) -> Probes:
        """These probes, or the same held against what the numbers of ``engine`` allow: made once."""
        if self.precision.name == engine.PRECISION:
            return self
        if engine.PRECISION not in self._others:
            self._others[engine.PRECISION] = _planned_for(self, PRECISIONS[engine.PRECISION])
        return self._others[engine.PRECISION]

    def operations(self, engine: type[Engine]) -> list[Operation]:
        """What ``engine`` is asked, by what it declares; :func:`engine_checks` reads the answers."""
        if self.of(engine) is not self:
            return self.of(engine).operations(engine)
        world = self.oracle.world
        velocity = np.zeros((1, self.oracle.nv))
        lacking = unchecked(world, engine)
        asked = [
            Operation("read_back", world=world),
            Operation("kinematics", {}, {"q": self.q, "v": self.v}, world),
        ]
        quantities = [name for name in QUANTITIES if name not in engine.LACKS]
        if quantities:
            asked.append(dynamics_operation(self.oracle, self.q, self.v, quantities))
        if ("L4", MATRIX) not in lacking:
            asked.append(Operation("touching", {}, {"q": self.meetings.q, "v": velocity}, world))
        if self.motion is not None and not self.motion.chaos and ("L6", "motion") not in lacking:
            motion = self.motion
            arrays = {"q": motion.q, "v": motion.v, "effort": motion.effort, "rubbing": motion.rubbing}
            asked.append(Operation("motion", {"steps": motion.steps, "every": motion.every}, arrays, world))
        if self.rubbing is not None and ("L6", SLIDING_CHECK) not in lacking:
            asked.append(self.rubbing.operation(world))
        if self.stops is not None and ("L6", STOPS_CHECK) not in lacking and ("L6", BALLS_CHECK) not in lacking:
            asked.append(self.stops.operation(world))
        if self.response is not None and ("L7", "step response") not in lacking:
            asked.append(self.response.operation())
        if self.pushed is not None and ("L7", FORCES_CHECK) not in lacking:
            asked.append(self.pushed.operation(world))
        if self.followed is not None and ("L7", PRESCRIBED_CHECK) not in lacking:
            asked.append(self.followed.operation(world))
        return asked


def prepare(world: World, levels: Iterable[str] = LEVELS, precision: str = DOUBLE) -> Probes:
    """Choose the probes for ``world`` and run the oracle. ``precision``: of the engine that is asked first; others get
    theirs from :meth:`Probes.of`."""
    numbers = PRECISIONS[precision]
    oracle = touch.oracle_of(world)
    q, v = random_states(world, STATES if oracle.nv <= LARGE else FEW_STATES)
    wanted = set(levels)
    meetings = touch.meetings_of(world) if "L4" in wanted else touch.nothing(oracle)
    moving = motion.plan(world, oracle, numbers) if "L6" in wanted and not motionless(world) else None
    rubbing = dry_friction.plan_friction(world, oracle, numbers) if "L6" in wanted else None
    response = control.plan(world, numbers) if "L7" in wanted else None
    pushed = forces.plan(world, oracle, numbers) if "L7" in wanted else None
    followed = forces.plan_motions(world, numbers) if "L7" in wanted else None
    stops = limits.plan(world, oracle) if "L6" in wanted else None
    return Probes(oracle, q, v, meetings, moving, response, rubbing, pushed, followed, stops, numbers)


def _planned_for(probes: Probes, precision: Precision) -> Probes:
    """The same probes, those whose tolerance hangs on an engine's numbers planned again."""
    world, oracle = probes.oracle.world, probes.oracle
    return dataclasses.replace(
        probes,
        motion=probes.motion and motion.plan(world, oracle, precision),
        rubbing=probes.rubbing and dry_friction.plan_friction(world, oracle, precision),
        response=probes.response and control.plan(world, precision),
        pushed=probes.pushed and forces.plan(world, oracle, precision),
        followed=probes.followed and forces.plan_motions(world, precision),
        precision=precision,
        _others={},
    )


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

    ``compiled``: what compiling the world for these engines gave (default: compiled here); ``artifacts``: folders of its files
    by engine (default: written to a temporary one); ``pythons``: interpreters by engine;
    ``locate``: places in the spec, for errors; ``progress``: called with a line when something begins; ``probes``: from
    :func:`prepare`, to use again; ``cache``: take contact figures that were measured before; ``warm``: processes that engines
    are forked from (default: its own, since an engine is asked twice where there is contact).
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
        order, compiled = tuple(compiled), {name: one for name, one in compiled.items() if name not in proofs}
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
        probes = probes or prepare(world, levels, find_engine(next(iter(compiled))).PRECISION)
        running = {}
        refused: dict[str, EngineError] = {}
        for name in compiled:
            try:
                python = (pythons or {}).get(name)
                operations = probes.operations(find_engine(name))
                asked = start(name, folders[name], operations, python=python, deadline=deadline, warm=warm)
                running[name] = stack.enter_context(asked)
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
        figures: dict[str, list[Figure]] = {}
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


def _measured(world: World, levels: Collection[str], figures: Sequence[Figure]) -> dict[str, Any]:
    """What a proof says of contact: its figures, and which kinds of contact they are of."""
    kinds = scope(world, (figure.probe for figure in figures)) if "L5" in levels else {}
    return {"contact": tuple(figures), "contact_scope": kinds}


def _of_files_alone(
    world: World,
    compiled: Mapping[str, Compiled],
    artifacts: Mapping[str, Path],
    not_compared: Mapping[str, str],
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
    moving = probes.of(engine).motion
    if moving is not None and moving.chaos:
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
    return dataclasses.replace(proof, not_compared=dict(not_compared))


def _contact(
    world: World,
    files: Mapping[str, tuple[Path, ReadBack]],
    pythons: Mapping[str, str],
    deadline: float,
    cache: bool,
    say: Callable[[str], None],
    warm: WarmProcesses,
) -> tuple[dict[str, list[Figure]], dict[str, list[Check]]]:
    """Level L5 in every engine, side by side: figures and checks by engine. ``files``: by engine the folder of artifacts, and
    the model that the independent reader made of it."""
    figures: dict[str, list[Figure]] = {}
    checks: dict[str, list[Check]] = {}
    with contextlib.ExitStack() as stack:
        measuring = {}
        for name, (folder, read) in files.items():
            try:
                asked = measure(world, name, folder, pythons.get(name), deadline, cache, read, warm)
                measuring[name] = stack.enter_context(asked)
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
    engine = find_engine(compiled.engine)
    try:
        read = dialects()[compiled.dialect].read(folder)
    except (
        ValueError,
        LookupError,
        TypeError,
        OSError,
        SyntaxError,
    ) as error:  # a reader's ways to refuse a damaged file
        message = f"the independent reader refuses the files: {type(error).__name__}: {error}"
        return [failed("L0", UNREAD, message)], None
    return compare(world, read, engine.RULES, engine.LAYERS, text=True), read


def read_back_checks(world: World, engine: type[Engine], read_back: ReadBack) -> list[Check]:
    """What the engine says it holds against the world: levels L1, L2 and L4."""
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
    expected = engine.expected_inventory(world, read_back.neutral)
    return checks + inventory_checks(expected, read_back.inventory, PRECISIONS[engine.PRECISION])


def engine_checks(
    world: World, engine: type[Engine], answers: Sequence[Answer], probes: Probes
) -> tuple[list[Check], dict[str, str]]:
    """The checks of everything that ``probes.operations(engine)`` asked, and what the engine could not be asked for."""
    probes = probes.of(engine)
    numbers = probes.precision
    asked = [operation.op for operation in probes.operations(engine)]
    by_operation = dict(zip(asked, answers, strict=True))
    read_back = by_operation["read_back"].held
    if read_back is None:
        raise ValueError("the answer to read_back contains no model")
    arrays = {name: answer.arrays for name, answer in by_operation.items()}
    checks = read_back_checks(world, engine, read_back)
    told = read_back.frames is not None
    checks += kinematics_checks(world, probes.oracle, probes.q, probes.v, arrays["kinematics"], numbers, told)
    if "dynamics" in arrays:
        checks += dynamics_checks(world, probes.oracle, probes.q, probes.v, arrays["dynamics"], numbers)
    if "touching" in arrays:
        units = [(unit["body"], unit["shapes"]) for unit in by_operation["touching"].result["units"]]
        overlooks = engine.overlooks(world)
        rounding = {(body.name, shape.name): shape.rounding for body in read_back.bodies for shape in body.shapes}
        checks += touch_checks(world, probes.meetings, units, arrays["touching"]["units"], overlooks, rounding)
    if probes.motion is not None and not probes.motion.chaos and "motion" in arrays:
        checks += motion_checks(world, probes.motion, arrays["motion"])
    if probes.rubbing is not None and "trials" in arrays:
        checks += dry_friction_checks(world, probes.rubbing, arrays["trials"], engine.DRY_FRICTION_CREEP)
    if probes.stops is not None and "stopped" in arrays:
        checks += stops_checks(world, probes.stops, arrays["stopped"])
    if probes.response is not None and "respond" in arrays:
        checks += control_checks(probes.response, arrays["respond"])
    if probes.pushed is not None and "pushed" in arrays:
        checks += forces_checks(probes.pushed, arrays["pushed"])
    if probes.followed is not None and "prescribed" in arrays:
        checks += forces.motion_checks(probes.followed, arrays["prescribed"])
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
