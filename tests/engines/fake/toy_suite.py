"""All that the repository of an engine needs to be tested by simspec."""

import os

from simspec.testing import EngineSuite
from simspec.testing.model_suite import ModelSuite


class TestToy(EngineSuite):
    engine = "toy"
    python = os.environ.get("TOY_PYTHON")
    defects = ("mass", "joint type", "axis", "gravity")  # a few: Toy is slow


class TestSingleToy(ModelSuite):
    engine = "singletoy"
    python = os.environ.get("TOY_PYTHON")
