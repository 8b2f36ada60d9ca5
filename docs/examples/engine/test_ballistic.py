"""The tests of an engine in its own repository: simspec's suite of models and motion."""

from simspec.testing.model_suite import ModelSuite


class TestBallistic(ModelSuite):
    engine = "ballistic"
