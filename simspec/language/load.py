"""A spec from a file, or from Python objects; a study from its file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from pydantic import ValidationError

from simspec.errors import Location, Problem, SpecError
from simspec.language.checks import check
from simspec.language.document import Document, read
from simspec.language.foreign import Imported, ImportOptions, suffixes
from simspec.language.instances import instance
from simspec.language.models import VERSION, File
from simspec.language.overrides import Override, apply, check_sweep, overridden, without_effect
from simspec.language.packages import Package, digests, is_packaged, packaged
from simspec.language.problems import in_order, of_validation
from simspec.language.sources import (
    Source,
    SourceCollector,
    of_package,
    open_document,
    parameters_of,
    project_folder,
    validate,
)
from simspec.language.strict import ABSENT, Strict, bounded_suggestions, near, show
from simspec.language.sweep import Figure, FiguresFile, StudyFile, StudySweep
from simspec.language.trees import too_much
from simspec.plugins import Method

if TYPE_CHECKING:
    from simspec.world.types import World


class Spec:
    """A spec that was read and checked as far as words, units, names and references go.

    ``data`` is the pydantic model of the file (SI numbers), ``path`` its path (None for a spec made in Python),
    ``source`` the file with its line numbers and the model files that it uses.
    """

    def __init__(self, source: Source, path: Path | None = None, collector: SourceCollector | None = None):
        if source.file is None:
            raise ValueError("a spec needs a file without errors")
        self.source = source
        self.path = path
        self.data: File = source.file
        self._place = path or source.folder / "<data>"
        self._collector = collector or SourceCollector(project_folder(self._place))

    @property
    def name(self) -> str:
        """The spec's name."""
        return self.data.name

    def is_model_without_duration(self, sets: Sequence[str]) -> bool:
        """Whether this is the file of a model that says no duration, and no ``path=value`` of ``sets`` does."""
        said = any(text.partition("=")[0].strip() in ("physics", "physics.duration") for text in sets)
        return self.data.model is not ABSENT and self.data.physics.duration == 0.0 and not said

    def __repr__(self) -> str:
        return f"<Spec {self.name!r} from {self.path or 'Python'}>"

    @classmethod
    def from_data(
        cls, data: File | Mapping[str, Any], *, folder: str | Path = ".", allow_outside: bool = False
    ) -> Spec:
        """A spec from the language's models or from plain data as a YAML file would hold (``simspec: 1`` may be left
        out). ``use`` paths are relative to ``folder``. Raises SpecError with every problem."""
        plain = _plain(data)
        if isinstance(data, File) and isinstance(plain.get("model"), dict):
            plain["model"].pop("parameters", None)  # numbers stand where its quantities referred to them
        if isinstance(plain, dict):
            plain = {"simspec": VERSION, **plain}
        folder = Path(folder)
        return _checked(Document("<data>", plain), folder, None, folder / "<data>", allow_outside)

    def packages(self) -> dict[str, dict[str, Any]]:
        """The files of installed packages that the spec was read from, by the package's name (``package://NAME``): its version
        or commit, and the SHA-256 of each file by its path in the package. Empty where there are none."""
        files: dict[Path, Package] = {}
        known: dict[Path, str] = {}
        for source in self.source.all():
            files.update(source.packaged)
            if source.package is None:
                continue
            read = {source.path} if source.path is not None else set()
            if source.imported is not None:
                known.update(source.imported.read)
                read.update(source.imported.read, source.imported.files.values())
            files.update((path, source.package) for path in read if path.is_relative_to(source.package.root))
        return digests(files, known)

    def locate(self, path: str) -> Location | None:
        """The place of a dotted path of the spec or of its world (``bodies.ball_017.mass``), or of the nearest thing
        around it; None for a spec that was made in Python."""
        from simspec.language.locate import locate

        return locate(self.source, path)

    def with_overrides(self, overrides: Sequence[Override]) -> Spec:
        """This spec with values put into it, validated and checked as a whole; this one stays as it is. Model files that it
        uses already are not read again. Raises SpecError with every problem, located where the overrides were written."""
        document, problems = overridden(self.source.written or self.source.document, overrides)
        changed = {override.path for override in overrides}
        return _validated(
            document,
            self.source.folder,
            self.path,
            self._place,
            self._collector.again(),
            problems,
            changed,
            self.source.imported,
            self.source.package,
        )

    def sources_with(self, overrides: Sequence[Override]) -> tuple[Source, list[Problem]]:
        """The files that the spec would use with values put into it, and the problems of finding and reading them. Nothing is
        validated."""
        document, problems = overridden(self.source.written or self.source.document, overrides)
        document, _ = instance(document, None)
        source = Source(document, self.source.folder, imported=self.source.imported, package=self.source.package)
        collector = self._collector.again()
        collector.collect(source, (self._place.resolve(),))
        return source, [*problems, *collector.problems]

    sweep = Method("simspec.api:sweep")

    def resolve(self) -> World:
        """The world: frozen, SI, every default filled. Raises SpecError with every problem found."""
        from simspec.resolve import resolve

        return resolve(self.source)

    def warnings(self, world: World | None = None) -> list[Problem]:
        """Warnings: values that are allowed and look like slips, each with its place and a hint; ``world`` where the spec has
        been resolved already. Raises SpecError as :meth:`resolve`."""
        from simspec.resolve.warnings import warnings

        return warnings(self.source, world or self.resolve())

    def to_yaml(self) -> str:
        """The spec as YAML text in the canonical layout, overrides included."""
        from simspec.language.formatting import format_data

        return format_data((self.source.written or self.source.document).data)


