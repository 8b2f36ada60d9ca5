"""How far MuJoCo before 3.4 is from the contact law beyond what later releases are: the points of two boxes have half the depth
of their overlap. Data, measured with MuJoCo 3.3.7 at 0.5, 1, 2, 4, 8 and 16 ms, for μ of 0.05 to 1.5 and e of 0 to 0.8.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from simspec.engines.kit.deviations import Deviation
from simspec.engines.mujoco.contact import BOXES

_DEEPER = (
    "the points of two boxes have half the depth of their overlap, so that a box lies twice as deep on another one"
)
_SLOWER = f"{_DEEPER}, and takes longer to come to rest there"
_OTHERWISE = f"{_DEEPER}: what slides hops at other moments"
_BOUNCES = {"restitution": 0.01}
_PYRAMID = {"friction_cone": "pyramid-inscribed"}
_NATIVE = {"hardness": "native"}
_SPRINGS = {"hardness": "stiffness"}


def _rows(
    probe: str, why: str, table: Mapping[float, Mapping[float, float]], more: Mapping[str, Any]
) -> tuple[Deviation, ...]:
    """``table``: by timestep (s), by least friction, the largest share of the expected value."""
    return tuple(
        Deviation(probe, size, why, friction=friction, timestep=0.9 * timestep, until=BOXES, **more)
        for timestep, sizes in table.items()
        for friction, size in sizes.items()
    )


DEVIATIONS: tuple[Deviation, ...] = (
    Deviation("rest", 2.1e-4, _DEEPER, relative=False, until=BOXES),
    Deviation("stick", 2.5e-3, _SLOWER, relative=False, until=BOXES),
    *_rows(
        "push",
        _OTHERWISE,
        {0.0005: {0.0: 0.03}, 0.001: {0.0: 0.07, 0.4: 0.1}, 0.002: {0.4: 0.16}, 0.008: {0.9: 0.36}},
        {},
    ),
    *_rows("push", _OTHERWISE, {0.001: {0.4: 0.15}, 0.004: {0.4: 0.22}}, _BOUNCES),
    *_rows("push", _OTHERWISE, {0.0005: {0.3: 0.28}}, _PYRAMID),
    *_rows("push", _OTHERWISE, {0.0005: {0.0: 0.13}}, _NATIVE),
    *_rows(
        "push-oblong",
        _OTHERWISE,
        {
            0.0005: {0.0: 0.031},
            0.001: {0.0: 0.053, 0.4: 0.08},
            0.002: {0.4: 0.2},
            0.004: {0.4: 0.23},
            0.008: {0.9: 0.36},
            0.016: {0.4: 0.31},
        },
        {},
    ),
    *_rows("push-oblong", _OTHERWISE, {0.002: {0.9: 0.27}, 0.008: {0.15: 0.085}}, _NATIVE),
    *_rows("stop", _OTHERWISE, {0.002: {0.4: 0.04}, 0.004: {0.0: 0.021}}, {}),
    *_rows("stop", _OTHERWISE, {0.008: {0.4: 0.12}}, _BOUNCES),
    *_rows("stop", _OTHERWISE, {0.0005: {0.0: 0.02}, 0.008: {0.9: 0.061}}, _NATIVE),
    *_rows("stop-oblong", _OTHERWISE, {0.002: {0.4: 0.115}, 0.016: {0.4: 0.16}}, {}),
    *_rows("stop-oblong", _OTHERWISE, {0.0005: {0.4: 0.035}}, _BOUNCES),
    *(row for probe in ("stop", "stop-oblong") for row in _rows(probe, _SLOWER, {0.004: {0.0: 0.027}}, _SPRINGS)),
    Deviation("stick", 0.03, _SLOWER, relative=False, timestep=0.0036, hardness="stiffness", until=BOXES),
)
"""The largest of what exceeds the rows of later releases, and a tenth more."""
