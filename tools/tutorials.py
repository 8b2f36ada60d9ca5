"""Run the tutorials, docs/tutorials/*.md, and write the output of each cell behind it.

    python tools/tutorials.py [docs/tutorials/my-first-scene.md ...]

A tutorial is a notebook in Jupytext's Markdown: blocks of ``python`` and ``bash`` are its cells, run one after the other in an
empty folder. The value of a cell's last expression is shown, as in a notebook. A block with the comment ``output: varies``
before it is written, and not compared by the tests.
"""

from __future__ import annotations

import ast
import contextlib
import io
import json
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PAGES = sorted(page for page in (ROOT / "docs" / "tutorials").glob("*.md") if page.name != "index.md")
CELL = re.compile(
    r"```(?P<language>python|bash)\n(?P<code>.*?)```\n"
    r"(?:\n?<!-- output(?P<varies>: varies)? -->\n```text\n(?P<output>.*?)```\n)?",
    re.DOTALL,
)
COLUMNS = "88"


def cell_output(language: str, code: str, names: dict[str, object]) -> str:
    """The output of a cell; a cell of ``bash`` must end with the exit code 0."""
    if language == "bash":
        done = subprocess.run(["bash", "-c", code], capture_output=True, text=True, check=False)
        if done.returncode:  # which a notebook shows as an exception
            raise RuntimeError(f"exit code {done.returncode}: {code}\n{done.stderr}")
        return done.stdout  # standard error has notes of progress, which depend on the machine
    tree = ast.parse(code)
    last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(tree, "cell", "exec"), names)
        if isinstance(last, ast.Expr):
            value = eval(compile(ast.Expression(last.value), "cell", "eval"), names)
            # a notebook shows a page there, which is not stored
            if value is not None and not hasattr(value, "_repr_html_"):
                print(repr(value))
    return printed.getvalue()


def outputs(page: Path) -> list[str]:
    """The outputs of the cells of a tutorial, run in a process and a folder of their own."""
    with tempfile.TemporaryDirectory() as place:
        path = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
        environment = {
            **os.environ,
            "PATH": path,
            "COLUMNS": COLUMNS,
            "MPLBACKEND": "Agg",
            "XDG_DATA_HOME": place,
            "XDG_CACHE_HOME": f"{place}/.cache",
        }
        command = [sys.executable, __file__, "--cells", str(page)]
        done = subprocess.run(command, cwd=place, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"{page.name}: {done.stderr[-2000:]}")
    return json.loads(done.stdout)


def run_cells(page: Path) -> list[str]:
    """The outputs of the cells, run in this process and folder."""
    names: dict[str, object] = {"__name__": "__main__"}
    cells = CELL.finditer(page.read_text(encoding="utf-8"))
    return [cell_output(cell["language"], cell["code"], names) for cell in cells]


def filled(text: str, made: list[str]) -> str:
    """The page with the outputs ``made``."""
    left = iter(made)

    def block(cell: re.Match[str]) -> str:
        output = "\n".join(line.rstrip() for line in next(left).splitlines()).strip("\n")
        code = f"```{cell['language']}\n{cell['code']}```\n"
        return f"{code}\n<!-- output{cell['varies'] or ''} -->\n```text\n{output}\n```\n" if output else code

    return CELL.sub(block, text)


def main() -> int:
    if sys.argv[1:2] == ["--cells"]:
        print(json.dumps(run_cells(Path(sys.argv[2]))))
        return 0
    for page in [Path(name).resolve() for name in sys.argv[1:]] or PAGES:
        page.write_text(filled(page.read_text(encoding="utf-8"), outputs(page)), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
