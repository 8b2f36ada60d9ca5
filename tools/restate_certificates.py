"""Certificates under generated/ with the reasons that simspec and its engines declare today: nothing is compiled for a run,
measured or proven, no engine needs to be installed, and no figure changes. For a change of words alone; after a change of a
declaration's size, of a format or of a check `simspec verify` proves the worlds anew.

    python tools/restate_certificates.py [generated/NAME ...]
"""

from __future__ import annotations

import dataclasses
import json
import sys
from collections.abc import Mapping
from pathlib import Path

from simspec.engines.kit.contract import Engine
from simspec.engines.kit.registry import engine_name, find_engine
from simspec.generated import CERTIFICATE_FILE, GENERATED, owned_files
from simspec.outputs.targets import COMPILED
from simspec.outputs.writing import write_folder
from simspec.proof.certificate import Certificate, EngineProof
from simspec.proof.contact.probe import ProbeFigure
from simspec.proof.contact.run import contact_checks, deviating, laws
from simspec.proof.expected import NO_FRAMES, Realised, not_checked_parts, realised, unreadable
from simspec.proof.judge import judge_proof
from simspec.world.canonical import from_plain
from simspec.world.types import World

WORLD_FILE = "world.json"


def restated(certificate: Certificate, world: World) -> Certificate:
    """The certificate with today's reasons. Raises ValueError where a reason has no declaration today, or the figures do not
    belong to the declarations."""
    proofs = {name: _proof(name, proof, world) for name, proof in certificate.engines.items()}
    faults = [f"{name}: {line}" for name, proof in proofs.items() for line in judge_proof(name, proof, world)]
    if faults:
        raise ValueError("; ".join(faults))
    return dataclasses.replace(certificate, engines=proofs)


def _proof(name: str, proof: EngineProof, world: World) -> EngineProof:
    engine, files = find_engine(engine_name(name)), realised(world, name, proof.version)
    reasons = {"frames": NO_FRAMES} | dict(unreadable(world, engine.UNREADABLE))
    reasons |= not_checked_parts(world, engine, proof.not_compared)
    contact = tuple(_figure(figure, world, engine, files, proof.version) for figure in proof.contact)
    details = dict(zip(contact_checks(proof.contact), contact_checks(contact), strict=True))
    return dataclasses.replace(
        proof,
        checks=tuple(details.get(check, check) for check in proof.checks),
        approximations=_texts(name, proof.approximations, files.approximations),
        not_checked=_texts(name, proof.not_checked, reasons),
        contact=contact,
    )


def _texts(engine: str, stored: Mapping[str, str], declared: Mapping[str, str]) -> dict[str, str]:
    if missing := ", ".join(stored.keys() - declared.keys()):
        raise ValueError(f"{engine}: no reason is declared today for {missing}")
    return {name: declared[name] for name in stored}


def _figure(figure: ProbeFigure, world: World, engine: type[Engine], files: Realised, version: str) -> ProbeFigure:
    """The figure with the reason of the declared deviation of the same size."""
    law = next((law for law in laws(world) if law.subject == figure.subject), None)
    if not figure.deviation or law is None:
        return figure
    bare = dataclasses.replace(figure, tolerance=figure.promised or 0.0, deviation="", promised=None)
    settings = files.between((law.pair.first, law.pair.second))
    deviation = deviating(bare, law, engine, settings, version).deviation
    return dataclasses.replace(figure, deviation=deviation)  # judge_proof compares its size


def main(folder: Path) -> None:
    """Restate the certificate of a folder of compiled files."""
    files = owned_files(folder)
    certificate = Certificate.from_json(files[CERTIFICATE_FILE].decode(), str(folder / CERTIFICATE_FILE))
    world: World = from_plain(World, json.loads(files[WORLD_FILE]))
    text = restated(certificate, world).to_json().encode()
    if text != files[CERTIFICATE_FILE]:
        write_folder(files | {CERTIFICATE_FILE: text}, folder, COMPILED)
        print(f"{folder}: {CERTIFICATE_FILE}")


if __name__ == "__main__":
    for place in [Path(name) for name in sys.argv[1:]] or sorted(GENERATED.iterdir()):
        if (place / CERTIFICATE_FILE).is_file():
            main(place)
