"""The size of the project in figures: files, lines, importers, parameters, words, modules loaded and processor time
of commands.

    python tools/size.py --json now.json             # store the figures
    python tools/size.py --against before.json       # a Markdown table, before and now
    python tools/size.py --tests --commands          # also collect the tests, and time commands (least of several runs)

``--root`` examines another working tree; its commands are started with the Python of its ``.venv``.
"""

from __future__ import annotations

import argparse
import ast
import collections
import io
import json
import os
import re
import statistics
import subprocess
import sys
import tempfile
import time
import tokenize
from pathlib import Path

SPEC = "specs/ball-pendulum.yaml"
COMMANDS = {
    "check": ["check", SPEC],
    "compile, one engine": ["compile", SPEC, "--engine", "mujoco", "--out", "{folder}/one"],
    "compile, all engines": ["compile", SPEC, "--out", "{folder}/all"],
    "diff --help": ["diff", "--help"],
    "run --help": ["run", "--help"],
    "report --help": ["report", "--help"],
    "--help": ["--help"],
}
REPEATS = 7
MANY = 8
"""Parameters of a function that are too many to remember."""


def lines_by_role(text: str) -> collections.Counter[str]:
    """Lines of code, docstrings, comments, and blank lines."""
    roles: dict[int, str] = {}
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            roles.update(dict.fromkeys(range(node.lineno, (node.end_lineno or node.lineno) + 1), "docstrings"))
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT and token.line.lstrip().startswith("#"):
            roles[token.start[0]] = "comments"
    rows = text.splitlines()
    return collections.Counter(
        roles.get(number) or ("code" if row.strip() else "blank") for number, row in enumerate(rows, 1)
    )


def imports_of(tree: ast.AST) -> set[str]:
    """Modules that a module imports, at its top or within functions."""
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            found.add(node.module)
            found.update(f"{node.module}.{alias.name}" for alias in node.names)
    return found


def code(root: Path) -> dict[str, float]:
    """Figures of ``simspec/``, from its text alone."""
    texts = {path: path.read_text(encoding="utf-8") for path in sorted((root / "simspec").rglob("*.py"))}
    trees = {path: ast.parse(text) for path, text in texts.items()}
    names = {".".join(path.relative_to(root).with_suffix("").parts).removesuffix(".__init__"): path for path in texts}
    importers = collections.Counter(
        other for name, path in names.items() for other in imports_of(trees[path]) & names.keys() if other != name
    )
    roles = sum((lines_by_role(text) for text in texts.values()), collections.Counter[str]())
    functions = [
        node for tree in trees.values() for node in ast.walk(tree) if isinstance(node, (ast.FunctionDef, ast.Lambda))
    ]
    parameters = [len(node.args.args) + len(node.args.kwonlyargs) + len(node.args.posonlyargs) for node in functions]
    classes = collections.Counter(
        node.name for tree in trees.values() for node in ast.walk(tree) if isinstance(node, ast.ClassDef)
    )
    lengths = [text.count("\n") for text in texts.values()]
    return {
        "files": len(texts),
        "files, empty or of one line": sum(length <= 1 for length in lengths),
        "lines": sum(lengths),
        **{f"lines, {role}": roles[role] for role in ("code", "docstrings", "comments", "blank")},
        "lines of a file, median": statistics.median(lengths),
        "lines of a file, most": max(lengths),
        "modules with one importer": sum(count == 1 for count in importers.values()),
        "functions": len(functions),
        f"functions of {MANY} parameters and more": sum(count >= MANY for count in parameters),
        "parameters of a function, most": max(parameters),
        "class names": len(classes),
        "class names that stand for several classes": sum(count > 1 for count in classes.values()),
        "lines of tests": sum(path.read_text(encoding="utf-8").count("\n") for path in (root / "tests").rglob("*.py")),
        "words of documentation": sum(
            len(path.read_text(encoding="utf-8").split()) for path in (root / "docs").rglob("*.md")
        ),
    }


