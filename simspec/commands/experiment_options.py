"""Commands of experiments, results and engines: the name, the options in the order of the help, and the help of each."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from typer import Argument, Option

from simspec.commands.options import (
    DryRun,
    EngineNames,
    NoVerify,
    Options,
    PageFile,
    SpecName,
    StoreFolder,
    Wait,
    command,
)

REPORTS = "junit annotations summary github"


@command(
    "sweep",
    "sweep:sweep",
    "spec engine store jobs scheduler dry_run retry_failed no_verify csv wait sets ROBOTS allow_outside strict python "
    f"deadline {REPORTS} as_json",
)
class SweepOptions(Options):
    """Run all values that the `sweep` of a spec lists, and store the runs.

    Runs that are stored already are not repeated. Without --engine, `sweep.engines` and default-engines (simspec.toml):
    every installed engine that supports the spec. Ended at any moment, the same command does what is left.

    \b
    simspec sweep friction.yaml --dry-run
    simspec sweep friction.yaml --jobs 4 --csv friction.csv
    simspec sweep friction.yaml --set sweep.repeat=5
    simspec sweep friction.yaml --retry-failed

    Exit code 1 if a proof or an expectation failed, 3 if a run failed or an engine was stopped.
    """

    spec: SpecName
    store: StoreFolder = None
    jobs: Annotated[
        int | None, Option(metavar="N", min=1, help="Runs side by side (default: the cores; measure: speed: 1).")
    ] = None
    scheduler: Annotated[
        str | None, Option(metavar="ADDRESS", help="Run on the workers of a Dask cluster: tcp://HOST:PORT.")
    ] = None
    dry_run: DryRun = False
    retry_failed: Annotated[bool, Option("--retry-failed", help="Repeat the stored runs that failed.")] = False
    no_verify: NoVerify = False
    csv: Annotated[Path | None, Option("--csv", metavar="FILE", help="Also write a table, one line per run.")] = None
    wait: Wait = False


@command(
    "study", "study:study", "study small store dry_run publish no_verify wait python deadline allow_outside as_json"
)
class StudyOptions(Options):
    """Do all sweeps of a study, and write its tables.

    Writes runs/NAME/study.md and study.json (with --small: runs/NAME-small). Runs that are stored already are not
    repeated. Ended at any moment, the same command does what is left.

    \b
    simspec study koerber-2021 --small --dry-run
    simspec study koerber-2021 --small
    simspec study mine.yaml --store /data/store
    simspec study koerber-2021 --publish docs/records/studies/koerber-2021

    A run that fails or does not do what is expected is a result of the study. Exit code 1 if a proof failed, 2 if
    values make a scenario invalid, 3 if an engine was stopped.
    """

    study: Annotated[str, Argument(metavar="STUDY", help="A study file, or the name of a study of the library.")]
    small: Annotated[bool, Option("--small", help="Run the small study, defined under `small` in the file.")] = False
    store: StoreFolder = None
    dry_run: DryRun = False
    publish: Annotated[
        Path | None,
        Option(metavar="DIR", help="Also write the results, and what they are of, into a folder to be committed."),
    ] = None
    no_verify: NoVerify = False
    wait: Wait = False


@command("pages", "pages:pages", "pages check older python allow_outside as_json")
class PagesOptions(Options):
    """Fill the marked places of Markdown pages from published studies.

    The studies are those in the folder `studies` next to a page. No engine is run. Where a model that a study measured
    is compiled to something else today, its figures are older than the code: exit code 1, unless the page says so
    (--older).

    \b
    simspec pages docs/records/results.md
    simspec pages docs/records/results.md --check
    """

    pages: Annotated[list[Path], Argument(metavar="PAGE...", help="Pages of Markdown.")]
    check: Annotated[
        bool, Option("--check", help="Write nothing; exit code 1 unless pages and figures are current.")
    ] = False
    older: Annotated[bool, Option("--older", help="Make the pages say which figures are older than the code.")] = False


@command(
    "explain",
    "explain:explain",
    "a b engine others windows verify sets accept ROBOTS allow_outside python deadline as_json",
)
class ExplainOptions(Options):
    """Explain where the difference of two runs, or of two engines, comes from.

    Writes nothing. Both begin short windows in states of A's run; one thing that differs is taken away at a time, and
    the share of the difference that this closes is printed. Exit code 0 whatever the shares are.

    \b
    simspec explain runs/arm/ENGINE1 runs/arm/ENGINE2
    simspec explain arm.yaml --engine ENGINE1 --engine ENGINE2
    simspec explain arm.yaml --engine ENGINE --with physics.timestep=2ms
    simspec explain arm.yaml arm-heavier.yaml --engine ENGINE
    simspec explain robot.SUFFIX --engine ENGINE1 --engine ENGINE2 --accept all
    """

    a: Annotated[str, Argument(metavar="A", help="Folder of a run, or a spec.")]
    b: Annotated[str | None, Argument(metavar="[B]", help="Folder of another run, or another spec.")] = None
    others: Annotated[
        list[str] | None,
        Option("--with", metavar="PATH=VALUE", help="Override a value of the second side. Repeatable."),
    ] = None
    windows: Annotated[int, Option(metavar="COUNT", min=3, help="Windows that are looked at, at most.")] = 240
    verify: Annotated[
        bool, Option("--verify", help="First prove that both engines hold their models (L0 to L7 without L5).")
    ] = False


@command(
    "bisect",
    "explain:bisect",
    "spec first last figure engine versions yes store no_verify sets accept ROBOTS allow_outside python deadline as_json",
)
class BisectOptions(Options):
    """Find the engine release that changed a figure beyond noise.

    The versions between two releases are halved (docs/guide/bisect.md). Each version is run once, with repeats for its
    noise; runs that are stored already are not repeated. The search assumes one change between the two versions.

    \b
    simspec bisect SPEC --engine NAME --from 3.3.7 --to 3.8.0 --figure "deepest penetration" --yes
    simspec bisect SPEC --engine NAME --from 3.3.7 --to 3.8.0 --figure arm.z --versions 3.4.0,3.5.0
    simspec bisect SPEC --engine NAME --from 3.3.7 --to 3.8.0 --figure "expectation 1" --json

    Exit code 0 if the version was found, 1 if the figure does not change, 3 if a version at an end cannot be
    installed or fails.
    """

    spec: SpecName
    first: Annotated[str, Option("--from", metavar="VERSION", help="The older version.")]
    last: Annotated[str, Option("--to", metavar="VERSION", help="The younger version.")]
    figure: Annotated[
        str, Option("--figure", metavar="NAME", help="A number of a run: an expectation, a quantity, a coordinate.")
    ]
    versions: Annotated[
        str | None, Option(metavar="A,B,…", help="The versions between, instead of those that the package index has.")
    ] = None
    yes: Annotated[
        bool, Option("--yes", help="Install versions that are missing, each in an environment of its own.")
    ] = False
    store: StoreFolder = None
    no_verify: Annotated[
        bool, Option("--no-verify", help="Skip the proof that the two versions have the same model.")
    ] = False


@command("report", "reports:report", "folders out as_json")
class ReportOptions(Options):
    """Write a report as one HTML page: verdict, certificate, tables, plots and playback. It loads nothing from elsewhere.

    Without -o it is FOLDER/report.html.

    \b
    simspec report runs/arm
    simspec report runs/arm runs/spheres-216 -o both.html
    """

    folders: Annotated[
        list[Path],
        Argument(metavar="FOLDER...", help="Folders of studies or sweeps (runs/NAME), or of runs (runs/NAME/ENGINE)."),
    ]
    out: PageFile = None


@command(
    "view",
    "view:view",
    "seen port no_browser page out video gif fps size speed sets ROBOTS allow_outside as_json",
)
class ViewOptions(Options):
    """Show a scene in the browser before it is run, or the report of a study or a run; write videos of runs.

    A spec is shown in its initial state, with sliders for its joints, until Ctrl-C (extra `view`); the address works on
    this machine alone. Without the extra, or with --page, it is a page in a file. A report is written first where it is not
    current. --video and --gif need the extra `video`.

    \b
    simspec view arm.yaml
    simspec view ur10e --page ur10e.html
    simspec view runs/arm
    simspec view runs/arm --video arm.mp4 --speed 0.5
    """

    seen: Annotated[
        str,
        Argument(metavar="SPEC|FOLDER", help="A spec, a library scenario, or the folder of a study or a run."),
    ]
    port: Annotated[
        int | None,
        Option("--port", metavar="N", min=1, max=65535, help="Port of the live scene (default: any free one)."),
    ] = None
    no_browser: Annotated[bool, Option("--no-browser", help="Open nothing; print the address or the file.")] = False
    page: Annotated[Path | None, Option("--page", metavar="FILE", help="Write the page to this file, and end.")] = None
    out: PageFile = None
    video: Annotated[Path | None, Option("--video", metavar="FILE.mp4", help="Write the playback as a video.")] = None
    gif: Annotated[
        Path | None, Option("--gif", metavar="FILE.gif", help="Write the playback as an animated image.")
    ] = None
    fps: Annotated[int | None, Option("--fps", metavar="N", min=1, max=60, help="Frames per second (default 30).")] = (
        None
    )
    size: Annotated[
        str | None, Option("--size", metavar="WxH", help="Size of a video in pixels (default 1280x720).")
    ] = None
    speed: Annotated[
        float | None, Option("--speed", metavar="X", help="Simulated seconds in a second of a video (default 1).")
    ] = None


@command("engines", "engines:engines", "context markdown out check as_json")
class EnginesOptions(Options):
    """List the engines, their versions, and the features that they support.

    Engines of other interpreters are listed too. Interpreters that simspec.toml names are not started; `simspec engines
    doctor` starts them.

    \b
    simspec engines
    simspec engines show NAME
    simspec engines --json
    """

    context: typer.Context
    markdown: Annotated[bool, Option("--markdown", help="Write the support matrix and the pages of engines.")] = False
    out: Annotated[Path, Option(metavar="FILE", help="Output file of --markdown.")] = Path(
        "docs/reference/support-matrix.md"
    )
    check: Annotated[bool, Option("--check", help="With --markdown: exit with 1 if the page is not current.")] = False


@command("engines show", "engines:show", "shown as_json")
class ShowEnginesOptions(Options):
    """Print the features, capabilities and solver settings of an engine.

    \b
    simspec engines show NAME
    simspec engines show NAME --json
    """

    shown: Annotated[list[str], Argument(metavar="NAME...", help="Engines.")]


@command("engines doctor", "engines:doctor", "names every as_json")
class DoctorOptions(Options):
    """Test whether the engines are installed and work.

    Prints the version of each, and what is missing and why. A ball falls in each for a tenth of a second, in the
    engine's own process. Exit code 3 where an installed engine does not work, or an engine that is named is not
    there. Interpreters of simspec.toml are started once `simspec trust` has been said of it.

    \b
    simspec engines doctor
    simspec engines doctor NAME --json
    """

    names: EngineNames = None
    every: Annotated[bool, Option("--all", help="Exit with 3 also where a known engine is not installed.")] = False


@command("engines install", "install:install", "names every yes accepted as_json")
class InstallOptions(Options):
    """Print the commands that install engines; --yes runs them.

    NAME@VERSION gets a separate environment. Some engines bring software under a proprietary licence: its terms are
    printed, and nothing is downloaded until they are accepted, on a terminal or by --accept-licence.

    \b
    simspec engines install NAME
    simspec engines install NAME@3.8 --yes
    simspec engines install --all --yes
    simspec engines install NAME --yes --accept-licence NAME

    Exit code 3 where an engine cannot be installed, or a licence is not accepted.
    """

    names: EngineNames = None
    every: Annotated[bool, Option("--all", help="Every known engine that is not installed.")] = False
    yes: Annotated[bool, Option("--yes", help="Run the commands: pip of this interpreter; apt-get only for root.")] = (
        False
    )
    accepted: Annotated[
        list[str] | None,
        Option(
            "--accept-licence",
            metavar="NAME",
            help="With --yes: accept the licence terms that come with this engine. Repeatable.",
        ),
    ] = None


@command("trust", "engines:trust", "file listed revoked as_json")
class TrustOptions(Options):
    """Trust the interpreters and folders that a project file names.

    The trust ends when the file changes. A simspec.toml may come from anybody with a repository. Read it first: the
    interpreters that it names are started, and what a relative path leads to in the repository is not looked at.
    See docs/guide/project-file.md.

    \b
    simspec trust
    simspec trust path/to/simspec.toml
    simspec trust --list
    simspec trust --revoke path/to/simspec.toml
    """

    file: Annotated[
        Path | None, Argument(metavar="[FILE]", help="A simspec.toml, or its folder (default: the nearest one).")
    ] = None
    listed: Annotated[bool, Option("--list", help="Print the files that are trusted.")] = False
    revoked: Annotated[bool, Option("--revoke", help="Do not trust FILE any more.")] = False
