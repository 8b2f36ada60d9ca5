"""Commands of scenarios and models: the name, the options in the order of the help, and the help of each."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from simspec.commands.options import CheckFolder, NoVerify, Options, SpecName, SpecNames, Tolerance, command

REPORTS = "junit annotations summary github"


class SchemaName(StrEnum):
    """The JSON Schemas that simspec writes."""

    LANGUAGE = "language"
    STUDY = "study"
    FIGURES = "figures"
    ENGINE_REQUEST = "engine-request"
    ENGINE_RESULT = "engine-result"
    PROJECT = "project"


class Shell(StrEnum):
    """The shells whose command lines simspec completes."""

    BASH = "bash"
    ZSH = "zsh"
    FISH = "fish"


@command("completion", "completion:completion", "shell as_json")
class CompletionOptions(Options):
    """Print a script that completes simspec's commands, options, engines and scenarios in a shell.

    \b
    simspec completion bash      in ~/.bashrc: eval "$(simspec completion bash)"
    simspec completion zsh       in ~/.zshrc, after compinit: eval "$(simspec completion zsh)"
    simspec completion fish      in ~/.config/fish/config.fish: simspec completion fish | source
    """

    shell: Annotated[Shell, Argument(metavar="SHELL", help="bash, zsh or fish.")]


@command("new", "files:new", "name as_json")
class NewOptions(Options):
    """Write a commented starter spec.

    \b
    simspec new pendulum
    simspec run pendulum.yaml --all-engines
    """

    name: Annotated[str, Argument(metavar="NAME", help="Name of the scenario; the file is NAME.yaml.")]


@command("init", "init:init", "folder robot engine vscode dry_run ROBOTS allow_outside as_json")
class InitOptions(Options):
    """Make a project: a spec, its compiled files, simspec.toml, checks before commits, and a CI workflow.

    The spec is the starter of `simspec new`, or a robot file (--robot), with its meshes copied. Files that exist are kept
    and listed. Without --engine: the engines of docs/examples/github-workflow.yml.

    \b
    simspec init
    simspec init my-project
    simspec init my-robot --robot FILE --package-path ~/ros/src
    simspec init my-project --engine ENGINE1 --engine ENGINE2 --dry-run
    """

    folder: Annotated[Path | None, Argument(metavar="[DIR]", help="Folder of the project (default: this one).")] = None
    robot: Annotated[
        str | None, Option("--robot", metavar="FILE", help="Import this robot file, or robot by name, as the spec.")
    ] = None
    vscode: Annotated[bool, Option("--vscode", help="Also write settings of VS Code for the schema of specs.")] = False
    dry_run: Annotated[bool, Option("--dry-run", help="Print the files; write nothing.")] = False


@command("list", "check:list_scenarios", "as_json")
class ListOptions(Options):
    """List the scenarios of the library, each with the engines that support it. Writes nothing.

    \b
    simspec list --json
    simspec run SCENARIO --all-engines
    """


@command("help", "help:help_about", "words as_json")
class HelpOptions(Options):
    """Print the page of an error code, a warning, an accept word or a rule.

    \b
    simspec help S101
    simspec help material.restitution
    """

    words: Annotated[
        list[str], Argument(metavar="CODE...", help="Codes in brackets of messages, features of engines, commands.")
    ]


@command("check", "check:check", "specs engine sets accept ROBOTS allow_outside strict verbose as_json")
class CheckOptions(Options):
    """Load and resolve specs; with --engine, also check that these engines support them. Writes nothing.

    \b
    simspec check specs/*.yaml
    simspec check arm.yaml --engine ENGINE
    simspec check arm.yaml --engine ENGINE --accept all
    simspec check robot.xml -v
    """

    specs: SpecNames
    verbose: Annotated[
        bool,
        Option(
            "-v", "--verbose", help="List all that is implausible about a model, and all that engines refuse, in full."
        ),
    ] = False


@command("import", "files:import_file", "file out meshes ROBOTS allow_outside strict as_json")
class ImportFileOptions(Options):
    """Write a robot file of another language as a spec, and list what it does not carry.

    Every element and attribute is carried, carried without effect, or lost with its reason. Defects of the file are
    errors; --repair RULE repairs those of a kind, with a comment in the spec (docs/guide/import.md).

    \b
    simspec import FILE -o robot.yaml
    simspec import FILE --repair triangle-inequality --strict
    simspec import FILE --package-path ~/ros/src -o robot.yaml
    simspec import panda_description -o panda.yaml
    """

    file: Annotated[
        str,
        Argument(metavar="FILE", help="A robot file of another language, or a robot of robot_descriptions by name."),
    ]
    out: Annotated[
        Path | None, Option("--out", "-o", metavar="FILE", help="Output file (default: standard output).")
    ] = None
    meshes: Annotated[
        Path | None, Option("--meshes", metavar="DIR", help="Copy the meshes to this folder, and name those.")
    ] = None
    strict: Annotated[
        bool, Option("--strict", help="Exit with 2, and write nothing, where something lost changes physics.")
    ] = False


@command("export", "compile:export", "specs format_name out profile check sets ROBOTS allow_outside strict as_json")
class ExportOptions(Options):
    """Write specs as plain files for other tools, and list what the files do not carry.

    The same as `compile --format`. --strict makes what is lost of the bodies an error; nothing is written then.

    \b
    simspec export robot.yaml --format FORMAT
    simspec export robot.yaml --format FORMAT -o build/robot --strict
    simspec export robot.yaml --format FORMAT -o robot.SUFFIX
    """

    specs: SpecNames
    format_name: Annotated[str, Option("--format", metavar="NAME", help="The format of the files.")]
    out: Annotated[
        Path | None,
        Option(
            "--out",
            "-o",
            metavar="DIR",
            help="Output folder (default plain/NAME/FORMAT); of several, DIR/NAME; or FILE, by its suffix, where a format has "
            "single files.",
        ),
    ] = None
    profile: Annotated[
        str | None, Option("--profile", metavar="NAME", help="The layout of the files, where a format has several.")
    ] = None
    check: CheckFolder = False


@command("accept", "check:accept", "spec engine ROBOTS allow_outside as_json")
class AcceptOptions(Options):
    """Write the approximations that engines need into a spec.

    Adds `accept` and `outside` entries, each with its reason as a comment.

    Without --engine and default-engines (simspec.toml): for the installed engines; those that do not support the spec
    at all are listed. Review the entries: each one is a difference from the spec. If a named engine does not
    support a feature at all, this is an error, and nothing is written.

    \b
    simspec accept arm.yaml
    simspec accept arm.yaml --engine ENGINE
    """

    spec: SpecName


@command("fmt", "files:fmt", "files check as_json")
class FmtOptions(Options):
    """Format specs in the canonical layout; comments are kept.

    \b
    simspec fmt specs/*.yaml
    simspec fmt --check specs/*.yaml
    """

    files: Annotated[list[Path], Argument(metavar="FILE...", help="YAML files to format.")]
    check: Annotated[bool, Option("--check", help="Write nothing; exit with 1 if a file would change.")] = False


@command("schema", "files:schema", "of out check as_json")
class SchemaOptions(Options):
    """Write a JSON Schema of the language, for editors.

    Also those of simspec.toml, of studies, and of the files that engine processes exchange (--of).

    \b
    simspec schema --out simspec.schema.json
    First line of a spec, for the YAML language server:
      # yaml-language-server: $schema=simspec.schema.json
    simspec schema --of engine-request --out -
    simspec schema --of project
    """

    of: Annotated[
        SchemaName,
        Option(
            "--of", help="Schema of the language, of simspec.toml, or of the files exchanged with engine processes."
        ),
    ] = SchemaName.LANGUAGE
    out: Annotated[
        Path | None,
        Option(metavar="FILE", help="Output file (default: below schema/, if it exists); - for standard output."),
    ] = None
    check: Annotated[bool, Option("--check", help="Write nothing; exit with 1 if FILE is not current.")] = False


@command(
    "compile",
    "compile:compile_specs",
    "specs engine format_name out check explain sets accept ROBOTS allow_outside strict as_json",
)
class CompileOptions(Options):
    """Compile specs to the files of the engines.

    Writes generated/NAME/ with world.json and one folder per engine.

    Without SPEC: all files in ./specs. Without --engine and default-engines (simspec.toml): for every known engine;
    those that do not support a spec are listed.

    \b
    simspec compile robot.yaml
    simspec compile robot.yaml --engine ENGINE --out build/robot
    simspec compile --check                 in CI: is generated/ current?
    simspec compile robot.yaml --explain
    simspec compile robot.yaml --format FORMAT      plain files for any tool: plain/NAME/FORMAT/

    With --format, what the files do not carry is listed, and written to losses.json. --strict makes what is lost
    of the bodies an error; nothing is written then.
    """

    specs: Annotated[list[str] | None, Argument(metavar="[SPEC]...", help="YAML files, or library scenarios.")] = None
    format_name: Annotated[
        str | None,
        Option("--format", metavar="NAME", help="Write plain files of this format, for any tool, and for no engine."),
    ] = None
    out: Annotated[
        Path | None, Option(metavar="DIR", help="Output folder (default generated/NAME); with several specs, DIR/NAME.")
    ] = None
    check: CheckFolder = False
    explain: Annotated[
        bool, Option("--explain", help="Print how each engine realises contact and features, and its solver settings.")
    ] = False


@command(
    "verify",
    "verify:verify",
    "spec engine self_test complete contact no_cache out sets accept ROBOTS allow_outside strict python deadline "
    f"{REPORTS} as_json",
)
class VerifyOptions(Options):
    """Prove that every engine has the spec's model.

    Writes generated/NAME/certificate.json.

    Without --engine and default-engines (simspec.toml): in every installed engine; those that do not support the
    spec are listed.

    \b
    simspec verify robot.yaml
    simspec verify robot.yaml --engine ENGINE1 --engine ENGINE2
    simspec verify box-on-ramp --contact        the measured friction and restitution of each engine, with a plot
    simspec verify --self-test                  does the proof detect planted defects?
    simspec verify --self-test --complete       every change of every number, word, attribute and element
    """

    spec: Annotated[str | None, Argument(metavar="[SPEC]", help="A YAML file, or a library scenario.")] = None
    self_test: Annotated[
        bool, Option("--self-test", help="Test the proof: plant one defect at a time into compiled files.")
    ] = False
    complete: Annotated[
        bool,
        Option(
            "--complete",
            help="With --self-test: every possible change of the files, one at a time (takes half an hour).",
        ),
    ] = False
    contact: Annotated[
        bool, Option("--contact", help="Print all contact measurements, and plot friction by direction.")
    ] = False
    no_cache: Annotated[bool, Option("--no-cache", help="Measure contact again, even where results are cached.")] = (
        False
    )
    out: Annotated[Path | None, Option(metavar="DIR", help="Output folder (default generated/NAME).")] = None


@command(
    "run",
    "run:run",
    "spec all_engines every_engine engine without keep_going out quick repeats no_cache no_verify tolerance fail_on_diff "
    f"sets accept ROBOTS allow_outside strict python deadline report {REPORTS} baseline write_baseline timed_runs verbose "
    "quiet as_json",
)
class RunOptions(Options):
    """Compile, verify, run in several engines, and compare.

    With --all-engines, engines that do not support the spec are listed and the others run: at least two, else exit 2.
    Writes runs/NAME/: one folder per engine (Parquet and provenance.json), compiled/, certificate.json, report.json.

    \b
    simspec run spheres-216 --all-engines
    simspec run arm.yaml --engine ENGINE1 --engine ENGINE2 --set physics.timestep=2ms
    simspec run arm.yaml --engine ENGINE --python ENGINE=/other/venv/bin/python
    simspec run arm.yaml --engine ENGINE --engine ENGINE@VERSION=/other/venv/bin/python
    simspec run arm.yaml --all-engines --accept joint.limits.position
    """

    spec: SpecName
    all_engines: Annotated[
        bool, Option("--all-engines", help="Run in every installed engine that supports the spec, at least two.")
    ] = False
    every_engine: Annotated[
        bool,
        Option(
            "--every-engine", help="As --all-engines, with engines that compile for each model, which takes minutes."
        ),
    ] = False
    without: Annotated[
        list[str] | None, Option("--without", metavar="NAME", help="Leave out this engine. Repeatable.")
    ] = None
    keep_going: Annotated[
        bool, Option("--keep-going", help="Continue without an engine that is missing or fails (exit code 3).")
    ] = False
    out: Annotated[Path, Option(metavar="DIR", help="Results are written to DIR/NAME.")] = Path("runs")
    quick: Annotated[
        bool, Option("--quick", help="Skip the measurement of contact and of noise; the verdict says so.")
    ] = False
    repeats: Annotated[
        bool,
        Option("--repeats/--no-repeats", help="Repeat runs, also with a perturbed initial state, to measure noise."),
    ] = True
    no_cache: Annotated[
        bool, Option("--no-cache", help="Measure contact and noise again, even where results are cached.")
    ] = False
    no_verify: NoVerify = False
    tolerance: Tolerance = 1e-3
    fail_on_diff: Annotated[
        float | None,
        Option(
            metavar="METRE",
            min=0.0,
            help="Exit with 1 if two engines differ by more than this and their noise, or if that noise is above this.",
        ),
    ] = None
    report: Annotated[
        bool, Option("--report", help="Also write report.html: one page with tables, plots and playback.")
    ] = False
    baseline: Annotated[
        Path | None,
        Option(
            "--baseline",
            metavar="FILE",
            help="Compare with figures stored earlier; exit with 1 if any changed beyond noise.",
        ),
    ] = None
    write_baseline: Annotated[
        Path | None, Option("--write-baseline", metavar="FILE", help="Store this run's figures as a baseline.")
    ] = None
    timed_runs: Annotated[
        int,
        Option(
            "--timed-runs",
            metavar="N",
            min=0,
            max=1000,
            help="For a baseline: runs of each engine for its speed, one at a time; 0: none.",
        ),
    ] = 5
    verbose: Annotated[
        bool, Option("-v", "--verbose", help="Print every table before the verdict: proof, results, differences.")
    ] = False
    quiet: Annotated[bool, Option("-q", "--quiet", help="Print the verdict alone: no progress, no notes.")] = False


@command(
    "audit",
    "verify:audit",
    f"files engine pair details no_verify ROBOTS html allow_outside python deadline {REPORTS} as_json",
)
class AuditOptions(Options):
    """List what each engine changes, drops or refuses in a robot file.

    Each engine that reads the language loads the file by its own loader with its defaults, in a separate process; the
    model that it reads is compared with the meaning of the file. Then the same file is compiled by simspec and
    proven.

    \b
    simspec audit ROBOT
    simspec audit robots/* --junit audit.xml --html audit.html
    simspec audit ROBOT OTHER --pair       two files of one robot

    Exit codes: 0 nothing is changed in silence; 1 findings; 2 a file is wrong; 3 an engine died.
    """

    files: Annotated[list[str], Argument(metavar="FILE...", help="Robot files, of any language an engine reads.")]
    pair: Annotated[bool, Option("--pair", help="Compare what two files of one robot mean, with each other.")] = False
    details: Annotated[bool, Option("--details", help="Print every finding, not one of each kind.")] = False
    no_verify: Annotated[
        bool, Option("--no-verify", help="Do not compile the file and prove what engines hold of that.")
    ] = False
    html: Annotated[Path | None, Option("--html", metavar="FILE", help="Also write a page.")] = None
    deadline: Annotated[float, Option(metavar="SECONDS", min=0.1, help="Deadline of one engine for one file.")] = 60.0


@command("diff", "reports:diff", "a b tolerance ROBOTS allow_outside as_json")
class DiffOptions(Options):
    """Compare two runs or two resolved specs. Exit code 1 if they differ, or if the engines' noise makes that inconclusive.

    \b
    simspec diff runs/arm/ENGINE1 runs/arm/ENGINE2 --tolerance 1e-6
    simspec diff arm.yaml arm-heavier.yaml
    """

    a: Annotated[str, Argument(metavar="A", help="Folder of a run, or a spec.")]
    b: Annotated[str, Argument(metavar="B", help="Another run, or another spec.")]
    tolerance: Tolerance = 1e-3
