"""Tests that take too long for every commit: skipped, and listed as such, where ``make slow`` does not ask for them.

Single cases of a test carry the marks ``NIGHTLY``. The lists below are of tests that take seconds to minutes, measured by
``pytest --durations``: each commit runs a part of them that fails for most of the same faults.
"""

from __future__ import annotations

import functools
import os
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest

VARIABLE = "SIMSPEC_SLOW"
"""Where this variable is ``all``, they run."""
EVERYTHING = os.environ.get(VARIABLE) == "all"
WHY = "run by make slow"
NIGHTLY = (pytest.mark.slow, pytest.mark.skipif(not EVERYTHING, reason=WHY))
"""Marks of such a test."""
ROOT = Path(__file__).resolve().parent

MUJOCO, ODE = frozenset({"mujoco"}), frozenset({"ode"})
BOTH = MUJOCO | ODE
"""One engine that is always installed, and the quickest."""
ENGINES = {
    "attribution/test_planted.py::test_the_culprit_is_named_first_although_the_engines_differ_too": BOTH,
    "engines/kit/test_bad_answers.py::test_the_proof_survives_any_read_back": BOTH,
    "engines/kit/test_warm.py::test_a_forked_process_gives_the_bits_of_a_new_process_and_keeps_nothing": BOTH,
    "engines/test_engine_suite.py::test_a_native_controller_settles_at_its_target_without_gravity": BOTH,
    "engines/test_engine_suite.py::test_a_stack_stands_as_it_does_awake": BOTH,
    "engines/test_engine_suite.py::test_a_table_of_six_materials_is_stored_and_measured": ODE,
    "engines/test_engine_suite.py::test_efforts_are_constant_between_controller_updates": BOTH,
    "engines/test_engine_suite.py::test_driven_bodies_are_unaffected_by_sleeping": BOTH,
    "engines/test_engine_suite.py::test_windows_from_the_rows_of_a_run_end_in_the_next_rows": BOTH,
    "engines/test_native.py::test_the_same_run_twice_gives_the_same_bits": BOTH,
    "proof/test_contact_coupled.py::test_engines_keep_to_the_coupled_law": BOTH,
    "proof/test_contact_friction.py::test_an_oblong_slider_shows_whether_friction_is_against_the_slip": BOTH,
    "proof/test_contact_friction.py::test_engines_keep_the_law_and_another_is_found": BOTH,
    "proof/test_contact_run.py::test_planted_defects_are_measured": BOTH,
    "proof/test_contact_scenes.py::test_a_scene_comes_out_as_its_oracle_says": BOTH,
    "proof/test_contact_scenes.py::test_a_tower_of_boxes_stands": BOTH,
    "proof/test_contact_scenes.py::test_a_tower_of_cylinders_stands": BOTH,
    "proof/test_filter_defects.py::test_every_defect_of_the_filter_is_caught": BOTH,
    "proof/test_verify.py::test_every_planted_defect_is_caught": BOTH,
    "test_stacking.py::test_slippery_fingers_fail_and_the_report_says_how": MUJOCO,
    "test_stacking.py::test_the_same_run_twice_gives_the_same_bits": MUJOCO,
    "test_stacking.py::test_a_lifted_and_shaken_cylinder_does_not_slip": MUJOCO,
}
"""Of these each commit runs the cases of some engines, and those of no engine."""
CASES = {
    "commands/test_once.py::test_a_command_compiles_once_for_each_engine": 3,
    "engines/dart/test_engine.py::test_contact_free_motion": 4,
    "engines/pybullet/test_engine.py::test_contact_free_motion": 4,
    "engines/test_engine_suite.py::test_shapes_of_a_body_have_separate_materials": 2,
    "engines/test_motion_scenarios.py::test_every_engine_keeps_the_closed_form": 2,
    "language/test_formatting.py::test_any_layout_leads_to_the_same": 5,
    "language/test_formatting.py::test_data_are_laid_out_as_files_are": 5,
    "proof/test_contact_run.py::test_every_pair_is_measured_by_every_probe_that_applies": 2,
    "proof/test_touch.py::test_pairs_planned_as_separate_are_separate_in_random_states": 3,
    "report/test_contact.py::test_the_plot_is_the_same_bytes_every_time": 3,
    "test_bad_input.py::test_a_bad_spec_is_refused_in_bounded_work": 3,
    "test_endings.py::test_a_signal_at_work_leaves_no_process_and_no_folder": 2,
    "test_isolated.py::test_no_command_imports_from_the_working_folder": 3,
    "test_endings.py::test_kills_at_random_moments_leave_nothing_that_the_next_call_does_not_remove": 3,
}
"""Of these each commit runs one case in so many, the first among them."""
DIAGONALS = {
    "engines/kit/test_bad_answers.py::test_a_bad_answer_is_that_engine_s_failure": ("engine", "kind"),
    "outputs/test_commands.py::test_a_target_that_is_not_simspecs_is_refused": ("command", "kind"),
    "outputs/test_commands.py::test_foreign_files_at_the_target_are_not_overwritten": ("command", "kind"),
    "test_bad_input.py::test_files_that_are_not_specs_are_refused_without_waiting": ("command", "target"),
    "test_numerals.py::test_no_file_says_a_number_so": ("name", "text"),
}
"""Of these products of two parameters each commit runs as few cases as have every value of either."""
WHOLE = (
    "attribution/test_planted.py::test_a_non_default_setting_is_named_and_the_remainder_is_examined",
    "attribution/test_planted.py::test_an_engine_begins_windows_with_the_contact_points_that_it_keeps",
    "commands/test_sweep.py::test_killed_at_random_moments_it_loses_and_repeats_nothing",
    "comparison/test_long.py::test_no_array_of_all_rows_is_ever_in_memory",
    "engines/dart/test_copies.py::test_seven_cylinders_stand_under_the_elliptic_cone",
    "experiments/test_dask.py::test_an_engine_without_a_worker_and_a_lost_scheduler_are_errors",
    "proof/test_chaos.py::test_growing_errors_are_chaos_and_a_narrow_range_is_not",
    "proof/test_contact_scenes.py::test_a_tower_of_cylinders_needs_a_sound_detector",
    "test_ci_example.py::test_every_step_passes_then_keeps_to_the_baseline_then_sees_a_change",
)
"""Of these each commit runs none."""