def words(root: Path) -> dict[str, float]:
    """Avoided words (``docs/glossary.md`` of this tree) in names, prose and pages of ``root``."""
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
    from tests import words as vocabulary

    modules = [*(root / "simspec").rglob("*.py"), *(root / "tests").rglob("*.py")]
    pages = [root / "README.md", *(root / "docs").rglob("*.md")]
    skipped = ("glossary.md", "words.py", "test_words.py")
    return {
        "avoided words, simspec": sum(len(vocabulary.in_module(path)) for path in modules if "tests" not in path.parts),
        "avoided words, tests": sum(
            len(vocabulary.in_module(path)) for path in modules if "tests" in path.parts and path.name not in skipped
        ),
        "avoided words, pages": sum(len(vocabulary.in_page(path)) for path in pages if path.name not in skipped),
    }


def commands(root: Path) -> dict[str, float]:
    """Modules loaded and least processor time (s) of commands, each in a fresh interpreter."""
    python = root / ".venv" / "bin" / "python"
    figures: dict[str, float] = {}
    for name, words_of_command in COMMANDS.items():
        seconds = []
        with tempfile.TemporaryDirectory() as folder:
            arguments = [word.format(folder=folder) for word in words_of_command]
            for _ in range(REPEATS):
                before = os.times()
                done = subprocess.run(
                    [python, "-m", "simspec", *arguments], cwd=root, capture_output=True, text=True, check=False
                )
                after = os.times()
                if done.returncode:
                    sys.exit(f"simspec {' '.join(arguments)} ended with {done.returncode}: {done.stderr[-500:]}")
                seconds.append(
                    after.children_user + after.children_system - before.children_user - before.children_system
                )
            loaded = subprocess.run(
                [python, "-X", "importtime", "-m", "simspec", *arguments],
                cwd=root,
                capture_output=True,
                text=True,
                check=False,
            ).stderr
        modules = re.findall(r"^import time:[^|]*\|[^|]*\|\s*(\S+)$", loaded, re.MULTILINE)
        figures[f"{name}: processor time, s"] = round(min(seconds), 2)
        figures[f"{name}: modules of simspec"] = sum(module.split(".")[0] == "simspec" for module in modules)
        figures[f"{name}: modules"] = len(modules)
    return figures


def tests(root: Path) -> dict[str, float]:
    """Test items, and the seconds of their collection."""
    began = time.perf_counter()
    done = subprocess.run(
        [root / ".venv" / "bin" / "pytest", "--collect-only", "-q"],
        cwd=root,
        capture_output=True,
        text=True,
        check=False,
    )
    found = re.search(r"^(\d+)(?:/\d+)? tests collected", done.stdout, re.MULTILINE)
    if found is None:
        sys.exit(f"the tests were not collected: {done.stdout[-500:]}")
    return {"test items": int(found[1]), "collection, s": round(time.perf_counter() - began, 1)}


def table(now: dict[str, float], before: dict[str, float]) -> str:
    """The figures as Markdown, with the earlier ones where there are some."""
    rows = ["| figure | before | now |", "|---|---:|---:|"] if before else ["| figure | now |", "|---|---:|"]
    for name, value in now.items():
        cells = [f"{before[name]:,g}" if name in before else "–"] if before else []
        rows.append(f"| {' | '.join([name, *cells, f'{value:,g}'])} |")
    return "\n".join(rows).replace("e+06", "000000")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--root", type=Path, default=Path(__file__).resolve().parent.parent)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--against", type=Path)
    parser.add_argument("--tests", action="store_true")
    parser.add_argument("--commands", action="store_true")
    options = parser.parse_args()
    root = options.root.resolve()
    figures = {**code(root), **words(root)}
    figures |= commands(root) if options.commands else {}
    figures |= tests(root) if options.tests else {}
    if options.json:
        options.json.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")
    print(table(figures, json.loads(options.against.read_text(encoding="utf-8")) if options.against else {}))


if __name__ == "__main__":
    main()
