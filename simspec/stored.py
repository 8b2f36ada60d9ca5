"""JSON that simspec reads back from a disk, validated at one place: others may have edited or replaced it.

Each file has a model of its outline here; a file that does not fit is a :class:`SpecError` that names it and says where.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from simspec.errors import Problem, SpecError
from simspec.files import NotReadableError, parse_json

Model = TypeVar("Model", bound=BaseModel)


class Stored(BaseModel):
    """Base of the outlines: no unknown keys, no conversions, no NaN and no infinity."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False, defer_build=True)


class FolderMarker(Stored):
    """``simspec-folder.json``: the marker of a folder that simspec made, with the files that it wrote."""

    simspec_folder: int
    kind: str
    files: list[str]


class StagingMarker(Stored):
    """``simspec-staging.json``: a place next to a target in which its new content is being built.

    ``target``: the target's name; ``fresh``: device and inode of the new content, once that exists.
    """

    simspec_staging: int
    target: str
    fresh: list[int] | None = None


class StoredProof(Stored):
    """One engine's part of ``certificate.json``; ``valid`` and ``verdict`` are written for readers, and not read."""

    version: str
    valid: bool
    verdict: str
    artifacts_sha256: str
    seconds: float
    approximations: dict[str, str]
    not_checked: dict[str, str]
    not_compared: dict[str, str]
    checks: list[dict[str, Any]]
    contact: list[dict[str, Any]]
    precision: str = "double"
    contact_scope: dict[str, str] = {}
    convergence: dict[str, Any] | None = None


class StoredCertificate(Stored):
    """``certificate.json``. Its verdicts follow from its checks (``proof/judge.py``); ``valid`` is not read."""

    sha256: str
    schema_: int = Field(alias="schema")
    valid: bool
    simspec: str
    name: str
    world_sha256: str
    oracle: str
    engines: dict[str, StoredProof]


class CacheEntry(Stored):
    """An entry of the cache of contact figures."""

    simspec_cache: int
    key: str
    sha256: str
    figures: list[dict[str, Any]]


class MeshEntry(Stored):
    """An entry of the cache of meshes. ``made``: JSON, kept as text, whose hash costs less than that of what it says."""

    simspec_mesh: int
    key: str
    sha256: str
    made: str


class DrawnEntry(Stored):
    """An entry of the cache of drawn surfaces. ``made``: JSON, kept as text."""

    simspec_drawn: int
    key: str
    sha256: str
    made: str


class StoredTable(Stored):
    """One table of a saved run: the hash of its file, and its rows."""

    sha256: str
    rows: int = Field(ge=0)


class StoredControl(BaseModel):
    """The controllers of a saved run, as far as its tables depend on them."""

    model_config = ConfigDict(extra="allow", strict=True, frozen=True)

    joints: list[str]


class Provenance(BaseModel):
    """``provenance.json`` of a saved run: fields that are read must be of their type, the rest is kept as it is."""

    model_config = ConfigDict(extra="allow", strict=True, frozen=True, allow_inf_nan=False, populate_by_name=True)

    schema_: int = Field(alias="schema")
    world_sha256: str
    engine: str = Field(min_length=1, max_length=100)
    engine_version: str | None = None
    failed: str | None
    tables: dict[str, StoredTable]
    sha256: str
    steps: int = Field(default=0, ge=0)
    seconds: dict[str, float] = {}
    perturb: float = 0.0
    warnings: list[str] = []
    control: StoredControl | None = None
    contact_groups: list[list[str]] | None = None
    looks: str | None = None

    def plain(self) -> dict[str, Any]:
        """The provenance of the run itself, without the fields that saving added."""
        kept = self.model_dump(by_alias=True, exclude_unset=True)
        return {key: value for key, value in kept.items() if key not in ("failed", "tables", "looks", "sha256")}


class StoreFacts(Stored):
    """``store.json`` of a store of sweeps; ``made_by``: the version of simspec that made it."""

    simspec_store: int
    made_by: str


class SweptRun(Stored):
    """``run.json`` of a run in a store of sweeps.

    ``result``: the part that the same case reproduces to the bit, its tables by name; ``request``: the first request for the
    case, on which no run depends; ``circumstances`` and ``circumstance_tables``: when, how long, on what. ``result_sha256`` and
    ``sha256``: hashes of ``result``, and of all but itself.
    """

    schema_: int = Field(alias="schema")
    key: str
    result: SweptResult
    request: SweptRequest = Field(alias="asked")
    circumstances: dict[str, Any]
    circumstance_tables: dict[str, StoredTable] = {}
    result_sha256: str
    sha256: str

    @property
    def tables(self) -> dict[str, StoredTable]:
        """All tables of the run: those of its result, and those that a repetition does not give again."""
        return {**self.result.tables, **self.circumstance_tables}


