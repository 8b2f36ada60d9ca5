"""The record of one proof: hashes, versions, each check with its tolerance and worst deviation, and what was not checked."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from simspec.engines.kit.capabilities import DOUBLE
from simspec.engines.kit.methods import ORDINALS
from simspec.errors import Problem, SpecError, html_table
from simspec.plugins import simspec_version
from simspec.proof.checks import TOO_CHAOTIC, Check
from simspec.proof.contact.probe import ProbeFigure
from simspec.proof.contact.scope import DeclaredShare, declared, unmeasured
from simspec.stored import StoredCertificate, parse, read_as
from simspec.support.declarations import Level
from simspec.world.canonical import from_plain, to_plain

SCHEMA = 5
"""4: the version of simspec, and a hash of the content. 5: directions of figures as numbers, and a verdict in words."""
HASH_LINE = re.compile(r'^  "sha256": "([0-9a-f]{64})",\n', re.MULTILINE)
"""Where the hash of all the other lines stands."""


@dataclass(frozen=True, slots=True)
class MotionLimit:
    """The figures of a motion in the limit, as a certificate keeps them.

    order          the declared one
    timesteps      (s), from the coarsest
    deviations     the largest of each from the exact motion: m relative to the larger of 1 m and the distance from the origin,
                   plus rad
    ratios         of each deviation to the next, in the sense of least squares; 0: below the round-off
    extrapolated   the deviation of the extrapolated motion
    away           the largest deviation from semi-implicit Euler by the coarsest timestep: (m, rad)
    seconds        the time of the motion
    """

    order: int
    timesteps: tuple[float, ...]
    deviations: tuple[float, ...]
    ratios: tuple[float, ...]
    extrapolated: float
    away: tuple[float, float]
    seconds: float

    @property
    def ordinal(self) -> str:
        """The order in words."""
        return ORDINALS.get(self.order, f"{self.order}th")

    @property
    def text(self) -> str:
        """The figures in a line."""
        pairs = zip(self.timesteps, self.deviations, strict=True)
        shown = ", ".join(f"{size:.1e} at {1e3 * timestep:g} ms" for timestep, size in pairs)
        return f"from the exact motion {shown}; extrapolated {self.extrapolated:.1e}; {self.difference}"

    @property
    def difference(self) -> str:
        """The deviation from semi-implicit Euler in words."""
        metres, radians = self.away
        turned = f" and {radians:.2g} rad" if radians else ""
        return (
            f"{1e3 * metres:.2g} mm{turned} from semi-implicit Euler after {self.seconds:g} s at "
            f"{1e3 * self.timesteps[0]:g} ms"
        )


@dataclass(frozen=True, slots=True)
class EngineProof:
    """The proof of one engine.

    ``approximations``: features the spec accepted as approximate, and those computed outside the engine, with how;
    ``not_checked``: fields that are not readable back, with the reason; ``seconds``: wall time of its process;
    ``not_compared``: levels, and checks of a level ("L4 collision matrix"), that were not compared because this world has
    nothing to compare there or they were not requested, with the reason. Any other part without a comparison is a failed check.
    """

    version: str
    artifacts_sha256: str
    checks: tuple[Check, ...]
    approximations: dict[str, str] = field(default_factory=dict)
    not_checked: dict[str, str] = field(default_factory=dict)
    seconds: float = 0.0
    contact: tuple[ProbeFigure, ...] = ()
    """Every figure of the contact probes (level L5), each with its analytic value."""
    not_compared: dict[str, str] = field(default_factory=dict)
    precision: str = DOUBLE
    """The numbers of the engine, by which its tolerances are (``proof/checks.py``)."""
    contact_scope: dict[str, str] = field(default_factory=dict)
    """By kind of contact whether level L5 measured it for this world, or why not (``proof/contact/scope.py``)."""
    convergence: MotionLimit | None = None
    """The figures of the motion in the limit (level L6), of an engine with another method than semi-implicit Euler."""

    def __repr__(self) -> str:
        return f"<EngineProof {self.version}: {len(self.checks)} checks, {'valid' if self.valid else 'not valid'}>"

    @property
    def valid(self) -> bool:
        """Whether there are checks and all have passed, of the engine and not of its files alone; a check that compared nothing
        has not passed."""
        return self.passed and not self.files_alone

    @property
    def passed(self) -> bool:
        """Whether there are checks and all have passed, whatever was not checked."""
        return bool(self.checks) and all(check.passed for check in self.checks)

    @property
    def files_alone(self) -> bool:
        """Whether only the files were checked (L0), since the engine is not there: nothing is proven of it."""
        return "L1" in self.not_checked

    @property
    def accepted(self) -> list[str]:
        """The features that differ from the spec, as it accepts: all but those that simspec computes outside the engine."""
        return [name for name, how in self.approximations.items() if not how.startswith(f"{Level.OUTSIDE.value}:")]

    @property
    def unchecked(self) -> dict[str, str]:
        """The parts of the proof that the engine does not offer, by title, with the reason that it declares."""
        from simspec.proof.expected import TITLES

        return {name: why for name, why in self.not_checked.items() if name in TITLES}

    @property
    def verdict(self) -> str:
        """In a line: ``valid``, in which numbers where these are not doubles, with what was not checked, or is there and too
        chaotic to be compared, and why, and what its contact rests on; ``not valid``; or ``not proven`` where the files alone
        were checked."""
        if not self.passed:
            return "not valid"
        if self.files_alone:
            levels, why = ", ".join(name for name in self.unchecked), self.not_checked["L1"]
            return f"not proven: the files hold the world (L0); not checked: {levels} ({why})"
        valid = "valid" if self.precision == DOUBLE else f"valid in {self.precision} precision"
        chaos = {name: why for name, why in self.not_compared.items() if why.startswith(TOO_CHAOTIC)}
        said = [valid]
        if self.convergence is not None:
            limit = self.convergence
            said.append(f"same model by another method, of {limit.ordinal} order: {limit.difference}")
        for words, without in (("not compared", chaos), ("not checked", self.unchecked)):
            parts = ", ".join(f"{name} ({why})" for name, why in without.items())
            said += [f"{words}: {parts}"] if parts else []
        return "; ".join([*said, *self.contact_words])

    @property
    def declared(self) -> DeclaredShare:
        """The declared deviations that the contact figures depend on."""
        return declared(self.contact)

    @property
    def contact_words(self) -> list[str]:
        """The remarks on contact in a verdict: declared deviations, absent effects, and kinds of contact that were not
        measured."""
        words = self.declared.words
        return ([words] if words else []) + [f"{kind}: not measured" for kind in unmeasured(self.contact_scope)]

    @property
    def brief(self) -> str:
        """The verdict in one or two words."""
        return "valid" if self.valid else "NOT PROVEN" if self.passed else "NOT VALID"

    def timeless(self) -> EngineProof:
        """The same without the seconds that it took."""
        return dataclasses.replace(self, seconds=0.0)

    def level(self, name: str) -> list[Check]:
        """The checks of one level."""
        return [check for check in self.checks if check.level == name]


def _line(entry: Check | ProbeFigure) -> str:
    return f"        {json.dumps(to_plain(entry), ensure_ascii=False, allow_nan=False)}"


@dataclass(frozen=True, slots=True)
class Certificate:
    """One world held against several engines; ``engines`` by name; ``simspec``: the version that made it."""

    name: str
    world_sha256: str
    oracle: str
    engines: dict[str, EngineProof]
    simspec: str = field(default_factory=lambda: simspec_version())

    def __repr__(self) -> str:
        valid = ", ".join(name for name, proof in self.engines.items() if proof.valid) or "no engine"
        return f"<Certificate of {self.name!r}: {len(self.engines)} engines, valid in {valid[:100]}>"

    def _repr_html_(self) -> str:
        """For notebooks: the verdict of each engine, with what it approximates and the first checks that failed."""
        rows = []
        for name, proof in self.engines.items():
            failed = [f"{check.level} {check.name}" for check in proof.checks if not check.passed][:3]
            passed = sum(check.passed for check in proof.checks)
            accepted = ", ".join(proof.approximations) or "–"
            counted = f"{passed} of {len(proof.checks)}"
            rows.append((name, proof.version, proof.verdict, counted, ", ".join(failed) or "–", accepted))
        head = ("engine", "version", "verdict", "checks passed", "failed first", "approximations")
        return html_table(f"Certificate of {self.name}", head, rows)

    @property
    def valid(self) -> bool:
        """Whether every engine's proof is valid."""
        return bool(self.engines) and all(proof.valid for proof in self.engines.values())

    @property
    def artifacts_sha256(self) -> Mapping[str, str]:
        """The hash of each engine's artifacts."""
        return {name: proof.artifacts_sha256 for name, proof in self.engines.items()}

    @property
    def versions(self) -> Mapping[str, str]:
        """The version of each engine, and of the oracle."""
        return {"oracle": self.oracle} | {name: proof.version for name, proof in self.engines.items()}

    def joined(self, kept: Mapping[str, EngineProof]) -> Certificate:
        """This certificate with earlier proofs that still hold (:func:`simspec.proof.judge.holding_proofs`): of other engines,
        and of its own where an earlier one is equal in all but the seconds: a repository should be quiet when nothing has
        changed."""
        engines = {
            name: kept[name] if name in kept and kept[name].timeless() == proof.timeless() else proof
            for name, proof in self.engines.items()
        }
        return dataclasses.replace(self, engines=dict(kept) | engines)

    def timeless(self) -> Certificate:
        """The same without the seconds that it took."""
        engines = {name: proof.timeless() for name, proof in self.engines.items()}
        return dataclasses.replace(self, engines=engines)

    def failures(self) -> list[tuple[str, Check]]:
        """Every check that did not pass, with its engine."""
        return [(name, check) for name, proof in self.engines.items() for check in proof.checks if not check.passed]

    def to_json(self) -> str:
        """The certificate as text, one check a line, so that version control shows what changed."""
        data = {
            "schema": SCHEMA,
            "valid": self.valid,
            "simspec": self.simspec,
            "name": self.name,
            "world_sha256": self.world_sha256,
            "oracle": self.oracle,
            "engines": {},
        }
        text = json.dumps(data, indent=2, allow_nan=False)
        blocks = []
        for name, proof in sorted(self.engines.items()):
            head = {"version": proof.version, "valid": proof.valid, "artifacts_sha256": proof.artifacts_sha256}
            head |= {"precision": proof.precision} if proof.precision != DOUBLE else {}
            head |= {"seconds": proof.seconds}
            head |= {"verdict": proof.verdict, "approximations": proof.approximations, "not_checked": proof.not_checked}
            head |= {"not_compared": proof.not_compared}
            head |= {"contact_scope": proof.contact_scope} if proof.contact_scope else {}
            head |= {"convergence": to_plain(proof.convergence)} if proof.convergence is not None else {}
            lines = [
                f"      {json.dumps(key)}: {json.dumps(value, ensure_ascii=False)}," for key, value in head.items()
            ]
            # a certificate does not change by whether a figure was measured or cached
            lasting = (
                dataclasses.replace(figure, cached=False) if figure.cached else figure for figure in proof.contact
            )
            checks, figures = (",\n".join(map(_line, entries)) for entries in (proof.checks, lasting))
            rows = f'\n      "checks": [\n{checks}\n      ],\n      "contact": [\n{figures}\n      ]'
            blocks.append(f"    {json.dumps(name)}: {{\n" + "\n".join(lines) + rows + "\n    }")
        text = text.replace('"engines": {}', '"engines": {\n' + ",\n".join(blocks) + "\n  }") + "\n"
        digest = hashlib.sha256(text.encode()).hexdigest()
        return text.replace("{\n", f'{{\n  "sha256": "{digest}",\n', 1)

    @classmethod
    def from_json(cls, text: str, what: str = "the certificate") -> Certificate:
        """Read :meth:`to_json`'s text; ``what`` names it in errors.

        Its verdicts are not read: they follow from its figures. Raises SpecError for another schema, what is no certificate,
        and text that is not that of its hash (it was edited, or is damaged).
        """
        plain = parse(text, what)
        schema = plain.get("schema") if isinstance(plain, dict) else None
        if schema != SCHEMA:
            hint = "simspec verify writes it anew"
            message = f"{what} is outdated, or of a newer simspec: schema {schema!r}, this simspec reads {SCHEMA}"
            raise SpecError([Problem(message, hint=hint, code="P101")])
        data = read_as(StoredCertificate, text, what)
        search = HASH_LINE.search(text)
        bare = HASH_LINE.sub("", text, count=1)
        if search is None or search[1] != data.sha256 or hashlib.sha256(bare.encode()).hexdigest() != data.sha256:
            message = f"{what}: was edited or is damaged: its content does not match its hash"
            raise SpecError([Problem(message, hint="simspec verify writes it anew", code="P101")])
        try:
            engines = {
                name: EngineProof(
                    block.version,
                    block.artifacts_sha256,
                    tuple(from_plain(Check, check) for check in block.checks),
                    block.approximations,
                    block.not_checked,
                    block.seconds,
                    tuple(from_plain(ProbeFigure, figure) for figure in block.contact),
                    block.not_compared,
                    block.precision,
                    block.contact_scope,
                    None if block.convergence is None else from_plain(MotionLimit, block.convergence),
                )
                for name, block in data.engines.items()
            }
        except (ValueError, KeyError, TypeError) as error:
            raise SpecError([Problem(f"{what} cannot be read: {str(error)[:300]}", code="P101")]) from None
        return cls(data.name, data.world_sha256, data.oracle, engines, data.simspec)
