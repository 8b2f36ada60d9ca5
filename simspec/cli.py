"""The command line: arguments and help of every command; the work is done in ``simspec.commands``, imported when called."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from simspec import arguments
from simspec.arguments import (
    DEADLINE,
    Accepts,
    AsJson,
    Deadline,
    Engines,
    FormatName,
    Outside,
    Pythons,
    SchemaName,
    Sets,
    SpecName,
    SpecNames,
    Strict,
)
from simspec.cli_engines import add_engines
from simspec.cli_experiments import add_experiments, add_reports
from simspec.cli_files import add_audit, add_imports
from simspec.commands.guard import command, report_error, wrong_words
from simspec.ending import in_order
from simspec.errors import EXIT_OK, SpecError
from simspec.robot_files import NO_WORDS, RobotFiles, reads_robot_files

app = typer.Typer(
    name="simspec",
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["--help", "-h"], "max_content_width": 110},
)


@app.callback()
def simspec_command() -> None:
    """Run one physics scenario in several engines, with proof that all simulate the same model.

    \b
    Start here:
      simspec new pendulum                     write a commented spec, pendulum.yaml
      simspec run pendulum.yaml --all-engines  compile, verify, run, compare
      simspec run spheres-216 --all-engines    a scenario of the library, by name
      simspec verify pendulum.yaml             prove that every engine has the spec's model
      simspec sweep pendulum.yaml              all runs that its `sweep` asks for
      simspec diff runs/pendulum/ENGINE1 runs/pendulum/ENGINE2
      simspec engines                          the names of the engines

    \b
    Exit codes: 0 success; 1 an expectation, a proof or a comparison failed; 2 error in
    the spec or the command line; 3 an engine failed or is not installed.
    """


@app.command("new")
@command
def new_command(
    name: Annotated[str, typer.Argument(help="Name of the scenario; the file is NAME.yaml.")],
    as_json: AsJson = False,
) -> int:
    """Write a commented starter spec.

    \b
    simspec new pendulum
    simspec run pendulum.yaml --all-engines
    """
    from simspec.commands.new import new

    return new(name, as_json)


@app.command("check")
@command
@reads_robot_files
def check_command(
    specs: Annotated[list[str], typer.Argument(metavar="SPEC...", help="YAML files, or library scenarios.")],
    engine: Engines = None,
    sets: Sets = None,
    accept: Accepts = None,
    robot_files: RobotFiles = NO_WORDS,
    allow_outside: Outside = False,
    strict: Strict = False,
    verbose: Annotated[
        bool,
        typer.Option(
            "-v", "--verbose", help="List all that is implausible about a model, and all that engines refuse, in full."
        ),
    ] = False,
    as_json: AsJson = False,
) -> int:
    """Load and resolve specs; with --engine, also check that these engines support them. Writes nothing.

    \b
    simspec check specs/*.yaml
    simspec check arm.yaml --engine ENGINE
    simspec check arm.yaml --engine ENGINE --accept all
    simspec check robot.xml -v
    """
    from simspec.commands.check import check

    return check(specs, engine, sets, allow_outside, strict, as_json, robot_files, accept, verbose)


add_imports(app)


@app.command("accept")
@command
@reads_robot_files
def accept_command(
    spec: SpecName,
    engine: Engines = None,
    robot_files: RobotFiles = NO_WORDS,
    allow_outside: Outside = False,
    as_json: AsJson = False,
) -> int:
    """Add the `accept` and `outside` entries that engines need to a spec, each with its reason as a comment.

    Without --engine and default-engines (simspec.toml): for the installed engines; those that do not support the spec at
    all are listed. Review the entries: each one is a difference from the spec. If a named engine does not
    support a feature at all, this is an error, and nothing is written.

    \b
    simspec accept arm.yaml
    simspec accept arm.yaml --engine ENGINE
    """
    from simspec.commands.accept import accept

    return accept(spec, engine, allow_outside, as_json, robot_files)


@app.command("fmt")
@command
def fmt_command(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="YAML files to format.")],
    check: Annotated[bool, typer.Option("--check", help="Write nothing; exit with 1 if a file would change.")] = False,
    as_json: AsJson = False,
) -> int:
    """Format specs in the canonical layout; comments are kept.

    \b
    simspec fmt specs/*.yaml
    simspec fmt --check specs/*.yaml
    """
    from simspec.commands.fmt import fmt

    return fmt(files, check, as_json)


@app.command("schema")
@command
def schema_command(
    of: Annotated[
        SchemaName,
        typer.Option(
            "--of", help="Schema of the language, of simspec.toml, or of the files exchanged with engine processes."
        ),
    ] = SchemaName.LANGUAGE,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Output file (default schema/…); - for standard output.")
    ] = None,
    check: Annotated[bool, typer.Option("--check", help="Write nothing; exit with 1 if FILE is not current.")] = False,
    as_json: AsJson = False,
) -> int:
    """Write a JSON Schema: of the language or of simspec.toml, for editors, or of requests and results of engine processes.

    \b
    simspec schema --out simspec.schema.json
    First line of a spec, for the YAML language server:
      # yaml-language-server: $schema=simspec.schema.json
    simspec schema --of engine-request --out -
    simspec schema --of project
    """
    from simspec.commands.schema import schema

    return schema(of.value, out, check, as_json)


@app.command("compile")
@command
@reads_robot_files
def compile_command(
    specs: SpecNames = None,
    engine: Engines = None,
    format_name: FormatName = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Output folder (default generated/NAME); with several specs, DIR/NAME."),
    ] = None,
    check: Annotated[
        bool, typer.Option("--check", help="Write nothing; exit with 1 if the folder is not current.")
    ] = False,
    explain: Annotated[
        bool,
        typer.Option(
            "--explain",
            help="Print how each engine realises contact and features, and its solver settings.",
        ),
    ] = False,
    sets: Sets = None,
    accept: Accepts = None,
    robot_files: RobotFiles = NO_WORDS,
    allow_outside: Outside = False,
    strict: Strict = False,
    as_json: AsJson = False,
) -> int:
    """Compile specs to the formats of the engines: generated/NAME/ with world.json and one folder per engine.

    Without SPEC: all files in ./specs. Without --engine and default-engines (simspec.toml): for every known engine; those
    that do not support a spec are listed.

    \b
    simspec compile robot.yaml
    simspec compile robot.yaml --engine ENGINE --out build/robot
    simspec compile --check                 in CI: is generated/ current?
    simspec compile robot.yaml --explain
    simspec compile robot.yaml --format FORMAT      plain files for any tool: plain/NAME/FORMAT/

    With --format, what the files do not carry is listed, and written to losses.json. --strict makes what is lost
    of the bodies an error; nothing is written then.
    """
    from simspec.commands.compile import compile_specs

    return compile_specs(
        specs,
        engine,
        format_name,
        out,
        check=check,
        explain=explain,
        sets=sets,
        accept=accept,
        allow_outside=allow_outside,
        robot_files=robot_files,
        strict=strict,
        as_json=as_json,
    )


@app.command("verify")
@command
@reads_robot_files
def verify_command(
    spec: Annotated[str | None, typer.Argument(metavar="[SPEC]", help="A YAML file, or a library scenario.")] = None,
    engine: Engines = None,
    self_test: Annotated[
        bool, typer.Option("--self-test", help="Test the proof: plant one defect at a time into compiled files.")
    ] = False,
    complete: Annotated[
        bool,
        typer.Option(
            "--complete",
            help="With --self-test: every possible change of the files, one at a time (takes half an hour).",
        ),
    ] = False,
    contact: Annotated[
        bool, typer.Option("--contact", help="Print all contact measurements, and plot friction by direction.")
    ] = False,
    no_cache: Annotated[
        bool, typer.Option("--no-cache", help="Measure contact again, even where results are cached.")
    ] = False,
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Output folder (default generated/NAME).")] = None,
    sets: Sets = None,
    accept: Accepts = None,
    robot_files: RobotFiles = NO_WORDS,
    allow_outside: Outside = False,
    strict: Strict = False,
    python: Pythons = None,
    deadline: Deadline = DEADLINE,
    junit: arguments.JunitFile = None,
    annotations: arguments.Annotations = False,
    summary: arguments.SummaryFile = None,
    github: arguments.GitHub = False,
    as_json: AsJson = False,
) -> int:
    """Prove that every engine has the spec's model; writes generated/NAME/certificate.json.

    Without --engine and default-engines (simspec.toml): in every installed engine; those that do not support the
    spec are listed.

    \b
    simspec verify robot.yaml
    simspec verify robot.yaml --engine ENGINE1 --engine ENGINE2
    simspec verify box-on-ramp --contact        the measured friction and restitution of each engine, with a plot
    simspec verify --self-test                  does the proof detect planted defects?
    simspec verify --self-test --complete       every change of every number, word, attribute and element
    """
    from simspec.commands.accept import accepted_sets
    from simspec.commands.ci import reports_of
    from simspec.commands.verify import verify

    return verify(
        spec,
        engine,
        planted=self_test,
        complete=complete,
        contact=contact,
        cache=not no_cache,
        out=out,
        sets=accepted_sets(spec, sets, accept, allow_outside, robot_files, engine, python),
        allow_outside=allow_outside,
        robot_files=robot_files,
        strict=strict,
        python=python,
        deadline=deadline,
        as_json=as_json,
        reports=reports_of(junit, annotations, summary, github),
    )


@app.command("run")
@command
@reads_robot_files
def run_command(
    spec: SpecName,
    all_engines: arguments.AllEngines = False,
    engine: Engines = None,
    keep_going: arguments.KeepGoing = False,
    out: Annotated[Path, typer.Option(metavar="DIR", help="Results are written to DIR/NAME.")] = Path("runs"),
    repeats: arguments.Repeats = True,
    no_verify: Annotated[
        bool, typer.Option("--no-verify", help="Skip the proof that the engines have the same model.")
    ] = False,
    tolerance: Annotated[
        float, typer.Option(metavar="METRE", min=0.0, help="Tolerance of positions (m) and angles (rad).")
    ] = 1e-3,
    fail_on_diff: arguments.FailOnDiff = None,
    sets: Sets = None,
    accept: Accepts = None,
    robot_files: RobotFiles = NO_WORDS,
    allow_outside: Outside = False,
    strict: Strict = False,
    python: Pythons = None,
    deadline: Deadline = DEADLINE,
    report: Annotated[
        bool, typer.Option("--report", help="Also write report.html: one page with tables, plots and playback.")
    ] = False,
    junit: arguments.JunitFile = None,
    annotations: arguments.Annotations = False,
    summary: arguments.SummaryFile = None,
    github: arguments.GitHub = False,
    baseline: arguments.BaselineFile = None,
    write_baseline: arguments.NewBaseline = None,
    timed_runs: arguments.TimedRuns = 5,
    as_json: AsJson = False,
) -> int:
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
    from simspec.commands.accept import accepted_sets
    from simspec.commands.baseline import Baselines
    from simspec.commands.ci import reports_of
    from simspec.commands.run import run

    return run(
        spec,
        all_engines=all_engines,
        engine=engine,
        keep_going=keep_going,
        out=out,
        repeats=repeats,
        prove=not no_verify,
        tolerance=tolerance,
        fail_on_diff=fail_on_diff,
        sets=accepted_sets(spec, sets, accept, allow_outside, robot_files, engine, python),
        allow_outside=allow_outside,
        robot_files=robot_files,
        strict=strict,
        python=python,
        deadline=deadline,
        page=report,
        as_json=as_json,
        reports=reports_of(junit, annotations, summary, github),
        baselines=Baselines(baseline, write_baseline, timed_runs),
    )


add_experiments(app)
add_audit(app)
add_reports(app)


@app.command("diff")
@command
@reads_robot_files
def diff_command(
    a: Annotated[str, typer.Argument(metavar="A", help="Folder of a run, or a spec.")],
    b: Annotated[str, typer.Argument(metavar="B", help="Another run, or another spec.")],
    tolerance: Annotated[
        float, typer.Option(metavar="METRE", min=0.0, help="Tolerance of positions (m) and angles (rad).")
    ] = 1e-3,
    robot_files: RobotFiles = NO_WORDS,
    allow_outside: Outside = False,
    as_json: AsJson = False,
) -> int:
    """Compare two runs or two resolved specs. Exit code 1 if they differ, or if the engines' noise makes that inconclusive.

    \b
    simspec diff runs/arm/ENGINE1 runs/arm/ENGINE2 --tolerance 1e-6
    simspec diff arm.yaml arm-heavier.yaml
    """
    from simspec.commands.diff import diff

    return diff(a, b, tolerance, allow_outside, as_json, robot_files)


add_engines(app)


def help_text() -> str:
    """The text of ``simspec --help``, 100 columns wide whatever the terminal is."""
    group = typer.main.get_command(app)
    settings = {**group.context_settings, "terminal_width": 100, "max_content_width": 100}
    context = group.context_class(group, info_name="simspec", **settings)
    return group.get_help(context) + "\n"


def main(arguments: list[str]) -> int:
    """Run one command line; the exit code."""
    return in_order(lambda: _main(arguments))


def _main(arguments: list[str]) -> int:
    if arguments == ["--write-help"]:
        from simspec.outputs.writing import write_file

        write_file(Path(__file__).with_name("help.txt"), help_text(), lambda old: b"simspec" in old[:100])
        return EXIT_OK
    if arguments == ["--version"]:
        from importlib.metadata import version

        print(f"simspec {version('simspec')}")
        return EXIT_OK
    if (problem := wrong_words(arguments)) is not None:
        return report_error(SpecError([problem]), "--json" in arguments)
    app(arguments, prog_name="simspec")  # ends with SystemExit, whose code is the command's
    return EXIT_OK


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
