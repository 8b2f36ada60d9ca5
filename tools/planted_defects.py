"""What tools/planted.py plants: the true laws, and the defects that are compiled in their place."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from simspec.proof.contact.probe import ProbeLaw
from simspec.world.reach import MaterialReach
from simspec.world.types import Hardness, PairContact

TIMESTEP = 1e-3
LEANING, JAMMING, IMPACTS = ("rod", "clamp", "pile"), ("jam", "jam-light"), ("strike", "row", "edge")
_REACH = MaterialReach(
    leans=True, gathers=True, corners=True, carries=True, ratio=10.0, layers=3, crosses=True, jams=True, squeezes=True
)
_KINDS = ("box", "capsule", "cylinder")
RIGID = ProbeLaw(PairContact("base", "body", 0.5, 0.0), "elliptic", TIMESTEP, reach=_REACH)
LAWS: Mapping[str, ProbeLaw] = {
    "rigid": RIGID,
    "bouncing": dataclasses.replace(RIGID, pair=PairContact("base", "body", 0.5, 0.5)),
    "slippery": dataclasses.replace(RIGID, pair=PairContact("base", "body", 0.1, 0.0)),
    "rough": dataclasses.replace(RIGID, pair=PairContact("base", "body", 1.0, 0.0)),
    "heavy": dataclasses.replace(RIGID, reach=dataclasses.replace(_REACH, ratio=1000.0)),
    "compliant": dataclasses.replace(
        RIGID,
        pair=PairContact("base", "body", 0.5, 0.0, hardness=Hardness("stiffness", stiffness=1e4, damping=200.0)),
        reach=dataclasses.replace(_REACH, kinds=_KINDS),
    ),
}
"""The true laws, but for the cone."""
SLIDING = (*LEANING, *JAMMING, "carrier", "slide-spin")
"""Probes in which friction alone acts."""
SLICK = "slick"
"""Material of a body without friction."""


@dataclass(frozen=True)
class Defect:
    """One change of what is compiled.

    law       name of the true law (:data:`LAWS`)
    pair      numbers of the pair in place of its own
    cone      cone in place of the law's
    timestep  of the files, in those of the law
    settings  of the engine in place of its own, by (engine, value of the first setting judged by, "" where there is none)
    heavier   by probe, a pattern of the names of bodies whose mass is multiplied by ``MASS``; their tensors stay
    slick     by probe, a pattern of the names of bodies that lose their friction
    no_contact moving bodies pass through each other
    probes    in whose worlds it is planted, where these apply; empty: in all
    """

    name: str
    law: str = "rigid"
    pair: Mapping[str, Any] = field(default_factory=dict)
    cone: str = ""
    timestep: float = 1.0
    settings: Mapping[tuple[str, str], Mapping[str, Any]] = field(default_factory=dict)
    heavier: Mapping[str, str] = field(default_factory=dict)
    slick: Mapping[str, str] = field(default_factory=dict)
    no_contact: bool = False
    probes: tuple[str, ...] = ()


MASS = 1.05
ROLES = {
    "rod": r"rod_\d+",
    "clamp": r"clamp_\d+",
    "jam": r"jam_\d+",
    "pile": r"pile_\d+",
    "strike": r"striker_\d+",
    "row": r"first_\d+",
    "edge": r"box_\d+",
    "stack": r"two_1|three_2",
    "carrier": r"load_\d+",
    "slide-spin": r"eccentric_ball|tripod",
}
"""By probe the body that bears on others, or the only one."""
CARRIED = {name: ROLES[name] for name in ("pile", "strike", "stack", "carrier")} | {
    "stack-slides": r"(sliding|standing)_cube"
}
SOLVERS: Mapping[tuple[str, str], Mapping[str, Any]] = {
    ("mujoco", "coulomb"): {"friction": "native"},
    ("dart", "nsgs"): {"contact_solver": "dantzig"},
    ("drake", "tamsi"): {"contact_approximation": "sap"},
    ("gazebo", "dantzig"): {"contact_solver": "pgs"},
}
"""ODE's quick-step is as good as its default at a ratio of masses of 10 and this friction: see ``QUICK``."""
QUICK: Mapping[tuple[str, str], Mapping[str, Any]] = {("ode", "step"): {"solver": "quick-step"}}
SWEEPS: Mapping[tuple[str, str], Mapping[str, Any]] = {
    ("pybullet", ""): {"iterations": 5},
    ("rapier", ""): {"iterations": 2},
    ("physx", ""): {"iterations": 2},
    ("dart", "nsgs"): {"iterations": 2},
}
"""Far fewer than engines have by default (50 to 300)."""
UNCHANGED = [
    Defect("unchanged"),
    Defect("unchanged, bouncing", "bouncing", probes=(*IMPACTS, "stack")),
    Defect("unchanged, slippery", "slippery", probes=SLIDING),
    Defect("unchanged, rough", "rough", probes=SLIDING),
    Defect("unchanged, heavy", "heavy", probes=("stack",)),
    Defect("unchanged, compliant", "compliant"),
]
DEFECTS = [
    Defect("friction × 0.9", pair={"friction": 0.45}),
    Defect("friction × 1.1", pair={"friction": 0.55}),
    Defect("friction doubled", pair={"friction": 1.0}),
    Defect("friction 0.09 in place of 0.1", "slippery", {"friction": 0.09}, probes=SLIDING),
    Defect("friction 0.11 in place of 0.1", "slippery", {"friction": 0.11}, probes=SLIDING),
    Defect("friction 0.9 in place of 1", "rough", {"friction": 0.9}, probes=SLIDING),
    Defect("friction 1.1 in place of 1", "rough", {"friction": 1.1}, probes=SLIDING),
    Defect("no friction", pair={"friction": 0.0}),
    Defect("restitution 0.5 in place of 0", pair={"restitution": 0.5}, probes=IMPACTS),
    Defect("restitution 0 in place of 0.5", "bouncing", {"restitution": 0.0}, probes=IMPACTS),
    Defect("restitution 0.6 in place of 0.5", "bouncing", {"restitution": 0.6}, probes=IMPACTS),
    *(Defect(f"cone {cone}", cone=cone) for cone in ("elliptic", "pyramid-circumscribed", "pyramid-inscribed")),
    Defect("timestep doubled", timestep=2.0),
    Defect(
        "soft in place of rigid", pair={"hardness": Hardness("time-constant", time_constant=0.02, damping_ratio=1.0)}
    ),
    Defect("stiffness × 2", "compliant", {"hardness": Hardness("stiffness", stiffness=2e4, damping=200.0)}),
    Defect("stiffness × 0.5", "compliant", {"hardness": Hardness("stiffness", stiffness=5e3, damping=200.0)}),
    Defect("mass × 1.05", heavier=ROLES, probes=tuple(ROLES)),
    Defect(
        "moving bodies pass through",
        no_contact=True,
        probes=("pile", "strike", "row", "stack", "stack-slides", "cross", "carrier"),
    ),
    Defect("carried body without friction", slick=CARRIED, probes=tuple(CARRIED)),
    Defect("carrier without friction", slick={"carrier": r"slab_\d+"}, probes=("carrier",)),
    Defect("another solver", settings=SOLVERS),
    Defect("another solver at 1 : 1000", "heavy", settings=QUICK, probes=("stack",)),
    Defect("few sweeps", settings=SWEEPS),
]
