"""Speed from provenance that says what it is."""

from __future__ import annotations

import dataclasses

import pytest

from simspec.analysis.speed import process_figures, speed, speed_ratio
from simspec.errors import SpecError
from tests.runner.synthetic import free_body, run, world

WORLD = world(free_body("ball"))
"""100 steps of 10 ms: 1 s."""
HERE = {"platform": "Linux", "machine": "x86_64"}


def timed(step: float, engine: str = "first", **more):
    facts = {
        "seconds": {"step": step, "cpu": 0.5 * step, "process": 2.0},
        "usage": {"cpu_user": 1.0, "cpu_system": 0.5, "peak_memory": 1e8},
        **HERE,
    }
    return run(WORLD, engine=engine, **(facts | more))


def test_the_figures_of_a_process():
    figures = process_figures(timed(0.25))
    assert figures.real_time_factor == 4.0
    assert figures.cpu_factor == 8.0
    assert figures.end_to_end_factor == 0.5
    assert figures.step_load == 0.5
    assert figures.process_load == 0.75
    assert figures.peak_memory == 1e8


def test_values_not_measured_are_none():
    figures = process_figures(timed(0.25, usage={"cpu_user": 1.0}, seconds={"step": 0.5}))
    assert (figures.process_load, figures.peak_memory, figures.cpu_factor, figures.step_load) == (None,) * 4


def test_the_spread_is_over_processes():
    given = speed([timed(0.5), timed(0.25), timed(0.2), dataclasses.replace(timed(0.1), failed="it fell over")])
    assert (given.processes, given.failed) == (3, 1)
    assert given["real_time_factor"].values == (2.0, 4.0, 5.0)
    assert given["real_time_factor"].median == 4.0
    assert given["peak_memory"].most == 1e8


def test_two_machines_have_no_common_figure():
    with pytest.raises(SpecError, match="several machines"):
        speed([timed(0.5), timed(0.5, platform="another")])
    here, there = speed([timed(0.5)]), speed([timed(0.5, platform="another")])
    with pytest.raises(SpecError, match="several machines"):
        speed_ratio(here, there)


def test_the_hardware_distinguishes_machines_where_it_is_known():
    def on(cpu, platform="Linux"):
        machine = {
            "cpu": cpu,
            "architecture": "x86_64",
            "cores": 2,
            "threads": 4,
            "governor": "unknown",
            "kernel": platform,
        }
        return timed(0.5, platform=platform, timed={"core": 1, "machine": machine})

    assert (
        speed([on("a"), on("a", "Linux 2")]).machine
        == "cpu a, architecture x86_64, cores 2, threads 4, governor unknown"
    )
    for others in (on("b"), timed(0.5)):
        with pytest.raises(SpecError, match="several machines"):
            speed([on("a"), others])


def test_engines_and_timesteps_are_not_mixed():
    with pytest.raises(SpecError, match="several engines"):
        speed([timed(0.5), timed(0.5, engine="second")])
    with pytest.raises(SpecError, match="several engines"):
        speed([timed(0.5), timed(0.5, engine_version="2.0")])
    slower = dataclasses.replace(WORLD, physics=dataclasses.replace(WORLD.physics, timestep=0.02))
    with pytest.raises(SpecError, match="several timesteps"):
        speed([timed(0.5), dataclasses.replace(timed(0.5), world=slower)])


def test_a_figure_of_some_processes_only_is_refused():
    with pytest.raises(SpecError, match=r"process_load was not measured in 1 of 2"):
        speed([timed(0.5), timed(0.5, usage={})])
    with pytest.raises(SpecError, match="no runs"):
        speed([])


def test_the_ratio_of_two_engines():
    fast = speed([timed(0.1), timed(0.1)])
    slow = speed([timed(0.4, engine="second"), timed(0.4, engine="second")])
    interval = speed_ratio(fast, slow)
    assert interval is not None
    assert interval.value == pytest.approx(4.0)
    assert speed_ratio(fast, speed([timed(0.4)])) is None
