"""A stage of USD as JSON: a program of its own, which simspec runs in a process of bounded time and memory.

Its arguments are seconds of processor time and bytes of addresses. It receives ``{"path", "roots", "forgive"}`` as JSON on
standard input and answers on standard output: ``{"error"}``, or the composed stage as a list of prims with what is authored on
each. Layers are opened one by one before they are composed, so that no file is read that is not in a folder of ``roots`` (none:
any). Nothing of physics is judged here.
"""

from __future__ import annotations

import base64
import contextlib
import hashlib
import json
import math
import os
import re
import resource
import sys
from typing import Any

LARGEST_LAYER = 256 * 2**20
"""Bytes of one file."""
LARGEST_DATA = 900 * 2**20
"""Bytes of data of this process; the libraries that it maps, 0.6 GB of addresses, are not among them."""
MOST_LAYERS = 1000
MOST_PRIMS = 30_000
"""Prims of a stage, those of instances counted; as many take 7 s of processor time."""
MOST_BODIES = 8_000
"""Bodies of a stage, as of the files of all languages."""
DEEPEST = 200
"""Prims within each other."""
MOST_NUMBERS = 6_000_000
"""Numbers of all arrays that are reported, together."""
SHORT = 64
"""Items of an array that is reported item by item; longer ones of other prims than meshes by their length."""
LONGEST_PATH = 1000
MESH_ARRAYS = ("points", "faceVertexCounts", "faceVertexIndices", "holeIndices", "simspec:points")
LONGEST_TEXT = 400
PACKAGE = ".usdz"
UNPACKED = "package"
"""The folder, in the process's own, that a package is unpacked into."""
MOST_ENTRIES = 10_000
CLIPS = ("clips", "clipSets", "clipAssetPaths", "clipManifestAssetPath", "clipTemplateAssetPath")
"""Metadata of prims that name files of values."""
_PLACE = re.compile(r":(\d+):(\d+): ([^\n]*)")


class StageRefusedError(Exception):
    """The stage is not read; the message says why. ``missing``: of a file that is not there; ``at``: line and column."""

    def __init__(self, message: str, found: str = "", missing: bool = False, at: tuple[int, int] = (1, 1)):
        self.found, self.missing, self.at = found, missing, at
        super().__init__(message)


def prepare() -> None:
    """Limit this process and import what it needs: later it may load no code (``imports/child.py``)."""
    seconds, memory = map(int, sys.argv[1:3])
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 1))
    resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    resource.setrlimit(resource.RLIMIT_DATA, (LARGEST_DATA, LARGEST_DATA))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    os.environ["PXR_WORK_THREAD_LIMIT"] = "1"
    import zipfile  # noqa: F401

    import numpy  # noqa: F401

    with contextlib.suppress(ImportError):  # the answer says so
        from pxr import Sdf, Tf, Usd, UsdGeom, UsdPhysics  # noqa: F401


def main() -> None:
    """Answer one request."""
    request = json.loads(sys.stdin.buffer.read())
    try:
        answer = _answer(request)
    except StageRefusedError as refused:
        answer = {"error": str(refused), "found": refused.found, "missing": refused.missing, "at": refused.at}
    except MemoryError:
        answer = {"error": "it takes more memory than is allowed", "found": "", "missing": False}
    except UnicodeDecodeError:
        answer = {"error": "it has bytes that are not UTF-8", "found": "", "missing": False}
    except RecursionError:
        answer = {"error": "it is nested too deeply", "found": "", "missing": False}
    sys.stdout.buffer.write(json.dumps(answer, allow_nan=False).encode())