class SweptResult(Stored):
    """The part of a run in a store that is the same in every repetition; ``world``: the hash of the world without its name,
    its expectations and its options of engines; ``summary``: quantities at the end, those that are not finite as words."""

    world: str
    engine: str = Field(min_length=1, max_length=100)
    failed: str | None
    provenance: dict[str, Any]
    summary: dict[str, float | str]
    tables: dict[str, StoredTable]


class SweptRequest(Stored):
    """The first request for a run in a store: the cell (its key, its changes), and the parts of its
    world that a run does not depend on."""

    cell: dict[str, Any] | None
    name: str
    world_sha256: str
    expectations: list[dict[str, Any]]
    outcomes: list[dict[str, Any]]
    engines: list[dict[str, Any]]
    spec: dict[str, Any]
    artifacts_sha256: str | None


class FloorFacts(Stored):
    """The description of the table of an engine's noise; ``run``: the hash of its run's provenance."""

    engine: str
    bitwise: bool | None
    perturbation: float | None
    run: str
    sha256: str


class CachedNoise(Stored):
    """An engine's noise in the user's cache; ``numbers``: position and angle (2, rows, bodies), packed; ``sha256``: of them."""

    simspec_noise: int
    key: str
    bitwise: bool | None
    perturbation: float | None
    sha256: str
    numbers: str


class StoredMachine(Stored):
    """The machine that a baseline was made on; memory in bytes."""

    cpu: str
    architecture: str
    cores: int
    threads: int
    governor: str
    memory: int
    kernel: str
    python: str


class StoredFigure(Stored):
    """One figure of a baseline: numbers, for each the interval of indistinguishable values, and why it is not compared."""

    key: str
    kind: Literal["physics", "verdict", "speed"]
    unit: str
    value: list[float]
    interval: list[Annotated[list[float], Field(min_length=2, max_length=2)]]
    not_compared: str


class StoredBaseline(Stored):
    """The figures of a study, for later ones to be compared with."""

    simspec_baseline: int
    simspec: str
    spec: str
    world_sha256: str
    versions: dict[str, str]
    machine: StoredMachine
    figures: list[StoredFigure]


class Report(BaseModel):
    """``report.json``, as far as a later study of the same world takes it over."""

    model_config = ConfigDict(extra="allow", strict=True, frozen=True, populate_by_name=True)

    schema_: int = Field(alias="schema")
    world_sha256: str
    runs: dict[str, dict[str, Any]]
    floors: dict[str, dict[str, Any]]
    diffs: list[dict[str, Any]]
    left_out: dict[str, str] = {}


class StoredCell(Stored):
    """A cell of a table, with its classes on a page."""

    text: str
    classes: str


class StoredTableShown(Stored):
    """A table as it is shown. ``name``: by which pages ask for it, unique in its sweep; ``records``: its
    figures as data, not rounded."""

    name: str
    records: list[dict[str, Any]]
    title: str
    said: list[str]
    head: list[StoredCell]
    rows: list[list[StoredCell]]
    note: str


class StoredMeasured(Stored):
    """A line about where and when a study was measured."""

    what: str
    value: str


class StudyTables(Stored):
    """``study.json``: the tables of ``simspec study``, by sweep; ``said``: how each sweep was done, ``bad``: which of these
    lines say that something is wrong."""

    schema_: int = Field(alias="schema")
    study: str
    description: str
    small: bool
    figures: str
    said: list[str]
    bad: list[int]
    sweeps: dict[str, list[StoredTableShown]]
    measured: list[StoredMeasured]


class StoredModel(Stored):
    """A model of a sweep, by hashes (:mod:`simspec.experiments.certify`)."""

    engine: str
    case: str | None
    values: list[list[Any]]
    world: str
    settings: str
    files: str
    version: str


class StoredSweepModels(Stored):
    """The models of one sweep of a study; ``request``: the hash of the study's request."""

    request: str = Field(alias="asked")
    models: list[StoredModel]


class StudyModels(Stored):
    """``models.json``: the models of the figures of a published study. ``source``: the study, as it was named;
    ``study_sha256``: of ``study.json``."""

    schema_: int = Field(alias="schema")
    source: str
    small: bool
    study_sha256: str
    sweeps: dict[str, StoredSweepModels]


def parse(content: bytes | str, what: str) -> Any:
    """JSON as plain data. Raises SpecError, which names ``what``, for anything else."""
    try:
        return parse_json(content)
    except NotReadableError as error:
        raise SpecError([Problem(f"{what} cannot be read: {error}", code="R101")]) from None


def read_as(model: type[Model], content: bytes | str, what: str) -> Model:
    """JSON text as a model. Raises SpecError, which names ``what`` and the first places that do not fit."""
    try:
        return model.model_validate(parse(content, what))
    except ValidationError as error:
        places = [f"{'.'.join(map(str, entry['loc'])) or 'all of it'}: {entry['msg']}" for entry in error.errors()[:3]]
        raise SpecError([Problem(f"{what} cannot be read: {'; '.join(places)[:400]}", code="R101")]) from None
