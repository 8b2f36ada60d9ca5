"""Genesis: its own readers of URDF and MJCF, for ``simspec audit``. simspec does not run it yet (docs/records/genesis.md)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

from simspec.contact import Rules
from simspec.engines.genesis.foreign import FOREIGN, FOREIGN_ADDITIONS, load
from simspec.engines.genesis.modules import NAME, begun, imported
from simspec.engines.kit.capabilities import Capability
from simspec.engines.kit.contract import Engine, LicenceTerms
from simspec.engines.kit.foreign import EngineAddition, Reads
from simspec.engines.kit.settings import Setting
from simspec.support import classes
from simspec.support.declarations import Table
from simspec.world.types import ReadBack

_WHY = "simspec audits robot files with Genesis, and does not run it yet"


class Genesis(Engine):
    """Genesis's description of a robot file, which it builds its rigid solver from."""

    NAME: ClassVar[str] = NAME
    TITLE: ClassVar[str] = "Genesis"
    DIALECT: ClassVar[str] = "urdf"
    DISTRIBUTION: ClassVar[str] = "genesis-world"
    EXTRA: ClassVar[str] = ""
    SEPARATE_VERSION: ClassVar[str] = "1.4"
    ALONGSIDE: ClassVar[tuple[str, ...]] = ("torch>=2.8",)  # it imports torch, and does not require it
    INSTALLS: ClassVar[str] = "110 packages, of which 5 GB are downloaded and 8.4 GB are on the disk"
    # from the licence files in the wheels that torch 2.15 and Genesis 1.4.5 require on Linux; NCCL's and NVTX's are open source
    LICENCES: ClassVar[tuple[LicenceTerms, ...]] = (
        LicenceTerms(
            "CUDA Toolkit End User License Agreement",
            "NVIDIA's CUDA libraries and tools that torch, triton and gs-madrona bring on Linux (runtime, CCCL, cuBLAS, cuFFT, "
            "cuFile, cuSOLVER, cuSPARSE, CUPTI, NVRTC, nvJitLink, NVSHMEM, ptxas)",
            ("https://docs.nvidia.com/cuda/eula/index.html",),
        ),
        LicenceTerms(
            "NVIDIA cuDNN Software License Agreement",
            "NVIDIA's cuDNN, which torch brings on Linux",
            ("https://docs.nvidia.com/deeplearning/cudnn/sla/index.html",),
        ),
        LicenceTerms(
            "NVIDIA cuSPARSELt Software License Agreement",
            "NVIDIA's cuSPARSELt, which torch brings on Linux",
            ("https://docs.nvidia.com/cuda/cusparselt/license.html",),
        ),
    )
    COMPILING: ClassVar[float] = 180.0  # its import alone takes 22 s of processor time (measured)
    RULES: ClassVar[Rules] = Rules("max", "none")
    LAYERS: ClassVar[bool] = False
    SETTINGS: ClassVar[Mapping[str, Setting]] = {}
    FOREIGN: ClassVar[Mapping[str, Reads]] = FOREIGN
    FOREIGN_ADDITIONS: ClassVar[Mapping[str, EngineAddition]] = FOREIGN_ADDITIONS
    FOREIGN_MEMORY: ClassVar[int] = 2_300_000_000  # measured; 1 GB of it is its compiler's
    LACKS: ClassVar[Mapping[Capability, str]] = dict.fromkeys(
        sorted(set(Capability) - {Capability.FOREIGN_FILES}), _WHY
    )
    SUPPORT: ClassVar[Table] = classes.nothing(_WHY)

    @classmethod
    def prepare(cls) -> None:
        imported()

    @classmethod
    def prepare_foreign(cls) -> None:
        begun()

    def load_foreign(self, file: Path, language: str, packages: Mapping[str, str], log: list[str]) -> ReadBack:
        return load(file, language, log)
