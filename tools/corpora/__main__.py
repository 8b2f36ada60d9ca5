"""Robot files of other people's packages: each imported, certified in every engine, and audited as it is;
docs/records/corpora.md.

    python tools/corpora --into DIR --fetch          installs the packages into DIR, never into the project
    python tools/corpora --into DIR --run            what has no result yet; ended at any moment, it goes on there
    python tools/corpora --into DIR --run --stages import --anew
    python tools/corpora --into DIR --run --failed   again, all that failed with other code than today's
    python tools/corpora --into DIR --run --open     the same, and all that engines refused then or never tried
    python tools/corpora --into DIR --run --seconds 1500 --only urdf --in package
    python tools/corpora --into DIR --refusals FILE  refusals by their reasons, counted
    python tools/corpora --into DIR --write          docs/records/corpora.md and docs/records/corpora.json.gz from DIR/results

Stages: import (no engine), certify (the compiled files, in every engine), `apart` (the same without contact between the
model's own bodies, in the engines that refuse it), audit (the file itself, in every engine). Workers answer one file after the
other, each file within a deadline. Files are never copied into the project. Results missing in DIR/results are taken from
docs/records/corpora.json.gz, if they are of the same content of the same file.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import kept
import refusals
from models import fetch, models
from run import STAGES, run

import page

ROOT = Path(__file__).resolve().parents[2]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--into", type=Path, required=True, help="folder of packages and results")
    parser.add_argument("--fetch", action="store_true", help="install the packages that are missing")
    parser.add_argument("--run", action="store_true", help="ask about files")
    parser.add_argument("--stages", default=",".join(STAGES), help="which, in this order (default: all)")
    parser.add_argument("--anew", dest="again", action="store_const", const="anew", default="", help="ask again all")
    parser.add_argument("--failed", dest="again", action="store_const", const="failed", help="ask again what failed")
    parser.add_argument("--open", dest="again", action="store_const", const="open", help="and what engines refused")
    parser.add_argument("--engines", default="", help="engines that --open tries, separated by commas (default: all)")
    parser.add_argument("--only", default="", help="languages, by commas")
    parser.add_argument("--in", dest="within", default="", help="a text that package and name contain")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--seconds", type=float, default=24 * 3600.0, help="no file is begun later")
    parser.add_argument("--refusals", type=Path, help="a file that is written")
    parser.add_argument(
        "--write", action="store_true", help="write docs/records/corpora.md and docs/records/corpora.json.gz"
    )
    options = parser.parse_args()
    folder = options.into.resolve()
    if folder.is_relative_to(ROOT):
        parser.error("--into must lie outside of the project")
    folder.mkdir(parents=True, exist_ok=True)
    if options.fetch:
        fetch(folder)
    every = models(folder)
    results = folder / "results"
    print(f"{kept.restore(every, results)} answers of docs/records/corpora.json.gz")
    requested = [
        model
        for model in every
        if (not options.only or model.language in options.only.split(","))
        and options.within in f"{model.package} {model.name}"
    ]
    if options.run:
        run(
            requested,
            results,
            options.stages.split(","),
            options.workers,
            options.seconds,
            options.again,
            tuple(filter(None, options.engines.split(","))),
        )
    if options.refusals:
        options.refusals.write_text(refusals.listed(requested, results), encoding="utf-8")
    if options.write:
        page.write(every, results)
        kept.keep(every, results)
    return 0


if __name__ == "__main__":
    sys.exit(main())
