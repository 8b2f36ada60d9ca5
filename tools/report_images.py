"""The pictures of ``docs/guide/report.md``: a report in Chromium, at three sizes, and the page of a published study.

    simspec run spheres-216 --all-engines
    python tools/report_images.py runs/spheres-216
    python tools/report_images.py --study docs/records/studies/koerber-2021/report.html

Needs Chromium, and Pillow and Playwright of the extras plots and test.
"""

from __future__ import annotations

import io
import sys
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from tests import browser  # noqa: E402

IMAGES = ROOT / "docs" / "images"
SHOTS = {
    "report-wide": ((1280, 1560), "light", 0.15, ("camera: nearer",) * 3),
    "report-tablet": ((820, 1300), "dark", 0.25, ("side by side", "camera: nearer", "camera: nearer")),
    "report-phone": ((390, 1300), "light", 0.4, ("camera: nearer", "camera: nearer")),
}
"""Of each picture the window, the theme, the share of the time that is shown, and the buttons that are pressed before."""
STUDY_SIZE = (1280, 1000)
COLOURS = 192
"""Of a picture: a page has few."""


def study(path: Path) -> None:
    """The picture of a study's page: its first sentences and plots."""
    with browser.browsers() as start, browser.opened(start(*browser.SOFTWARE), path, *STUDY_SIZE) as (page, said):
        page.mouse.move(0, 0)
        page.wait_for_timeout(3000)
        _save(page.screenshot(), "study-wide", said)


def _save(screenshot: bytes, name: str, said: list[str]) -> None:
    picture = Image.open(io.BytesIO(screenshot)).convert("RGB")
    picture.quantize(COLOURS, dither=Image.Dither.NONE).save(IMAGES / f"{name}.png", optimize=True)
    print(f"{name}: {picture.size}, {(IMAGES / f'{name}.png').stat().st_size / 1000:.0f} kB", *said)


def main(folder: Path) -> None:
    from simspec.files import scratch_folder
    from simspec.report.page.document import page as page_of
    from simspec.report.studies import load_study

    with scratch_folder("report-images") as place, browser.browsers() as start:
        path = place / "report.html"
        path.write_text(page_of([load_study(folder)]), encoding="utf-8")
        running = start(*browser.SOFTWARE)
        for name, (size, scheme, share, buttons) in SHOTS.items():
            with browser.opened(running, path, *size, color_scheme=scheme) as (page, said):
                slider = page.locator("input.time")
                slider.fill(str(round(share * int(slider.get_attribute("max")))))
                for button in buttons:
                    page.get_by_role("button", name=button, exact=True).click()
                page.mouse.move(0, 0)
                page.evaluate("scrollTo(0, 0)")
                page.wait_for_timeout(3000)
                _save(page.screenshot(), name, said)


if __name__ == "__main__":
    study(Path(sys.argv[2]).resolve()) if sys.argv[1] == "--study" else main(Path(sys.argv[1]))
