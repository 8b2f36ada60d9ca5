"""A study from its file: read, validated, and made into the specs of its sweeps."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from pydantic import ValidationError

from simspec.errors import Problem, SpecError
from simspec.language.document import Document, read
from simspec.language.foreign import ImportOptions
from simspec.language.load import Spec, load
from simspec.language.overrides import Override
from simspec.language.problems import in_order, of_validation
from simspec.language.sources import project_folder
from simspec.language.strict import Strict, bounded_suggestions, near, show
from simspec.language.study import Figure, FiguresFile, StudyFile, StudySweep

Model = TypeVar("Model", bound=Strict)


@dataclass(frozen=True)
class SweepOfStudy:
    """One sweep of a study: its name, what the study says of it, and the spec that is swept. ``changed``: the values that were
    put into the scenario, by path."""

    name: str
    words: StudySweep
    spec: Spec
    changed: Mapping[str, Any]


class StudySource:
    """A study that was read and checked. ``data``: the model of the file; ``figures``: those that it is held against."""

    def __init__(self, path: Path, document: Document, data: StudyFile, allow_outside: bool, options: ImportOptions):
        self.path, self.data = path, data
        self._document = document
        self._project = None if allow_outside else project_folder(path)
        self._allow_outside, self._options = allow_outside, options
        self.figures: tuple[Figure, ...] = ()
        self.figures_source = ""

    @property
    def name(self) -> str:
        """The study's name."""
        return self.data.name

    def files(self) -> list[Path]:
        """Every file that the study itself is made of."""
        folder = self.path.parent
        named = [sweep.spec for sweep in self.data.sweeps.values()]
        return [self.path, *(folder / text for text in (*named, *([self.data.figures] if self.data.figures else ())))]

    def sweeps(self, small: bool = False) -> list[SweepOfStudy]:
        """The sweeps of the study, in its order; ``small``: those of the small study. Raises SpecError with every problem,
        located in the study where it says the values, else in the scenario."""
        made: list[SweepOfStudy] = []
        problems: list[Problem] = []
        for name, words in self.data.sweeps.items():
            if small and words.small is None:
                continue
            try:
                made.append(self._sweep(name, words, small))
            except SpecError as error:
                problems += error.problems
        if not made and not problems:
            message, hint = "no sweep of the study is part of the small one", "small: {}"
            problems.append(self._document.problem(("sweeps",), message, hint=hint))
        if problems:
            raise SpecError(list(dict.fromkeys(problems)))
        return made

    def _sweep(self, name: str, words: StudySweep, small: bool) -> SweepOfStudy:
        place = ("sweeps", name)
        path = self._file((*place, "spec"), words.spec)
        overrides: list[Override] = []
        changed: dict[str, Any] = {}
        swept: dict[str, Any] = {}
        for steps, part in self._parts(place, small):
            for key, value in part.get("set", {}).items():
                changed[key] = value
                where = (*steps, "set", key)
                overrides.append(
                    Override(key, value, self._document.locate(where, key=True), self._document.locate(where))
                )
            swept.update(part.get("sweep", {}))
        spec = load(path, allow_outside=self._allow_outside, options=self._options)
        if swept:
            sweep = spec.source.document.data.get("sweep", {})
            here = self._document.locate((*place, "sweep"), key=True)
            overrides.append(Override("sweep", {**sweep, **swept}, here, here))
        return SweepOfStudy(name, words, spec.with_overrides(overrides) if overrides else spec, changed)

    def _parts(self, place: tuple[str, ...], small: bool) -> Iterator[tuple[tuple[str, ...], Mapping[str, Any]]]:
        """The parts of a sweep as plain data; later ones take precedence."""
        whole = self._document.data["sweeps"][place[-1]]
        yield place, whole
        if small:
            yield (*place, "small"), whole["small"]

    def read_figures(self) -> None:
        """Read the file of figures. Raises SpecError with every problem of it."""
        if self.data.figures is None:
            return
        path = self._file(("figures",), self.data.figures)
        document = read(path)
        file = _model(document, FiguresFile, "a file of figures starts with simspec_figures: 1")
        problems = [
            document.problem(
                ("figures", index, "sweep"),
                "the study has no such sweep",
                found=figure.sweep,
                allowed=", ".join(self.data.sweeps),
                hint=near(figure.sweep, self.data.sweeps),
            )
            for index, figure in enumerate(file.figures)
            if figure.sweep not in self.data.sweeps
        ]
        if problems:
            raise SpecError(problems)
        self.figures, self.figures_source = tuple(file.figures), file.source

    def _file(self, place: tuple[str, ...], text: str) -> Path:
        """The file that the study names. Raises SpecError where there is none, or where it may not be read."""
        path = self.path.parent / text
        try:
            target = path.resolve()
            there = target.is_file()
        except (OSError, RuntimeError, ValueError):  # links that lead to themselves, names that are too long
            there = False
        if not there:
            raise SpecError([self._document.problem(place, "no such file", found=show(text))])
        inside = self._project is None or target.is_relative_to(self._project) or self._options.allows(target)
        if not inside:
            hint = self._options.way_outside()
            raise SpecError([self._document.problem(place, "leaves the project folder", found=text, hint=hint)])
        return path


def load_study_file(
    path: str | Path, *, allow_outside: bool = False, options: ImportOptions | None = None
) -> StudySource:
    """Read and validate a study and its file of figures. The scenarios are read by :meth:`StudySource.sweeps`.

    ``spec`` and ``figures`` may leave the study's project folder only with ``allow_outside``, or into a folder that ``options``
    allow, by which robot files are read too. Raises SpecError with every
    problem, located.
    """
    path = Path(path)
    document = read(path)
    data = _model(document, StudyFile, "a study starts with simspec_study: 1")
    source = StudySource(path, document, data, allow_outside, options or ImportOptions())
    source.read_figures()
    return source


def _model(document: Document, root: type[Model], hint: str) -> Model:
    if not isinstance(document.data, dict):
        found = "an empty file" if document.data is None else show(document.data)
        raise SpecError([document.problem((), "expected a mapping (key: value)", found=found, hint=hint)])
    with bounded_suggestions():
        problems = list(document.problems)
        try:
            model = root.model_validate(document.data)
        except ValidationError as error:
            problems += of_validation(error, document, root)
    if problems:
        raise SpecError(in_order(problems))
    return model
