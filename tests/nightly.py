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

MUJOCO, ODE, PYBULLET, RAPIER = (frozenset({name}) for name in ("mujoco", "ode", "pybullet", "rapier"))
BOTH = MUJOCO | ODE
"""One engine that is always installed, and the quickest."""
ENGINES = {
    "attribution/test_planted.py::test_the_culprit_is_named_first_although_the_engines_differ_too": BOTH,
    "engines/kit/test_bad_answers.py::test_the_proof_survives_any_read_back": BOTH,
    "engines/kit/test_session.py::test_queries_share_a_load_and_answer_as_after_a_separate_load": BOTH,
    "engines/kit/test_warm.py::test_a_forked_process_gives_the_bits_of_a_new_process_and_keeps_nothing": BOTH,
    "engines/test_engine_suite.py::test_a_native_controller_settles_at_its_target_without_gravity": BOTH,
    "engines/test_engine_suite.py::test_a_stack_stands_as_it_does_awake": BOTH,
    "engines/test_engine_suite.py::test_a_table_of_six_materials_is_stored_and_measured": ODE,
    "engines/test_engine_suite.py::test_efforts_are_constant_between_controller_updates": BOTH,
    "engines/test_engine_suite.py::test_driven_bodies_are_unaffected_by_sleeping": BOTH,
    "engines/test_engine_suite.py::test_windows_from_the_rows_of_a_run_end_in_the_next_rows": BOTH,
    "engines/test_native.py::test_the_same_run_twice_gives_the_same_bits": BOTH,
    "engines/test_native.py::test_both_kinds_in_a_single_tree_follow_and_are_recorded": BOTH | PYBULLET,
    "engines/test_native.py::test_the_arm_follows_a_slow_trajectory_within_the_declared_lag": BOTH | PYBULLET,
    "engines/test_meshes.py::test_a_body_of_two_hulls_lands_flat": BOTH,
    "engines/test_meshes.py::test_a_body_of_two_hulls_stands": BOTH,
    "engines/test_meshes.py::test_a_hull_rests_on_its_face": BOTH | RAPIER,
    "engines/test_meshes.py::test_a_hull_touches_where_its_surface_is": BOTH,
    "proof/test_contact_coupled.py::test_engines_keep_to_the_coupled_law": BOTH,
    "proof/test_contact_friction.py::test_an_oblong_slider_shows_whether_friction_is_against_the_slip": BOTH,
    "proof/test_contact_friction.py::test_engines_keep_the_law_and_another_is_found": BOTH,
    "proof/test_contact_run.py::test_planted_defects_are_measured": BOTH,
    "proof/test_contact_run.py::test_a_world_without_contact_has_no_contact_checks": BOTH,
    "proof/test_contact_scenes.py::test_a_scene_comes_out_as_its_oracle_says": BOTH,
    "proof/test_contact_scenes.py::test_a_tower_of_boxes_stands": BOTH,
    "proof/test_contact_scenes.py::test_a_tower_of_cylinders_stands": BOTH,
    "proof/test_filter_defects.py::test_every_defect_of_the_filter_is_caught": BOTH,
    "proof/test_filter_defects.py::test_the_sound_filter_passes_with_all_that_can_meet": BOTH,
    "proof/test_verify.py::test_every_planted_defect_is_caught": BOTH,
    "test_stacking.py::test_slippery_fingers_fail_and_the_report_says_how": MUJOCO,
    "test_stacking.py::test_the_same_run_twice_gives_the_same_bits": MUJOCO,
    "test_stacking.py::test_a_lifted_and_shaken_cylinder_does_not_slip": MUJOCO,
}
"""Of these each commit runs the cases of some engines, and those of no engine."""
CASES = {
    "attribution/test_planted.py::test_the_culprit_is_named_in_the_classes_in_which_it_acts": 3,
    "control/test_stability.py::test_the_prediction_for_kept_efforts_happens": 3,
    "commands/test_pages.py::test_check_fails_after_a_change_of_the_study": 5,
    "commands/test_robot_files.py::test_every_command_takes_them": 3,
    "commands/test_robot_files.py::test_the_project_file_says_where_packages_are": 3,
    "commands/test_trust.py::test_commands_that_only_list_plan_or_show_start_no_interpreter": 4,
    "docs/test_tutorials.py::test_a_tutorial_prints_what_its_page_shows": 5,
    "engines/kit/test_bad_answers.py::test_all_engines_except_the_spoilt_engine_have_complete_runs": 3,
    "commands/test_once.py::test_a_command_compiles_once_for_each_engine": 3,
    "engines/dart/test_engine.py::test_contact_free_motion": 4,
    "engines/drake/test_contact.py::test_another_friction_is_found": 2,
    "engines/kit/test_warm.py::test_failures_of_a_forked_process_are_reported_as_of_a_new_process": 3,
    "engines/pybullet/test_engine.py::test_contact_free_motion": 4,
    "engines/test_engine_suite.py::test_shapes_of_a_body_have_separate_materials": 2,
    # of eight worlds of each engine: each engine with other worlds
    "engines/test_engine_suite.py::test_the_engine_holds_the_world": 3,
    "engines/test_engine_suite.py::test_it_moves_as_the_oracle_does": 3,
    "engines/test_engine_suite.py::test_bodies_of_trees_move_as_in_the_oracle": 3,
    "engines/test_margin.py::test_a_margin_of_two_materials_stands_in_place_of_their_shapes": 3,
    "engines/test_margin.py::test_bodies_rest_where_they_are_felt": 3,
    "engines/test_motion_scenarios.py::test_every_engine_keeps_the_closed_form": 3,
    "engines/test_not_yet.py::test_features_declared_not_yet_do_not_work": 3,
    "engines/test_passive.py::test_contact_carries_the_weight_that_is_left": 3,
    "engines/webots/test_running.py::test_its_nodes_and_states_are_read": 3,
    "formats/test_readers.py::test_a_reader_has_the_model_of_the_world_except_for_foreseen_differences": 4,
    "formats/usd/test_files.py::test_packages_of_unknown_authors": 3,
    "formats/usd/test_plain.py::test_reads_back_to_the_same_world_and_writes_the_same_bytes": 4,
    "formats/usd/test_plain.py::test_several_joints_of_a_body_are_a_single_joint_where_the_file_states_them": 4,
    "imports/mjcf/test_importer.py::test_files_are_where_the_compiler_finds_them": 3,
    "language/test_formatting.py::test_any_layout_leads_to_the_same": 5,
    "language/test_formatting.py::test_data_are_laid_out_as_files_are": 5,
    "imports/usd/test_converters.py::test_defaults_and_settings_are_no_loss_of_physics": 3,
    "imports/usd/test_converters.py::test_settings_of_a_scene": 2,
    "meshes/test_reading.py::test_collada_says_its_unit_and_its_axis_and_places_what_it_has": 3,
    "outputs/test_writing.py::test_killed_at_any_point_a_first_writing_is_nothing_or_all": 2,
    "outputs/test_writing.py::test_killed_at_any_point_a_folder_is_the_old_or_the_new": 2,
    "plausibility/test_rules.py::test_planted": 2,
    "proof/test_chaos.py::test_a_long_chain_is_followed_near_its_rest": 2,
    "proof/test_complete.py::test_mutations_declared_inert_must_not_change_the_motion": 3,
    "proof/test_contact_coupled.py::test_a_wrong_number_is_seen": 3,
    "proof/test_contact_oblique.py::test_impacts_have_friction_within_four_percent_and_without_a_deviation": 3,
    "proof/test_contact_run.py::test_every_pair_is_measured_by_every_probe_that_applies": 3,
    "proof/test_contact_scenes.py::test_a_wrong_law_shows": 2,
    "proof/test_contact_size.py::test_a_millimetre_more_is_caught": 3,
    "proof/test_contact_size.py::test_true_sizes": 3,
    "proof/test_dry_friction.py::test_defects_visible_only_in_motion_are_found_with_dry_friction": 3,
    "proof/test_dry_friction.py::test_a_wrong_friction_is_found": 4,
    "proof/test_dry_friction.py::test_engines_rub_as_they_should": 2,
    "proof/test_motionless.py::test_a_loop_that_begins_at_a_limit_is_moved_inside_along_its_constraints": 3,
    "proof/test_touch.py::test_pairs_planned_as_separate_are_separate_in_random_states": 3,
    "proof/test_verify.py::test_wild_worlds_at_4_ms_are_valid_in_every_engine": 3,
    "report/page/test_browser.py::test_it_opens_without_a_word_and_fits": 3,
    "report/page/test_study_browser.py::test_it_opens_without_a_word_and_fits": 3,
    "report/test_contact.py::test_the_plot_is_the_same_bytes_every_time": 3,
    "test_bad_input.py::test_a_bad_spec_is_refused_in_bounded_work": 6,
    "test_endings.py::test_a_signal_at_work_leaves_no_process_and_no_folder": 2,
    "test_isolated.py::test_no_command_imports_from_the_working_folder": 3,
}
"""Of these each commit runs one case in so many, the first among them."""
NAMED = {
    # the robot scenario, which test_stacking.py runs in three engines
    "test_readme.py::test_a_command_of_the_documentation_runs": ("run stack-cylinders",),
}
"""Of these each commit leaves out the cases that have such words in their identifiers."""
WORLDS = "known"
"""The parameter of the suite's worlds: a world and all answers of an engine about it. Each commit runs the first in all
engines, and every second one of the others, not the same in engines that follow each other."""
DIAGONALS = {
    "engines/drake/test_hydroelastic.py::test_boxes_stand_by_pressure_at_the_depth_of_their_modulus": (
        "solver",
        "floor",
    ),
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
    "audit/test_corpora.py::test_a_finger_is_imported_and_certified",
    "commands/test_study.py::test_models_that_are_not_equal_are_each_proven",
    "comparison/test_long.py::test_no_array_of_all_rows_is_ever_in_memory",
    # MkDocs builds the site for 15 s; test_links.py follows the links of its pages
    "docs/test_site.py::test_every_link_leads_to_a_place",
    "docs/test_site.py::test_nothing_is_fetched_from_another_host",
    "docs/test_site.py::test_each_page_has_its_markdown_and_a_line_in_the_list",
    "docs/test_site.py::test_each_page_says_what_its_reader_can_do",
    "docs/test_site.py::test_tutorials_are_notebooks",
    "engines/dart/test_copies.py::test_seven_cylinders_stand_under_the_elliptic_cone",
    "engines/drake/test_contact.py::test_sap_is_off_as_it_declares",
    "engines/drake/test_contact.py::test_tamsi_has_the_law_and_its_slow_correction_is_declared",
    "engines/drake/test_hydroelastic.py::test_the_probes_of_boxes_hold_without_a_deviation",
    "engines/gzsim/test_engine.py::test_every_level_that_can_be_queried_is_valid_on_the_stand_in",
    "engines/pybullet/test_beside.py::test_frames_of_large_trees_are_in_the_sidecar_on_request",
    "engines/test_fake.py::test_it_passes_the_shipped_suite",
    "engines/test_first_engine.py::test_the_example_moves_as_mujoco_does",
    "engines/test_second_environment.py::test_two_versions_and_another_engine_in_a_single_run",
    "engines/webots/test_running.py::test_a_proof_queries_it",
    "experiments/test_dask.py::test_a_worker_killed_in_the_middle_costs_its_runs_only_and_the_bits_are_those_of_this_machine",
    "experiments/test_dask.py::test_an_engine_without_a_worker_and_a_lost_scheduler_are_errors",
    "experiments/test_timing.py::test_engines_take_turns_each_bound_and_alone",
    "engines/mujoco/test_arena.py::test_boxes_fit_with_all_their_points",
    "imports/test_panda.py::test_a_panda_with_meshes_and_coupled_fingers_picks_a_cube",
    "language/test_trajectory.py::test_points_times_joints_are_bounded",
    "proof/test_chaos.py::test_growing_errors_are_chaos_and_a_narrow_range_is_not",
    "proof/test_contact_scenes.py::test_a_tower_of_cylinders_needs_a_sound_detector",
    "report/viewer/test_live.py::test_sliders_move_the_model",
    "report/viewer/test_video.py::test_a_video_has_the_frames_and_is_the_same_each_time",
    "resolve/test_trajectory.py::test_every_place_that_the_robot_can_have_is_reached",
    "report/test_study_analysis.py::test_consistency_is_the_drift_of_free_fall",
    "test_action.py::test_the_steps_pass_and_report_then_fail_at_a_wrong_expectation",
    "test_endings.py::test_kills_at_random_moments_leave_nothing_that_the_next_call_does_not_remove",
    "test_endings.py::test_the_engine_of_a_stopped_driver_keeps_its_deadline",
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


def elsewhere(item: pytest.Item, known: Iterable[str]) -> bool:
    """Whether a world of the suite is left to other engines."""
    engine, callspec = getattr(getattr(item, "cls", None), "engine", None), getattr(item, "callspec", None)
    if engine is None or WORLDS not in getattr(callspec, "indices", ()):
        return False
    row = callspec.indices[WORLDS]
    return bool(row) and (row + sorted(known).index(engine)) % 2 == 1


def left_out(items: Iterable[pytest.Item], known: Iterable[str]) -> Iterator[pytest.Item]:
    """The tests that a commit does not run; ``known``: the names of all engines."""
    items, known, seen = list(items), set(known), Counter[str]()
    between = set(map(id, off_diagonals(items)))
    for item in items:
        name = name_of(item)
        quick = ENGINES.get(name)
        other = quick is not None and (of := engines_of(item, known)) and not of & quick
        named = any(words in item.callspec.id for words in NAMED.get(name, ()))
        if name in WHOLE or other or named or id(item) in between or elsewhere(item, known):
            yield item
            continue
        if seen[name] % CASES.get(name, 1):
            yield item
        seen[name] += 1
