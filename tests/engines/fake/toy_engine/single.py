"""Toy in single precision: its inputs and its state after every step are rounded to it."""

import numpy as np

from toy_engine import Toy


def rounded(value):
    return np.asarray(value, dtype=np.float32).astype(float)


class SingleToy(Toy):
    NAME, TITLE, EXTRA = "singletoy", "SingleToy", "singletoy"
    PRECISION = "single"

    def load(self, folder, sidecar):
        super().load(folder, sidecar)
        for part in self.parts:
            part.r, part.R, part.axis, part.c, part.I, part.offset = map(
                rounded, (part.r, part.R, part.axis, part.c, part.I, part.offset)
            )
            part.m = float(rounded(part.m))
        self.gravity = rounded(self.gravity)

    def set_state(self, q, v):
        super().set_state(rounded(q), rounded(v))

    def step(self, count, effort=None):
        for _ in range(count):
            super().step(1, effort)
            self.q, self.v = rounded(self.q), rounded(self.v)
