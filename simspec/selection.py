"""The engines that a command takes, and those that it leaves out with the reason.

One rule for every command. An engine that the user names has to do the work: when it is not installed, or does not support the
world, the command fails. Where no engine is named, every engine that can do the work is taken; the others are listed.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from simspec.compiler import Compiled, compile_world
from simspec.engines.kit.registry import auditors, engines, find_engine, left_out, not_installed
from simspec.errors import Location, Problem, UnsupportedError
from simspec.option_checks import check_control, check_options
from simspec.support.features import Feature
from simspec.world.types import World


@dataclass(frozen=True, slots=True)
class NotTaken:
    """An engine that is left out: why in one line, the place in the spec, and every problem (none: it is not installed).

    ``acceptable``: whether it takes the world once its approximations are accepted by name (``simspec accept``).
    """

    reason: str
    location: Location | None = None
    problems: tuple[Problem, ...] = ()
    acceptable: bool = False

    def __str__(self) -> str:
        return self.reason + (f" ({self.location})" if self.location else "")


@dataclass(frozen=True)
class Selection:
    """``engines`` by label, in order; ``named``: whether the user named them; ``not_taken``: the others, by name.

    ``compiled``: the artifacts of each of ``engines``, where compiling a world has chosen them; None: nothing is compiled yet.
    """

    engines: tuple[str, ...]
    named: bool
    not_taken: Mapping[str, NotTaken]
    compiled: Mapping[str, Compiled] | None = None
    pythons: Mapping[str, str] = field(default_factory=dict)
    """Interpreters by label, of engines that have one of their own."""

    def lines(self) -> list[str]:
        """Every engine that is not taken, with the reason and the place in the spec."""
        return [f"{name}: {taken}" for name, taken in self.not_taken.items()]

    def leave(self, reasons: Mapping[str, str]) -> Selection:
        """This selection without some of its engines, each with the reason why it is left out."""
        kept = tuple(name for name in self.engines if name not in reasons)
        left = {name: NotTaken(reasons[name]) for name in self.engines if name in reasons}
        return dataclasses.replace(self, engines=kept, not_taken={**self.not_taken, **left})

    def for_world(
        self, world: World, locate: Callable[[str], Location | None] = lambda path: None, least: int = 1
    ) -> Selection:
        """The engines of this selection that support ``world``, with its artifacts for them: support is what compiling says.

        Named engines stay, not compiled: the step that compiles for them raises their refusals. Raises
        UnsupportedError, with every problem, when fewer than ``least`` engines are left, and for what is wrong whatever the
        engine is.
        """
        if self.named:
            return self
        if general := [*check_options(world, locate), *check_control(world, locate)]:
            raise UnsupportedError(general)
        compiled, left = supporting(world, self.engines, locate, self.pythons)
        not_taken = {**self.not_taken, **left}
        if len(compiled) < least:
            raise UnsupportedError(_too_few(list(compiled), least, not_taken))
        return Selection(tuple(compiled), False, not_taken, compiled, self.pythons)


def supporting(
    world: World,
    names: Iterable[str],
    locate: Callable[[str], Location | None],
    pythons: Mapping[str, str] | None = None,
) -> tuple[dict[str, Compiled], dict[str, NotTaken]]:
    """The compiled files of ``world`` for the engines that support it, and the other engines with the reason."""
    compiled: dict[str, Compiled] = {}
    left: dict[str, NotTaken] = {}
    for name in names:
        try:
            compiled |= compile_world(world, [name], locate, pythons=pythons)
        except UnsupportedError as error:
            left[name] = dataclasses.replace(refusal(error.problems), acceptable=acceptable(world, name, pythons))
    return compiled, left


def acceptable(world: World, name: str, pythons: Mapping[str, str] | None) -> bool:
    """Whether an engine supports ``world`` where everything is accepted that can be."""
    words = tuple(feature.value for feature in Feature)
    options = dataclasses.replace(world.options(name), accept=words, outside=words)
    others = tuple(engine for engine in world.engines if engine.engine != options.engine)
    try:
        compile_world(dataclasses.replace(world, engines=(*others, options)), [name], pythons=pythons)
    except UnsupportedError:
        return False
    return True


def refusal(problems: Sequence[Problem]) -> NotTaken:
    """The reason why an engine does not support a world, in one line: the first problem, and the number of the others."""
    first, more = problems[0], len(problems) - 1
    reason = first.message + (f"; and {more} more problem{'s' if more > 1 else ''}" if more else "")
    return NotTaken(reason, first.location, tuple(problems))


def _too_few(taken: Sequence[str], least: int, not_taken: Mapping[str, NotTaken]) -> list[Problem]:
    problems = [problem for taken in not_taken.values() for problem in taken.problems]
    absent = [f"{name}: {taken.reason}" for name, taken in not_taken.items() if not taken.problems]
    words = f"at least {least} engines" if least > 1 else "one engine"
    problem = Problem(
        f"{words} must support this world, and {', '.join(taken) or 'none'} does",
        found="; ".join(absent) or None,
        hint=f"run it alone: --engine {taken[0]}" if taken else None,
        code="E109",
    )
    return [*problems, problem]


def available(pythons: Mapping[str, str], audits: bool = False) -> Selection:
    """Every engine that is installed here, or has an interpreter in ``pythons``; the others with the way to install them.
    ``audits``: also engines that audit robot files and run no world, where they are installed."""
    impossible = left_out()
    taken, not_taken = [], {}
    for name, engine in engines().items():
        if name in pythons or engine.version() is not None:
            taken.append(name)
        elif name in impossible:
            not_taken[name] = NotTaken(f"{impossible[name]}; --python {name}=PATH runs it in another Python")
        else:
            not_taken[name] = NotTaken(not_installed(engine))
    if audits:
        taken += [name for name, engine in auditors().items() if name in pythons or engine.version() is not None]
    return Selection(tuple(taken), False, not_taken, pythons=pythons)


def compiling(labels: Iterable[str]) -> dict[str, str]:
    """The engines among ``labels`` that compile a program for each model, each with the reason to leave it out by default: the
    time that this may take."""
    seconds = {label: find_engine(label).COMPILING for label in labels}
    return {
        label: f"compiles for each model, for up to {time:.0f} s: --every-engine, or --engine {label}"
        for label, time in seconds.items()
        if time > 0.0
    }


def known() -> Selection:
    """Every known engine, installed or not: for what is about files."""
    return Selection(tuple(engines()), False, {})


def named(labels: Iterable[str], pythons: Mapping[str, str] | None = None) -> Selection:
    """The engines that the user named, with interpreters of their own by label."""
    return Selection(tuple(labels), True, {}, pythons=pythons or {})
