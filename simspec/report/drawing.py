"""What every figure for papers is drawn with: colours that colour-blind people tell apart, and the same bytes each time."""

from __future__ import annotations

import io
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from simspec.errors import Problem, SpecError

MARKERS = ("o", "x", "+", "s", "^", "d")
"""One per engine, in order: readable on top of each other, and without colours."""
DASHES = ("-", "--", "-.", ":", (0, (5, 1)), (0, (1, 1)))
"""The same for lines."""
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
"""Told apart by colour-blind people too (Okabe and Ito)."""
STYLE: Mapping[str, Any] = MappingProxyType({"svg.hashsalt": "simspec", "svg.fonttype": "path", "font.size": 8})
"""An SVG's bytes depend on what is drawn alone."""


def saved(chart: Any, resolution: int = 110) -> dict[str, bytes]:
    """A figure of matplotlib as SVG and PNG, by suffix."""
    drawn = {}
    for suffix, more in ((".svg", {"metadata": {"Date": None}}), (".png", {"dpi": resolution})):
        picture = io.BytesIO()
        chart.savefig(picture, format=suffix[1:], **more)
        drawn[suffix] = picture.getvalue()
    return drawn


def pyplot() -> Any:
    """matplotlib's pyplot, without a display. Raises SpecError where it is not installed."""
    try:
        import matplotlib
    except ImportError as error:
        problem = Problem("plots need matplotlib", found=str(error), hint="pip install 'simspec[plots]'")
        raise SpecError([problem]) from None
    matplotlib.use("Agg")
    from matplotlib import pyplot

    return pyplot
