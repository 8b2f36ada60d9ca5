"""The tutorials run, and print what their pages show: the same text, with numbers that may differ by a hundredth."""

from __future__ import annotations

import math
import re
import sys

import pytest

from tests.docs.blocks import ROOT

sys.path.insert(0, str(ROOT / "tools"))

import tutorials

NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e[+-]?\d+)?(?!\w)")
NEEDS = {
    "bring-my-robot": ("mujoco", "pybullet"),
    "why-engines-differ": ("mujoco", "dartpy"),
    "sweep-and-study": ("mujoco", "dartpy"),
}


def differs(shown: str, printed: str) -> bool:
    """Whether an output is not what a page shows."""
    texts = [" ".join(NUMBER.sub("#", text).split()) for text in (shown, printed)]
    numbers = [[float(number) for number in NUMBER.findall(text)] for text in (shown, printed)]
    return texts[0] != texts[1] or not all(
        math.isclose(a, b, rel_tol=0.01, abs_tol=1e-9) for a, b in zip(*numbers, strict=True)
    )


def test_there_are_five():
    assert len(tutorials.PAGES) == 5
    assert {page.stem for page in tutorials.PAGES} > set(NEEDS)


@pytest.mark.parametrize("page", tutorials.PAGES, ids=lambda page: page.stem)
def test_a_tutorial_prints_what_its_page_shows(page):
    for module in NEEDS.get(page.stem, ("mujoco",)):
        pytest.importorskip(module)
    cells = list(tutorials.CELL.finditer(page.read_text(encoding="utf-8")))
    made = tutorials.outputs(page)
    assert any(made)
    wrong = [
        f"{cell['code']}\nshown: {cell['output']}\nprinted: {output}"
        for cell, output in zip(cells, made, strict=True)
        if not cell["varies"] and differs(cell["output"] or "", output)
    ]
    assert not wrong, f"python tools/tutorials.py {page.relative_to(ROOT)}"


@pytest.mark.parametrize(
    ("printed", "other"), [("box slid 0.30 m", False), ("box slid 0.31 m", True), ("ball slid 0.30 m", True)]
)
def test_another_output_is_noticed(printed, other):
    assert differs("box  slid 0.3 m", printed) is other