def _answer(requested: dict[str, Any]) -> dict[str, Any]:
    try:
        from pxr import Tf, Usd
    except ImportError:
        return {"error": "USD is read by usd-core, which is not installed", "found": "", "missing": True}
    path, roots = requested["path"], [os.path.realpath(root) for root in requested["roots"]]
    packed = path.lower().endswith(PACKAGE)
    if packed:
        path = unpacked(requested["path"])
        roots = [os.path.realpath(UNPACKED)]
    layers = _Layers(roots, bool(requested["forgive"]))
    layers.walk(path)
    with Tf.DiagnosticTrap():  # the stage itself reports errors
        try:
            stage = Usd.Stage.Open(layers.opened[os.path.realpath(path)], Usd.Stage.LoadAll)
        except Tf.ErrorException as error:
            raise _damaged(error, path) from None
    used = {os.path.realpath(layer.realPath) for layer in stage.GetUsedLayers() if layer.realPath}
    if beyond := sorted(used - layers.read.keys()):
        raise StageRefusedError("this stage reads a file that it does not name", beyond[0])
    if not requested["forgive"]:
        for wrong in stage.GetCompositionErrors():
            raise StageRefusedError("this stage does not compose", " ".join(str(wrong).split())[:LONGEST_TEXT])
    answer = _StageReader(stage).answer()
    answer["read"] = {} if packed else layers.read
    answer["missing"] = layers.missing
    answer["usd"] = ".".join(map(str, Usd.GetVersion()))
    return answer


def _damaged(error: Exception, place: str) -> StageRefusedError:
    message = "this is no file of USD, or it is damaged"
    if "bad_alloc" in str(error):
        return StageRefusedError("it takes more memory than is allowed", os.path.basename(place))
    if match := _PLACE.search(str(error)):
        return StageRefusedError(message, match[3].strip()[:LONGEST_TEXT], at=(int(match[1]), int(match[2])))
    words = str(error).rpartition(" : ")[2].strip().strip("'").strip()
    return StageRefusedError(message, words.replace(place, os.path.basename(place))[:LONGEST_TEXT])


def unpacked(path: str) -> str:
    """Unpack a package, which may name nothing outside of it, and return the file that it begins with."""
    import zipfile

    name = os.path.basename(path)
    size = os.path.getsize(path)
    if size > LARGEST_LAYER:
        raise StageRefusedError(f"a file of more than {LARGEST_LAYER:,} bytes", name)
    try:
        with zipfile.ZipFile(path) as package:
            entries = [entry for entry in package.infolist() if not entry.is_dir()]
            if len(entries) > MOST_ENTRIES:
                raise StageRefusedError(f"a package of more than {MOST_ENTRIES:,} files", name)
            # files of a package are not compressed: more bytes than it has are files that share some
            if sum(entry.file_size for entry in entries) > size:
                raise StageRefusedError("a package whose files are larger than itself", name)
            if len({entry.filename for entry in entries}) < len(entries):
                raise StageRefusedError("this is no package of USD, or it is damaged", "two files of one name")
            for entry in entries:
                _unpack(package, entry)
    except (zipfile.BadZipFile, ValueError, NotImplementedError, RuntimeError, EOFError, OSError):
        raise StageRefusedError("this is no package of USD, or it is damaged", name) from None
    layers = [entry.filename for entry in entries if entry.filename.lower().endswith((".usd", ".usda", ".usdc"))]
    if not entries or entries[0].filename not in layers:
        found = entries[0].filename[:LONGEST_TEXT] if entries else name
        raise StageRefusedError("a package begins with a file of USD", found)
    return os.path.join(UNPACKED, layers[0])


def _unpack(package: Any, entry: Any) -> None:
    parts = entry.filename.split("/")
    leads_out = any(part in ("", ".", "..") or len(part) > 200 for part in parts) or len(parts) > DEEPEST
    if leads_out or "\\" in entry.filename or "\0" in entry.filename or ":" in entry.filename:
        raise StageRefusedError("a package with a path that leads out of it", entry.filename[:LONGEST_TEXT])
    if entry.compress_type or entry.flag_bits & 1 or entry.compress_size != entry.file_size:
        raise StageRefusedError(
            "files of a package are neither compressed nor encrypted", entry.filename[:LONGEST_TEXT]
        )
    package.extract(entry, UNPACKED)


