"""Noise floors that were measured before, in the user's cache folder.

An entry belongs to one run by its bits: its key covers the recorded states of the run, its case (world, settings,
versions), its files, the perturbation, and the code that measures. A run that has the bits of an earlier run is an unchanged
repeat of it, and has the same noise.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
import json
import zlib
from functools import cache
from pathlib import Path

import numpy as np

from simspec.comparison.floor import STATES, Floor, perturbation_of
from simspec.engines.kit.registry import find_engine
from simspec.errors import SpecError
from simspec.files import parts, zeros
from simspec.outputs.collection import Entries
from simspec.proof.contact.scope import files_digest, key
from simspec.runner.run import Run
from simspec.stored import CachedNoise, read_as

VERSION = 1
ENTRIES = Entries("noise", head=b'{"simspec_noise": ', largest=16 * 2**20, bound=256 * 2**20)
"""Noise changes slowly from row to row: the 24 bodies and 501 rows of a robot's scene take 60 kB."""
LARGEST_ARRAY = 64 * 2**20
"""Bytes of the numbers of an entry, unpacked."""


@cache
def _code() -> str:
    """The hash of the code that makes noise of runs, which the key of contact figures leaves out."""
    package = Path(__file__).resolve().parents[1]
    return files_digest(
        [path for name in ("runner", "comparison") for path in sorted((package / name).glob("*.py"))], package
    )


def _states(run: Run) -> str:
    """The hash of the recorded states of a run."""
    digest = hashlib.sha256()
    for name in STATES:
        array = run.arrays[name]
        digest.update(f"{name} {array.dtype.str} {array.shape}".encode())
        for part in parts(len(array), array[:1].nbytes, array):
            digest.update(np.ascontiguousarray(array[part]).data)
    return digest.hexdigest()


def noise_key(run: Run) -> str:
    """The name of the entry of a run that recorded something."""
    facts = [run.provenance["case"], run.provenance["artifacts_sha256"], perturbation_of(run.engine), _states(run)]
    return key(find_engine(run.engine), "noise", VERSION, _code(), *facts)


def read_noise(run: Run, name: str) -> Floor | None:
    """The floor of ``run`` that was measured before; None where there is none, or its entry is damaged."""
    content = ENTRIES.read(name)
    if content is None:
        return None
    try:
        entry = read_as(CachedNoise, content, name)
        shape = (2, *run.arrays["pose"].shape[:2])
        size = 8 * int(np.prod(shape))
        if (entry.simspec_noise, entry.key) != (VERSION, name) or size > LARGEST_ARRAY:
            return None
        numbers = zlib.decompressobj().decompress(base64.b64decode(entry.numbers, validate=True), size + 1)
        if len(numbers) != size or hashlib.sha256(numbers).hexdigest() != entry.sha256:
            return None
    except (SpecError, binascii.Error, zlib.error):
        return None
    position, angle = np.frombuffer(numbers, dtype="<f8").reshape(shape)
    return Floor(run.engine, run.time, position, angle, entry.bitwise, entry.perturbation, cached=True)


def write_noise(floor: Floor, name: str) -> bool:
    """Keep a floor; False where it is too large, or the folder is not writable, which costs time only."""
    if 2 * floor.position.nbytes > LARGEST_ARRAY:
        return False
    values = zeros((2, *floor.position.shape))
    values[0], values[1] = floor.position, floor.angle
    numbers = values.astype("<f8").tobytes()
    entry = {
        "simspec_noise": VERSION,
        "key": name,
        "bitwise": floor.bitwise,
        "perturbation": floor.perturbation,
        "sha256": hashlib.sha256(numbers).hexdigest(),
        "numbers": base64.b64encode(zlib.compress(numbers, 1)).decode(),
    }
    text = json.dumps(entry)
    return len(text) <= ENTRIES.largest and ENTRIES.write(name, text)
