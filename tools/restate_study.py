"""Sentences and page of a published study anew, from its own figures and the runs that its page plays back: nothing is run,
measured or proven, and no figure changes. For a change of words alone; `simspec study NAME --publish DIR` makes the tables too.

    python tools/restate_study.py docs/records/studies/koerber-2021 runs/koerber-2021-small/sweep
"""

from __future__ import annotations

import hashlib
import json
import sys
from pathlib import Path

from simspec.commands.study import PAGE_FILE, find_study, page, published_files
from simspec.experiments.after_sweep import MODELS_FILE, read_models
from simspec.experiments.store import Store
from simspec.language.load import load_study_file
from simspec.outputs.targets import STUDY
from simspec.outputs.writing import write_folder
from simspec.report.page.document import page as html
from simspec.report.screen import PAGE_FILE as HTML_FILE
from simspec.report.study.pages import TABLES_FILE, stored_table, study_parts, tables_text
from simspec.report.study.sentences import said_of
from simspec.stored import StudyTables, read_as


def main(folder: Path, store: Path) -> None:
    stored = tables_text(folder)
    if stored is None:
        raise SystemExit(f"{folder} is not a published study")
    kept = read_models(folder)
    data = json.loads(stored[1])
    for tables_of_sweep in data["sweeps"].values():
        for shown in tables_of_sweep:
            shown["said"] = list(said_of(shown["name"], shown["records"])) or shown["said"]
    text = json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    tables = read_as(StudyTables, text, TABLES_FILE)
    made = {name: {table.name: stored_table(table) for table in shown} for name, shown in tables.sweeps.items()}
    models = json.loads((folder / MODELS_FILE).read_text(encoding="utf-8"))
    models["study_sha256"] = hashlib.sha256(text.encode()).hexdigest()
    files = {
        TABLES_FILE: text,
        PAGE_FILE: page(load_study_file(find_study(kept.source)), made, data),
        HTML_FILE: html([study_parts(tables, Store.open(store))]),
    }
    models_text = json.dumps(models, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    write_folder(published_files(files, models_text), folder, STUDY)
    print(f"{folder}: {', '.join(files)}")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