class _Layers:
    """The files of a stage, each opened before anything is composed."""

    def __init__(self, roots: list[str], forgive: bool):
        self.roots, self.forgive = roots, forgive
        self.read: dict[str, str] = {}
        self.opened: dict[str, Any] = {}
        self.missing: list[str] = []

    def walk(self, path: str) -> None:
        """Open a file and all that it names."""
        waiting = [os.path.realpath(path)]
        while waiting:
            place = waiting.pop()
            if place in self.read:
                continue
            if len(self.read) >= MOST_LAYERS:
                raise StageRefusedError(f"more than {MOST_LAYERS} files")
            layer = self._open(place)
            _refuse_clips(layer)
            for named in layer.GetCompositionAssetDependencies():
                target = self._target(str(named), place)
                if target is not None:
                    waiting.append(target)

    def _open(self, place: str) -> Any:
        from pxr import Sdf, Tf

        if os.path.getsize(place) > LARGEST_LAYER:
            raise StageRefusedError(f"a file of more than {LARGEST_LAYER:,} bytes", os.path.basename(place))
        with open(place, "rb") as stream:
            self.read[place] = hashlib.file_digest(stream, "sha256").hexdigest()
        if place.lower().endswith(PACKAGE):
            raise StageRefusedError("packages that other files name are not supported", os.path.basename(place))
        try:
            layer = Sdf.Layer.FindOrOpen(place)
        except Tf.ErrorException as error:
            raise _damaged(error, place) from None
        if layer is None:
            raise StageRefusedError("this is no file of USD, or it is damaged", os.path.basename(place))
        self.opened[place] = layer
        return layer

    def _target(self, text: str, alongside: str) -> str | None:
        """The file that an asset path means; None for one that is missing and may be."""
        if not text:
            return None
        if (
            len(text) > LONGEST_PATH
            or text.startswith("`")
            or any(m in text for m in ("[", "://", ":SDF_FORMAT_ARGS:"))
        ):
            raise StageRefusedError("simspec does not read this kind of path", text[:LONGEST_TEXT])
        target = os.path.realpath(os.path.join(os.path.dirname(alongside), text))
        if self.roots and not any(target == root or target.startswith(root + os.sep) for root in self.roots):
            raise StageRefusedError("leaves the project folder", text)
        if not os.path.isfile(target):
            if not self.forgive:
                raise StageRefusedError("no such file", text, missing=True)
            self.missing.append(text)
            return None
        return target


def _refuse_clips(layer: Any) -> None:
    """Raise StageRefusedError for value clips: files whose names are no dependencies of composition, and which it opens."""
    waiting = list(layer.rootPrims)
    while waiting:
        spec = waiting.pop()
        if any(spec.HasInfo(word) for word in CLIPS):
            raise StageRefusedError("value clips are not supported", str(spec.path)[:LONGEST_TEXT])
        waiting.extend(spec.nameChildren)
        for variants in spec.variantSets.values():
            waiting.extend(variant.primSpec for variant in variants.variants.values())


