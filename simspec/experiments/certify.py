"""The proofs of a sweep: each model that an engine is given is verified once, and the certificate is kept in the store.

A model is what the proof looks at: the world without its name, its expectations, its duration and what is recorded; the
engine's own options; the compiled files, but for the hash of the world in them; and all versions. Worlds that differ in
nothing else share a certificate. Initial states that are moved a little are not part of a world.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from simspec.distribution import own_version
from simspec.engines.kit.identity import engine_name
from simspec.errors import SpecError
from simspec.experiments.models import files_hash
from simspec.experiments.store import Store
from simspec.experiments.supplies import Prepared
from simspec.world.canonical import sha256, to_plain
from simspec.world.types import Record, World

if TYPE_CHECKING:
    from simspec.proof.certificate import Certificate
    from simspec.proof.verify import Probes

KEY_SCHEMA = 1
MEASURED_CONTACT = "L5"
"""The level that says how an engine solves contact at a timestep. All others say that it holds the model."""


def model_key(world: World, prepared: Prepared, versions: Mapping[str, str]) -> str:
    """What tells the model that an engine is given from every other that the proof tells apart."""
    physics = dataclasses.replace(world.physics, steps=0)
    alike = dataclasses.replace(world, name="", expectations=(), engines=(), record=Record(), physics=physics)
    name = engine_name(prepared.compiled.engine)
    return sha256(
        {
            "schema": KEY_SCHEMA,
            "simspec": own_version(),
            "world": to_plain(alike),
            "engine": prepared.compiled.engine,
            "options": to_plain(world.options(name)),
            "files": files_hash(world, prepared.compiled),
            "versions": dict(sorted(versions.items())),
        }
    )


class Certifier:
    """Verifies models that have no certificate in ``store`` yet. ``verdicts``: by the model's key, why it is not proven;
    None where it is. ``by_contact``: those that are not proven by contact as it was measured (L5), and by nothing else."""

    def __init__(
        self, store: Store, pythons: Mapping[str, str], deadline: float, say: Callable[[str], None], verify: bool = True
    ):
        self._store, self._pythons, self._deadline, self._say = store, pythons, deadline, say
        self._verify = verify
        self.verdicts: dict[str, str | None] = {}
        self.by_contact: set[str] = set()
        self.notes: list[str] = []
        self.made = 0
        self._probes: tuple[str, Probes] | None = None

    def known(self, key: str) -> bool:
        """Whether there is a certificate of a model, valid or not, that can be read."""
        return key in self.verdicts or self._stored(key)

    def demand(self, world: World, prepared: Prepared, versions: Mapping[str, str]) -> str:
        """See to it that the model has a certificate; its key. Whether it is valid stands in ``verdicts``."""
        key = model_key(world, prepared, versions)
        if not self.known(key):
            self._make(key, world, prepared)
        return key

    def _stored(self, key: str) -> bool:
        from simspec.proof.certificate import Certificate

        text = self._store.certificate_text(key)
        if text is None:
            return False
        try:
            certificate = Certificate.from_json(text, f"the certificate {key[:16]}…")
        except SpecError as error:
            self.notes.append(f"{error.problems[0].message}; it is made anew")
            return False
        self._judge(key, certificate)
        return True

    def _make(self, key: str, world: World, prepared: Prepared) -> None:
        from simspec.proof.verify import prepare, verify

        label = prepared.compiled.engine
        self._say(f"verifying {label}")
        name = sha256(world)
        if self._probes is None or self._probes[0] != name:
            self._probes = (name, prepare(world))
        certificate = verify(
            world,
            [label],
            compiled={label: prepared.compiled},
            artifacts={label: prepared.folder},
            pythons=self._pythons,
            deadline=self._deadline,
            probes=self._probes[1],
        )
        self._store.put_certificate(key, certificate.to_json())
        self._judge(key, certificate)
        self.made += 1

    def _judge(self, key: str, certificate: Certificate) -> None:
        self.verdicts[key] = _verdict(certificate)
        failures = certificate.failures()
        if failures and all(check.level == MEASURED_CONTACT for _, check in failures):
            self.by_contact.add(key)


def _verdict(certificate: Certificate) -> str | None:
    """Why a certificate is not valid; None where it is."""
    if certificate.valid:
        return None
    failures = certificate.failures()
    if not failures:
        return "nothing was compared"
    _, check = failures[0]
    more = f"; and {len(failures) - 1} more failed checks" if len(failures) > 1 else ""
    return f"{check.level} {check.name}{more}"
