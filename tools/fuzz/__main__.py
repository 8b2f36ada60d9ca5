"""Changed files for every importer: the outcome of each, and its defects.

    python tools/fuzz --language urdf --minutes 10        as many cases as fit into ten minutes of processor time
    python tools/fuzz --language usd --case 417           that one case: its outcome, and its files in --keep
    python tools/fuzz --language sdf --corpus FOLDER      with files of a folder to begin with, too

A case is its number: the same files on every machine. Exit code 1 where anything was found.
"""

from __future__ import annotations

import argparse
import collections
import contextlib
import json
import os
import resource
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

for thread in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(thread, "1")
ROOT = Path(__file__).resolve().parent.parent.parent
sys.path.insert(0, str(ROOT))

from cases import Fuzz, corpus, warmed  # noqa: E402
from seeds import LANGUAGES  # noqa: E402


def processor_seconds() -> float:
    """Of this process, and of all that it has started."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(usage.ru_utime + usage.ru_stime for usage in used)


@contextlib.contextmanager
def a_folder(keep: Path | None) -> Iterator[Path]:
    """Where cases stand."""
    if keep is not None:
        yield keep.resolve()
        return
    with tempfile.TemporaryDirectory(prefix="fuzz-") as made:
        yield Path(made) / "case"


def main() -> int:
    """Do what the command line says."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--language", choices=LANGUAGES, required=True)
    parser.add_argument("--minutes", type=float, default=10.0, help="of processor time")
    parser.add_argument("--case", type=int, help="only this one")
    parser.add_argument("--first", type=int, default=0, help="the number of the first case")
    parser.add_argument("--keep", type=Path, help="the folder of the case, kept")
    parser.add_argument("--corpus", type=Path, help="a folder with further files to begin with")
    parser.add_argument("--findings", type=Path, help="a file to which findings are added, one JSON in a line")
    words = parser.parse_args()
    warmed(words.language)
    more = corpus(words.corpus, words.language, 60)
    with a_folder(words.keep) as folder, tempfile.TemporaryDirectory(prefix="fuzz-cache-") as cache:
        os.environ["XDG_CACHE_HOME"] = cache
        fuzz = Fuzz(words.language, folder, more)
        fuzz.begin()
        if words.case is not None:
            outcome, finding = fuzz.attempt(words.case)
            print(outcome, *(finding.wrong if finding is not None else ()), sep="\n")
            return int(finding is not None)
        return _many(fuzz, words.first, 60.0 * words.minutes, words.findings)


def _many(fuzz: Fuzz, first: int, seconds: float, log: Path | None) -> int:
    outcomes: collections.Counter[str] = collections.Counter()
    kinds: collections.Counter[str] = collections.Counter()
    begun, case, wall = processor_seconds(), first, time.monotonic()
    while processor_seconds() - begun < seconds:
        outcome, finding = fuzz.attempt(case)
        outcomes[outcome] += 1
        if finding is not None:
            kind = finding.wrong[0].strip().rpartition("\n")[2][:150]
            kinds[kind] += 1
            if kinds[kind] <= 3:
                print(
                    f"{fuzz.language} case {case} ({', '.join(finding.changes)}): {finding.outcome}: {kind}", flush=True
                )
            if log is not None:
                with log.open("a") as stream:
                    stream.write(json.dumps({"language": fuzz.language, **vars(finding)}) + "\n")
        case += 1
    accepted = outcomes.pop("accepted", 0)
    spent = processor_seconds() - begun
    print(
        f"{fuzz.language}: {case - first} cases ({first} to {case - 1}) in {spent:.0f} s of processor time, "
        f"{time.monotonic() - wall:.0f} s: {accepted} accepted, {outcomes.total()} refused in {len(outcomes)} ways, "
        f"{kinds.total()} findings of {len(kinds)} kinds"
    )
    return int(bool(kinds))


if __name__ == "__main__":
    sys.exit(main())