def load(
    path: str | Path, *, sets: Sequence[str] = (), allow_outside: bool = False, options: ImportOptions | None = None
) -> Spec:
    """Read, override (``sets``: texts ``path=value``), validate and check a spec and the model files that it uses. A file of
    another language is imported (``options``).

    ``use`` may leave the project folder (the nearest one above with .git or pyproject.toml, else the file's own) only
    with ``allow_outside``. Raises SpecError with every problem, located.
    """
    options, shown = options or ImportOptions(), str(path)
    if is_packaged(shown):
        options = of_package(options, found := packaged(shown, suffixes()))
        path = found.path
    path = Path(path)
    if options.package is not None:
        shown = options.shown(path)
    project = options.package.root if options.package is not None else project_folder(path)
    options = replace(options, project=None if allow_outside else project)
    document, imported = open_document(path, shown, options)
    return _checked(document, path.parent, path, path, allow_outside, sets, imported, options)


def _checked(
    document: Document,
    folder: Path,
    path: Path | None,
    place: Path,
    allow_outside: bool,
    sets: Sequence[str] = (),
    imported: Imported | None = None,
    options: ImportOptions | None = None,
) -> Spec:
    with bounded_suggestions():
        problems = apply(document, sets) if isinstance(document.data, dict) else []
    package = options.package if options is not None else None
    project = package.root if package is not None else project_folder(place)
    # the package of a file is not that of the files that it uses
    others = replace(options, package=None) if options is not None else None
    collector = SourceCollector(None if allow_outside else project, others)
    changed = {text.partition("=")[0].strip() for text in sets}
    return _validated(document, folder, path, place, collector, problems, changed, imported, package)


def _validated(
    document: Document,
    folder: Path,
    path: Path | None,
    place: Path,
    collector: SourceCollector,
    problems: Sequence[Problem],
    changed: Set[str],
    imported: Imported | None = None,
    package: Package | None = None,
) -> Spec:
    """The spec of a document. ``place``: the file that it stands for; ``problems``: those of putting values at the paths
    ``changed``."""
    with bounded_suggestions():
        written, (document, wrong) = document, instance(document, None)
        file, more = validate(document)
        problems = [*problems, *document.problems, *wrong, *more]
        source = Source(document, folder, file, imported=imported, package=package, path=path, written=written)
        collector.collect(source, (place.resolve(),))
        # checks that visit a file for each model that uses it are made only where their number is bounded
        problems += [*collector.problems, *(too_much(source) or check(source))]
        if file is not None:
            problems += [
                *check_sweep(written, file.sweep, parameters_of(source)),
                *without_effect(document, file, changed),
            ]
    if problems:
        raise SpecError(in_order(problems))
    return Spec(source, path, collector)


def _plain(value: Any) -> Any:
    """Nested mappings, sequences, arrays and models as dicts and lists."""
    from pydantic import BaseModel

    if isinstance(value, BaseModel):
        return _plain(value.model_dump(exclude_unset=True))
    if hasattr(value, "tolist"):  # an array of numpy
        return value.tolist()
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    return value


# A study: read, validated, and made into the specs of its sweeps.

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
            problems.append(self._document.problem(("sweeps",), message, hint=hint, code="S806"))
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
                code="S302",
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
            raise SpecError([self._document.problem(place, "no such file", found=show(text), code="S305")])
        inside = self._project is None or target.is_relative_to(self._project) or self._options.allows(target)
        if not inside:
            hint = self._options.way_outside()
            raise SpecError(
                [self._document.problem(place, "leaves the project folder", found=text, hint=hint, code="S306")]
            )
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
        raise SpecError([document.problem((), "expected a mapping (key: value)", found=found, hint=hint, code="S104")])
    with bounded_suggestions():
        problems = list(document.problems)
        try:
            model = root.model_validate(document.data)
        except ValidationError as error:
            problems += of_validation(error, document, root)
    if problems:
        raise SpecError(in_order(problems))
    return model
