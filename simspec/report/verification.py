"""``simspec verify``: prove, write the certificate, print; each function returns the exit code."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from pathlib import Path

from simspec import generated
from simspec.errors import EXIT_FAILED, EXIT_OK, Location
from simspec.report import terminal
from simspec.report.plain import plain, text
from simspec.world.types import World


def verify(
    world: World,
    engines: list[str],
    locate: Callable[[str], Location | None],
    pythons: Mapping[str, str],
    deadline: float,
    out: Path | None,
    as_json: bool,
) -> int:
    """Compile ``world`` into its generated folder, verify what is there, and write the certificate beside it."""
    from simspec.proof.verify import verify as prove

    folder = out or generated.GENERATED / world.name
    built = generated.build(world, engines, locate)
    generated.write(built, folder)
    with terminal.progress(not as_json) as progress:
        certificate = prove(
            world,
            engines,
            artifacts={name: folder / name for name in engines},
            pythons=pythons,
            locate=locate,
            deadline=deadline,
            progress=progress,
        )
    written = generated.write_certificate(certificate, folder)
    path = folder / generated.CERTIFICATE_FILE
    if as_json:
        sys.stdout.write(text({"certificate": plain(certificate), "valid": certificate.valid, "file": path}))
    else:
        screen = terminal.console()
        terminal.show_certificate(certificate, screen)
        screen.print(f"{path}: {'written' if written else 'unchanged'}", soft_wrap=True)
    return EXIT_OK if certificate.valid else EXIT_FAILED


def self_test(engines: list[str], pythons: Mapping[str, str], as_json: bool) -> int:
    """Plant defects into compiled files, one at a time, and count the ones that the proof catches."""
    from simspec.proof.selftest import self_test as plant

    with terminal.progress(not as_json) as progress:
        found = plant(engines, pythons=pythons, progress=progress)
    if as_json:
        sys.stdout.write(text({"planted": found.planted, "caught": found.caught, "outcomes": found.outcomes}))
    else:
        screen = terminal.console()
        screen.print(terminal.self_test_table(found))
        screen.print(f"caught {found.caught} of {found.planted} planted defects")
    return EXIT_OK if found.passed else EXIT_FAILED
