"""Sleeping in PyBullet: which bodies may, and how they are woken. Facts marked *measured*: pybullet 3.2.7."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

SLOW = 1e-4
"""v² + ω² (m²/s², rad²/s²) below which a body counts as at rest; PyBullet's own 0.05 stops what slides at 0.2 m/s (measured).
It falls asleep after 2 s of that, a time that PyBullet does not let one set."""


class Sleepers:
    """The bodies of one client that may fall asleep.

    What touches a sleeping body wakes it within the step. Efforts and new velocities do not: PyBullet drops them (measured).
    """

    def __init__(self, sim: Any, uids: Iterable[int]):
        self._sim, self._uids = sim, set(uids)
        bullet = sim.bullet
        self._any, self._stepped = bool(self._uids), False
        for uid in self._uids:
            self._change(uid, activationState=bullet.ACTIVATION_STATE_ENABLE_SLEEPING, sleepThreshold=SLOW)

    def _change(self, uid: int, **given: Any) -> None:
        self._sim.bullet.changeDynamics(uid, -1, physicsClientId=self._sim.client, **given)

    def __contains__(self, uid: int) -> bool:
        return uid in self._uids

    def stepped(self) -> None:
        """Time has gone by: something may sleep now."""
        self._stepped = True

    def wake(self) -> None:
        """Wake all, by a step that the caller must undo: a woken body is still left out of the next step (measured)."""
        if not (self._any and self._stepped):
            return
        bullet = self._sim.bullet
        for uid in self._uids:
            self._change(uid, activationState=bullet.ACTIVATION_STATE_WAKE_UP)
        bullet.stepSimulation(physicsClientId=self._sim.client)
        self._stepped = False

    def forbid(self, uid: int) -> None:
        """One body will sleep no more; ``wake`` must follow."""
        bullet = self._sim.bullet
        self._change(uid, activationState=bullet.ACTIVATION_STATE_DISABLE_SLEEPING)
        self._change(uid, activationState=bullet.ACTIVATION_STATE_WAKE_UP)
        self._uids.discard(uid)
