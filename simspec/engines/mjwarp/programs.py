"""MuJoCo Warp's computations for a model, each as a graph: the functions that it calls, recorded once and run again at once.

Recorded on a processor, too: of two hinges a step takes 0.03 ms so, to the same bits, where Python calls them in 3 to 9 ms
(measured).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import reduce
from operator import or_
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simspec.engines.kit import warp
from simspec.engines.kit.messages import doing
from simspec.errors import EngineError

# MuJoCo Warp and Warp, imported, and the device that they compute on.
#
# Warp compiles its functions when they are first called, 0.1 to 15 s each, and keeps what it compiled by the text of the
# function and the processor: in a folder of simspec's cache, so that processes share it. That grows by models, for which Warp
# writes texts of functions anew: of one there are 26 forms after all worlds of the self-test and simspec's own specs (242
# folders of 20 kB to 1.1 MB, 20 MB; measured). Warp itself removes none.

ENGINE = "mjwarp"
FOLDER = "mjwarp"
AUTO = "auto"
"""A value of the setting ``device``: Warp's first choice."""


@dataclass(frozen=True)
class WarpModules:
    """The modules that the engine works with."""

    mujoco: Any
    warp: Any
    solver: Any
    """``mujoco_warp``."""


_imported: list[WarpModules] = []


def import_modules() -> WarpModules:
    """The modules, imported once; no thread is started. Raises EngineError where one of them is not installed."""
    if not _imported:
        try:
            import mujoco
            import mujoco_warp
            import warp as nvidia_warp
        except ImportError as error:
            raise EngineError(ENGINE, f"not installed: simspec engines install mjwarp --yes ({error})") from error
        _imported.append(WarpModules(mujoco, nvidia_warp, mujoco_warp))
    return _imported[0]


def begin(log: list[str]) -> WarpModules:
    """The modules, and Warp at work. Its messages are added to ``log``, except that there is no CUDA."""
    modules = import_modules()
    warp.begin(modules.warp, FOLDER, log)
    return modules


def chosen_device(modules: WarpModules, settings: Mapping[str, Any]) -> Any:
    """The device that a setting names; ``auto``: the first of CUDA, where there is one, else the processor. Raises EngineError
    where there is no such device."""
    named = str(settings["device"])
    devices = warp.begin(modules.warp, FOLDER, [])  # at work already
    name = devices[0] if named == AUTO else named
    if name not in devices:
        raise EngineError(ENGINE, f"there is no device {name!r} here, but {', '.join(devices)}")
    return modules.warp.get_device(name)


Numbers = NDArray[np.float64]
OUT_OF_ROOM = ("NEFC", "NJMAX_NNZ", "BROADPHASE", "NARROWPHASE", "CCD")
"""Warp's names of what had no room: contacts, or rows of constraints. It leaves out what has none."""
CONTACTS = ("dist", "pos", "frame", "includemargin", "geom", "dim", "efc_address", "type")
LEAST_ROOM = 32
"""Contacts for which there is room at first, in addition to those of each solid shape: room costs memory, not time."""
OF_EACH = 8
"""Contacts of each solid shape for which there is room at first: a box on a box has as many."""
LARGEST_ROOM = 1 << 20
"""Contacts for which there is room at most: of each Warp keeps 0.5 kB, and rows of a dense matrix."""


@dataclass(frozen=True)
class Room:
    """For how many contacts and rows of constraints there is room."""

    contacts: int
    rows: int

    @classmethod
    def at_first(cls, model: Any) -> Room:
        """The initial contacts of ``model`` (``mjModel``). None where nothing can be in contact or at a limit, or has dry
        friction: then there is nothing to solve, and Warp spares it."""
        solid = int(np.count_nonzero(model.geom_contype | model.geom_conaffinity)) + int(model.npair)
        contacts = _power_of_two(LEAST_ROOM + OF_EACH * solid) if solid > 1 else 0
        return cls(contacts, contacts * _rows_of_contact(model) + _other_rows(model))

    def wider(self, model: Any) -> Room:
        """Twice the room."""
        contacts = 2 * max(self.contacts, LEAST_ROOM)
        return Room(contacts, contacts * _rows_of_contact(model) + _other_rows(model))


