"""``show()`` of worlds, runs and studies: the page in a notebook, in a frame that can reach nothing around it."""

from __future__ import annotations

import html
import sys
import webbrowser
from dataclasses import dataclass, field
from pathlib import Path

from simspec.comparison.study import Study
from simspec.errors import Problem, SpecError, visible
from simspec.outputs.writing import write_file
from simspec.report.screen import say
from simspec.runner.run import Run
from simspec.world.types import World

WIDTH, HEIGHT = 960, 620
SMALLEST, LARGEST = 100, 10_000
OUTSIDE = (
    "show() displays in notebooks; elsewhere: .save('scene.html') writes the page, .open('scene.html') also opens it"
)


@dataclass(frozen=True)
class ShownPage:
    """A page that a notebook displays, ``width`` × ``height`` pixels."""

    name: str
    html: str = field(repr=False)
    width: int = WIDTH
    height: int = HEIGHT

    def __repr__(self) -> str:
        return f"<ShownPage {self.name!r}: {OUTSIDE}>"

    def _repr_html_(self) -> str:
        """The page in a frame without access to the notebook: it can neither read it nor reach its server."""
        return (
            f'<iframe sandbox="allow-scripts" title="{html.escape(self.name)}" width="{self.width}" height="{self.height}" '
            f'style="border:0;max-width:100%" srcdoc="{html.escape(self.html)}"></iframe>'
        )

    def save(self, file: Path | str) -> Path:
        """Write the page to a file. Raises SpecError where another program's file is there."""
        from simspec.report.page.document import is_page

        return write_file(Path(file), self.html, is_page)

    def open(self, file: Path | str) -> Path:
        """Write the page to a file, and open it in the browser where there is one."""
        path = self.save(file)
        webbrowser.open(path.absolute().as_uri())
        return path


def show_world(world: World, width: int = WIDTH, height: int = HEIGHT) -> ShownPage:
    """The world in its initial state, with sliders for its joints: displayed by a notebook, ``width`` × ``height`` pixels."""
    from simspec.report.page.scene import scene_page

    return _shown(world.name, scene_page(world), width, height)


def show_run(run: Run, width: int = WIDTH, height: int = HEIGHT) -> ShownPage:
    """The report of a run, with its playback: displayed by a notebook, ``width`` × ``height`` pixels."""
    from simspec.comparison.runs import TOLERANCE
    from simspec.report.studies import study_of

    return show_study(study_of({run.engine: run}, {}, None, TOLERANCE), width, height)


def show_study(study: Study, width: int = WIDTH, height: int = HEIGHT) -> ShownPage:
    """The report of a study, with a playback of all its runs: displayed by a notebook, ``width`` × ``height`` pixels."""
    from simspec.report.page.document import page
    from simspec.report.studies import StoredStudy

    return _shown(study.world.name, page([StoredStudy(study, Path(), ())]), width, height)


def _shown(name: str, text: str, width: int, height: int) -> ShownPage:
    for word, size in (("width", width), ("height", height)):
        if not SMALLEST <= size <= LARGEST:
            raise SpecError(
                [Problem(f"{word} of a shown page", found=f"{size}", allowed=f"{SMALLEST} to {LARGEST}", code="C103")]
            )
    if not in_notebook():
        say(OUTSIDE, error=True)
    return ShownPage(visible(name), text, width, height)


def in_notebook() -> bool:
    """Whether this process is the kernel of a notebook."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return getattr(shell, "kernel", None) is not None