class _StageReader:
    """A composed stage as plain values."""

    def __init__(self, stage: Any):
        self.stage = stage
        self.numbers = 0

    def answer(self) -> dict[str, Any]:
        from pxr import Usd, UsdGeom, UsdPhysics

        stage = self.stage
        prims: list[dict[str, Any]] = []
        cache, bodies = UsdGeom.XformCache(), 0
        walk = Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies(Usd.PrimAllPrimsPredicate))
        for prim in walk:
            if prim.IsPseudoRoot():
                continue
            if len(prims) >= MOST_PRIMS:
                raise StageRefusedError(f"more than {MOST_PRIMS:,} prims")
            if prim.GetPath().pathElementCount > DEEPEST:
                raise StageRefusedError(f"more than {DEEPEST} prims within each other")
            prims.append(self._prim(prim, cache))
            bodies += "PhysicsRigidBodyAPI" in prims[-1]["schemas"]
            if bodies > MOST_BODIES:
                raise StageRefusedError(f"more than {MOST_BODIES:,} bodies")
        default = stage.GetDefaultPrim()
        return {
            "metres": self._value(float(UsdGeom.GetStageMetersPerUnit(stage))),
            "kilograms": self._value(float(UsdPhysics.GetStageKilogramsPerUnit(stage))),
            "authored": {
                "metersPerUnit": UsdGeom.StageHasAuthoredMetersPerUnit(stage),
                "kilogramsPerUnit": UsdPhysics.StageHasAuthoredKilogramsPerUnit(stage),
            },
            "up": str(UsdGeom.GetStageUpAxis(stage)),
            "default": str(default.GetPath()) if default else "",
            "prims": prims,
        }

    def _prim(self, prim: Any, cache: Any) -> dict[str, Any]:
        from pxr import Tf, UsdGeom

        record: dict[str, Any] = {
            "path": str(prim.GetPath()),
            "type": str(prim.GetTypeName()),
            "schemas": self._schemas(prim),
            "used": bool(prim.IsActive() and prim.IsDefined() and prim.IsLoaded() and not prim.IsAbstract()),
        }
        if prim.IsInstance():
            record["instance"] = True
        if prim.HasVariantSets():
            sets = prim.GetVariantSets()
            record["variants"] = {
                name: [sets.GetVariantSelection(name), list(sets.GetVariantSet(name).GetVariantNames())]
                for name in sets.GetNames()
            }
        attributes: dict[str, Any] = {}
        relationships: dict[str, list[str]] = {}
        for property_ in prim.GetAuthoredProperties():
            name = str(property_.GetName())
            if hasattr(property_, "GetTargets"):
                relationships[name] = [str(target) for target in property_.GetTargets()][:10_000]
            else:
                attributes[name] = self._attribute(prim, property_, name)
        record["attributes"], record["relationships"] = attributes, relationships
        if record["used"] and (xform := UsdGeom.Xformable(prim)):
            try:
                record["world"] = self._flat(cache.GetLocalToWorldTransform(prim))
                record["reset"] = bool(xform.GetResetXformStack())
                record["ops"] = [self._op(op) for op in xform.GetOrderedXformOps()]
            except (Tf.ErrorException, RuntimeError):
                message = "the transformation of a prim cannot be read"
                raise StageRefusedError(message, record["path"][:LONGEST_TEXT]) from None
        if record["used"] and (image := UsdGeom.Imageable(prim)):
            record["purpose"] = str(image.ComputePurpose())
            record["visible"] = str(image.ComputeVisibility()) != "invisible"
        return record

    def _schemas(self, prim: Any) -> list[str]:
        """The schemas that are applied, also those that the reader does not know."""
        names = [str(name) for name in prim.GetAppliedSchemas()]
        said = prim.GetMetadata("apiSchemas")
        return list(dict.fromkeys([*names, *(str(name) for name in (said.GetAppliedItems() if said else ()))]))

    def _op(self, op: Any) -> list[Any]:
        return [
            str(op.GetOpName()),
            str(op.GetOpType()).rpartition(".Type")[2],
            bool(op.IsInverseOp()),
            self._value(op.Get()),
        ]

    def _attribute(self, prim: Any, attribute: Any, name: str) -> dict[str, Any]:
        record: dict[str, Any] = {"type": str(attribute.GetTypeName())}
        if attribute.HasAuthoredConnections():
            record["connected"] = [str(path) for path in attribute.GetConnections()][:10]
        if attribute.GetNumTimeSamples():
            record["samples"] = attribute.GetNumTimeSamples()
        value = attribute.Get()
        if value is None:
            return record
        if attribute.GetTypeName().isArray:
            import numpy as np

            record["length"] = len(value)
            if prim.GetTypeName() == "Mesh" and name in MESH_ARRAYS:
                array = np.asarray(value)
                self.numbers += array.size
                if self.numbers > MOST_NUMBERS:
                    raise StageRefusedError(f"more than {MOST_NUMBERS:,} numbers of meshes")
                kind = "<f8" if array.dtype.kind == "f" else "<i8"
                record["array"] = [kind, list(array.shape), base64.b64encode(array.astype(kind).tobytes()).decode()]
            elif len(value) <= SHORT:
                record["value"] = [self._value(item) for item in value]
        else:
            record["value"] = self._value(value)
        return record

    def _value(self, value: Any) -> Any:
        """A value of JSON; numbers that are not finite as ``"nan"``, ``"inf"`` and ``"-inf"``, quaternions w x y z."""
        if value is None or isinstance(value, (bool, int)):
            return value
        if isinstance(value, float):
            return value if math.isfinite(value) else str(value)
        if isinstance(value, str):
            return value[:LONGEST_TEXT]
        if hasattr(value, "GetReal"):
            return [self._value(float(value.GetReal())), *(self._value(float(item)) for item in value.GetImaginary())]
        if hasattr(value, "GetTranspose"):
            return self._flat(value)
        if hasattr(value, "path") and hasattr(value, "resolvedPath"):
            return str(value.path)[:LONGEST_TEXT]
        try:
            return [self._value(float(item)) for item in value]
        except TypeError:
            return str(value)[:LONGEST_TEXT]

    def _flat(self, matrix: Any) -> list[Any]:
        return [self._value(float(item)) for row in matrix for item in row]