def _power_of_two(least: int) -> int:
    return 1 << (least - 1).bit_length()


def _rows_of_contact(model: Any) -> int:
    """Rows of one contact at most: of a pyramid two for each direction but the normal's."""
    dims: list[int] = [1, *model.geom_condim.tolist(), *model.pair_dim.tolist()]
    return max(1, 2 * (max(dims) - 1))


def _other_rows(model: Any) -> int:
    friction = np.count_nonzero(model.dof_frictionloss) + np.count_nonzero(model.tendon_frictionloss)
    limits = 2 * (np.count_nonzero(model.jnt_limited) + np.count_nonzero(model.tendon_limited))
    return int(friction + limits)


class WarpPrograms:
    """The programs of ``taken``, Warp's model of ``file``, on a data of their own."""

    def __init__(self, modules: WarpModules, device: Any, taken: Any, file: Any):
        self._warp, self._solver = modules.warp, modules.solver
        self._device, self._taken, self._file = device, taken, file
        self._kinds = self._solver.OverflowType
        self._out_of_room = reduce(or_, (int(self._kinds[name]) for name in OUT_OF_ROOM))
        self._lay_out(Room.at_first(file))

    def _lay_out(self, room: Room) -> None:
        self._room = room
        with self._warp.ScopedDevice(self._device):
            self._data = self._solver.make_data(self._file, nconmax=room.contacts, njmax=room.rows)
        self._graphs: dict[str, Any] = {}
        self._seen: dict[str, np.ndarray] = {}

    def run(self, name: str, state: Mapping[str, Numbers], count: int = 1) -> None:
        """Run a program ``count`` times from a state: the fields of data by Warp's names. Where contacts had no room there is
        more, and it is run again: Warp leaves out what has none. Raises EngineError where there are too many."""
        self._run(name, state, count)
        while self.out_of_room:
            if self._room.contacts >= LARGEST_ROOM:
                raise EngineError(ENGINE, f"has room for {self._room.contacts:,} contacts at most, and there are more")
            self._lay_out(self._room.wider(self._file))
            self._run(name, state, count)

    def _run(self, name: str, state: Mapping[str, Numbers], count: int) -> None:
        graph = self._graphs.get(name)
        if graph is None:
            graph = self._graphs[name] = self._recorded(name)
            self._seen = {}  # that call may have changed any of the data
        for field, values in state.items():
            self._put(field, values)
        if self._device.is_cpu:
            self._numbers("overflow")[0] = 0
        else:
            self._data.overflow.zero_()
        with self._warp.ScopedDevice(self._device):
            for _ in range(count):
                self._warp.capture_launch(graph)

    def _recorded(self, name: str) -> Any:
        warp = self._warp

        def work() -> None:
            for function in WORK[name]:
                getattr(self._solver, function)(self._taken, self._data)

        with warp.ScopedDevice(self._device), doing(f"compiling “{name}” for this model"):
            # once without being recorded: compilation cannot be recorded
            work()
            with warp.ScopedCapture(device=self._device) as capture:
                work()
        return capture.graph

    def _numbers(self, name: str) -> np.ndarray:
        """A field of the data: on a processor seen, and remembered, since asking costs microseconds; elsewhere copied."""
        if not self._device.is_cpu:
            copied: np.ndarray = getattr(self._data, name).numpy()
            return copied
        seen = self._seen.get(name)
        if seen is None:
            seen = self._seen[name] = getattr(self._data, name).numpy()
        return seen

    def _put(self, name: str, values: Numbers) -> None:
        if self._device.is_cpu:
            self._numbers(name)[0] = values
        else:
            getattr(self._data, name).assign(values[None].astype(np.float32))

    def take(self, name: str) -> np.ndarray:
        """A field of the data, as an array of its own."""
        return _copied(self._numbers(name)[0])

    @property
    def out_of_room(self) -> bool:
        """Whether something was left out of the last run for want of room."""
        contacts = self._data.naconmax
        there = max(int(self._numbers("nacon")[0]), int(self._numbers("ncollision")[0]))
        return there > contacts or bool(self._overflow & self._out_of_room)

    @property
    def _overflow(self) -> int:
        return int(self._numbers("overflow")[0])

    @property
    def signs(self) -> list[str]:
        """Warp's names of what else it says of the last run."""
        return [str(kind.name) for kind in self._kinds if self._overflow & int(kind) & ~self._out_of_room]

    def contacts(self) -> dict[str, np.ndarray]:
        """The contacts of the last run that are within their margin, and the force of each row of constraints."""
        actual, count = self._data.contact, int(self._numbers("nacon")[0])
        found = {name: _copied(getattr(actual, name).numpy()[:count]) for name in CONTACTS}
        there = (found["dist"] <= found["includemargin"]) & (found["type"] & 1 == 1)
        return {name: values[there] for name, values in found.items()} | {
            "force": _copied(self._data.efc.force.numpy()[0])
        }