def nightly(test):
    """Such a test. Another one, which runs at every commit, must fail for the same faults."""
    for mark in NIGHTLY:
        test = mark(test)
    return test


def name_of(item: pytest.Item) -> str:
    """The file of a test, relative to ``tests``, and its function."""
    function = getattr(item, "originalname", None) or item.name
    return f"{_file(item.path)}::{function}"


@functools.cache
def _file(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def engines_of(item: pytest.Item, known: Iterable[str]) -> set[str]:
    """The engines that a case names: as a parameter, in its identifier, or by the class of its suite."""
    callspec = getattr(item, "callspec", None)
    words = set() if callspec is None else {str(value) for value in callspec.params.values()}
    words |= set() if callspec is None else set(callspec.id.split("-"))
    suite = getattr(getattr(item, "cls", None), "engine", None)
    return (words | {suite}) & set(known)


def off_diagonals(items: Iterable[pytest.Item]) -> Iterator[pytest.Item]:
    """The cases of ``DIAGONALS`` that are not needed for every value of either parameter."""
    cases: dict[str, list[tuple[pytest.Item, int, int]]] = {}
    for item in items:
        if (name := name_of(item)) in DIAGONALS:
            indices = item.callspec.indices
            cases.setdefault(name, []).append((item, *(indices[parameter] for parameter in DIAGONALS[name])))
    for several in cases.values():
        fewer = 1 + min(max(row for _, row, _ in several), max(column for _, _, column in several))
        yield from (item for item, row, column in several if (row + column) % fewer)


def left_out(items: Iterable[pytest.Item], known: Iterable[str]) -> Iterator[pytest.Item]:
    """The tests that a commit does not run; ``known``: the names of all engines."""
    items, known, seen = list(items), set(known), Counter[str]()
    between = set(map(id, off_diagonals(items)))
    for item in items:
        name = name_of(item)
        quick = ENGINES.get(name)
        other = quick is not None and (of := engines_of(item, known)) and not of & quick
        turn = seen[name] % CASES.get(name, 1)
        seen[name] += 1
        if name in WHOLE or turn or other or id(item) in between:
            yield item