def _copied(values: np.ndarray) -> np.ndarray:
    """A copy, of doubles where the numbers are singles: Warp's arrays on a processor are seen, not copied."""
    return np.array(values, dtype=float if values.dtype == np.float32 else values.dtype)


_PLACED = ("kinematics", "com_pos")
WORK: Mapping[str, tuple[str, ...]] = {
    "step": ("step",),
    "place": _PLACED,
    "move": (*_PLACED, "com_vel"),
    "weigh": (*_PLACED, "crb"),
    "bias": (*_PLACED, "com_vel", "tendon", "rne", "passive"),
    "energy": (*_PLACED, "com_vel", "tendon", "crb", "energy_pos", "energy_vel"),
    "touch": (*_PLACED, "collision"),
}
"""The programs, as Warp's functions of a model and a data."""
_PLACES = ("xpos", "xquat", "xipos", "site_xpos", "site_xmat", "subtree_com")
ANSWERS: Mapping[str, tuple[str, ...]] = {
    "step": ("qpos", "qvel", "qacc_warmstart"),
    "place": _PLACES,
    "move": (*_PLACES, "cvel"),
    "weigh": ("M",),
    "bias": ("qfrc_bias", "qfrc_gravcomp"),
    "energy": ("energy", "xipos"),
}
"""The fields of the data that programs compute."""


def taken_over(modules: WarpModules, device: Any, model: Any, lacked: int) -> Any:
    """Warp's model of ``model`` (``mjModel``), without the flags ``lacked``. Raises NotImplementedError and ValueError where it
    refuses one.

    Two boxes are met by Warp's own function for the two, which it takes where MuJoCo's search for convex shapes is switched
    off, and by nothing else does it go by that flag: its search loses digits with size (``SEARCHED`` in ``engine.py``).
    """
    warp, solver = modules.warp, modules.solver
    flags = int(model.opt.disableflags)
    model.opt.disableflags = (flags & ~lacked) | int(modules.mujoco.mjtDisableBit.mjDSBL_NATIVECCD)
    try:
        with warp.ScopedDevice(device):
            taken = solver.put_model(model)
    finally:
        model.opt.disableflags = flags
    option = taken.opt
    # Warp raises a smaller one to 1e-6 in silence
    option.tolerance.fill_(float(model.opt.tolerance))
    # order of contacts, of rows and of sums: a processor has one anyway, a graphics processor only so
    option.deterministic = int(solver.DeterminismType.ALL)
    option.warn_overflow = 0  # it is queried, and need not print
    if not device.is_cpu:
        option.graph_conditional = bool(warp.is_conditional_graph_supported())
    return taken
