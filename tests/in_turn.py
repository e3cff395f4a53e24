"""What flies in turn: with each commit a tenth of it, which the commit's hash chooses.

Most of the processor's time of all tests goes into a twentieth of them: flights of programs on the
wall clock, faults of plugins, nodes and stores that each fly a campaign, pages in a browser, and
flights that differ from others in a little. Each of them flies with one commit of ten, and the same
of them with the same commit on every machine. `pytest --all` and `.ci/run --all` fly them all, as
before a release, and so does whoever names a file or a test: only a run of all tests leaves
something out, and says so.
"""

import subprocess
from collections.abc import Mapping
from pathlib import Path

SHARES = 10
IN_TURN: Mapping[str, tuple[str, ...]] = {
    "campaigns/autonomies/test_gate_autonomy.py": (
        "test_it_flies_through_the_middle_and_stops_behind",
    ),
    "campaigns/checks/test_autonomy_checks.py": (
        "test_a_program_that_checks_a_file_is_not_run_again_for_it",
    ),
    "campaigns/checks/test_case_warnings.py": (
        "test_time_without_a_processor_is_not_the_autonomys",
        "test_an_autonomy_that_blocks_or_dies_on_import_is_a_fault",
    ),
    "faults/exceptions/test_injected_exceptions.py": (
        "test_no_exception_is_lost",
        "test_a_watcher_that_raises_at_the_end_of_a_flight_is_no_pass",
    ),
    "faults/exceptions/test_wall_exceptions.py": (),
    "faults/test_clock_steps.py": (),
    "faults/test_field_faults.py": (
        "test_messages_of_a_second_sender_hide_no_wall",
        "test_a_part_that_is_lost_is_refused_or_nothing_says_that_it_was_there",
    ),
    "faults/test_signal_faults.py": (
        "test_no_fault_of_a_signal_makes_a_flight_pass_that_must_fail",
    ),
    "faults/test_socket_flights.py": (
        "test_a_wall_is_touched_over_relays_that_alter_nothing",
        "test_motion_capture_that_repeats_itself_before_a_wall_proves_nothing",
    ),
    "faults/test_virtual_kills.py": (
        "test_both_vehicles_come_down_and_nothing_passes_after_any_kill",
        "test_both_vehicles_come_down_after_any_trouble",
        "test_a_step_of_the_wall_clock_changes_nothing",
    ),
    "orchestrator/campaign/folder/test_manifest.py": (
        "test_which_runs_were_chosen_is_no_change_of_their_files",
        "test_requirements_are_read_back_from_the_manifest",
        "test_each_run_is_recorded_with_the_world_that_it_flies_in",
    ),
    "orchestrator/campaign/folder/test_repetitions.py": (
        "test_readers_know_that_a_composition_stops_when_it_is_decided",
    ),
    "orchestrator/campaign/resuming/test_runs_to_fly.py": (
        "test_a_run_that_lands_after_a_kill_is_flown_again",
        "test_no_run_counts_twice_after_two_kills_with_its_run",
        "test_a_resumption_keeps_the_runs_before_a_kill_between_two_runs",
        "test_other_versions_and_spoilt_manifests_are_not_resumed",
    ),
    "orchestrator/campaign/test_attached_run.py": (),
    "orchestrator/campaign/test_reevaluation.py": (
        "test_a_recorded_run_is_judged_as_it_was_flown",
        "test_another_limit_is_tried_without_a_flight",
        "test_no_code_that_the_files_name_is_run",
        "test_a_reason_quotes_the_note_of_the_moment_that_decided",
        "test_judge_counts_the_end_of_a_campaign_outside_of_its_runs",
    ),
    "orchestrator/campaign/test_retries.py": (
        "test_a_run_that_the_decision_made_needless_is_not_flown_again",
    ),
    "orchestrator/campaign/test_side_by_side.py": (),
    "orchestrator/campaign/test_user_code.py": (
        "test_a_change_of_any_module_is_seen_before_a_resumption",
    ),
    "orchestrator/campaign/workers/test_run_server.py": (
        "test_runs_are_flown_after_the_folder_of_the_run_servers_socket_has_gone",
        "test_a_file_of_the_user_is_not_imported_in_place_of_a_module",
        "test_a_program_that_is_killed_leaves_no_worker_of_its_report",
        "test_ctrl_c_while_the_run_server_imports_prints_no_traceback",
        "test_a_run_loads_nothing_to_read_its_files_that_the_run_server_can_load",
    ),
    "orchestrator/campaign/workers/test_worker_pool.py": (
        "test_time_without_a_processor_is_not_that_of_loading",
        "test_the_death_of_the_run_server_is_no_fault_of_a_run_that_was_done",
        "test_a_run_server_that_ends_before_it_forks_is_started_again",
    ),
    "orchestrator/cli/commands/test_container_user.py": (
        "test_an_unknown_user_without_a_home_flies_from_a_read_only_installation",
    ),
    "orchestrator/cli/commands/test_run_command.py": (
        "test_a_campaign_flies_on_when_nobody_looks_on",
        "test_a_signal_to_the_whole_group_lands_flying_vehicles",
        "test_a_run_that_hangs_before_its_first_word_ends_with_the_first_signal",
        "test_runs_of_one_worker_do_not_know_of_each_other",
        "test_results_that_somebody_removes_while_others_fly_are_named",
    ),
    "orchestrator/cli/test_first_compilation.py": ("test_run_prints_it_before_the_first_flight",),
    "orchestrator/cli/test_standard_streams.py": (
        "test_a_reader_that_has_seen_enough_causes_no_error",
    ),
    "orchestrator/external/test_attached_readings.py": (),
    "orchestrator/external/test_external_flights.py": (),
    "orchestrator/external/test_reading_flights.py": (
        "test_sensors_that_the_vehicle_sends_are_mixed_as_any",
        "test_an_ardupilot_sends_mg_and_mrad",
        "test_a_sensor_that_is_spoiled_in_flight_proves_nothing",
        "test_a_recording_is_flown_by_and_is_an_error_when_it_ends_in_flight",
        "test_recorded_depth_is_mixed_perceived_recorded_and_read_back",
        "test_depth_that_is_spoiled_proves_nothing",
        "test_a_lidar_has_the_distances_of_the_autopilot_s_sectors",
    ),
    "orchestrator/external/test_sourced_flights.py": (),
    "orchestrator/reading/test_damaged_documents.py": (
        "test_a_campaign_file_of_another_shape_is_named",
    ),
    "orchestrator/recording/test_recorded_images.py": (
        "test_a_flight_records_no_image_that_it_drew_and_all_read_it",
    ),
    "orchestrator/recording/test_wall_recording.py": (),
    "orchestrator/report/test_report_browser.py": (
        "test_the_violated_limit_is_drawn_over_its_interval_with_the_part_beyond",
        "test_keys_lead_from_run_to_run",
    ),
    "orchestrator/run/flight/test_actor_flight.py": (
        "test_the_intruder_touches_a_vehicle_that_does_not_evade",
        "test_equal_runs_with_an_actor_are_equal_to_the_byte",
        "test_a_contact_with_the_actor_in_mode_real_fails_the_run",
        "test_an_actor_that_leaves_its_fence_lands_and_is_no_fault_of_the_subject",
        "test_an_actor_that_does_not_fly_its_motion_makes_the_run_invalid",
        "test_an_actor_that_is_slower_than_its_motion_makes_the_run_invalid",
    ),
    "orchestrator/run/flight/test_actor_links.py": (),
    "orchestrator/run/flight/test_fence_changes.py": (
        "test_a_new_fence_holds_for_both_and_the_flight_goes_on",
        "test_a_first_fence_holds_where_there_was_none",
        "test_a_vehicle_that_leaves_the_new_fence_is_brought_down",
    ),
    "orchestrator/run/flight/test_ground.py": (
        "test_a_vehicle_that_touches_the_ground_in_flight_fails",
        "test_an_object_that_never_moved_is_a_caveat",
    ),
    "orchestrator/run/flight/test_lockstep_run.py": (
        "test_processes_that_are_late_make_a_flight_slow_and_not_red",
        "test_an_orchestrator_that_hangs_has_its_vehicles_landed",
        "test_an_estimate_that_jumps_proves_nothing",
        "test_an_estimate_that_freezes_proves_nothing",
        "test_an_unaltered_flight_passes",
    ),
    "orchestrator/run/flight/test_run.py": (
        "test_the_same_seed_gives_the_same_bytes_watched_or_not_and_another_seed_others",
        "test_sim_flies_the_twin_alone_and_judges_it",
        "test_a_thing_that_moves_starts_at_its_event",
        "test_a_vehicle_that_dies_in_flight_is_an_error_and_the_other_lands",
        "test_limits_keep_a_reckless_autonomy_inside_of_the_fence",
        "test_an_autonomy_that_never_ends_runs_into_the_time_limit",
        "test_a_full_disk_lands_the_flight_and_is_an_error",
        "test_a_live_feed_that_raises_ends_and_the_flight_goes_on",
    ),
    "orchestrator/run/flight/test_scaled_run.py": (
        "test_a_flight_at_four_times_real_time",
        "test_a_launched_simulator_leads_at_the_pace_that_it_attains",
        "test_a_simulation_that_stands_still_ends_the_run",
        "test_an_orchestrator_that_is_killed_leaves_vehicles_that_land",
        "test_a_campaign_that_cannot_follow_the_scaled_clock_is_refused",
    ),
    "orchestrator/run/flight/test_scenarios.py": (),
    "orchestrator/run/flight/test_wall_run.py": (
        "test_the_operator_holds_and_gives_another_fence_and_then_aborts",
        "test_ctrl_c_lands_first",
        "test_a_pilot_at_a_ground_station_takes_over",
        "test_a_slow_autonomy_fails_and_holds_nothing_up",
    ),
    "orchestrator/run/flight/test_wire_faults.py": (
        "test_heading_corrected_in_flight_is_no_pass",
        "test_estimators_loss_is_invalid",
        "test_fix_that_is_lost_is_a_fault_whatever_is_judged",
        "test_dead_reckoning_that_is_permitted_is_a_caveat",
    ),
    "orchestrator/run/judging/test_run_evidence.py": (
        "test_motion_capture_counts_from_takeoff_to_landed",
        "test_a_radio_is_held_to_its_rate_or_to_what_the_campaign_says",
    ),
    "orchestrator/run/perception/test_autonomy_calls.py": (
        "test_a_faulty_autonomy_fails_the_run_and_all_land",
    ),
    "orchestrator/run/perception/test_autonomy_lane.py": (
        "test_a_call_that_keeps_the_interpreter_is_named",
    ),
    "orchestrator/run/perception/test_autonomy_memory.py": (
        "test_a_run_whose_autonomy_eats_memory_fails_and_lands",
        "test_a_run_whose_autonomy_spins_ends_within_the_campaigns_time_for_a_call",
    ),
    "orchestrator/run/perception/test_perception.py": (
        "test_every_sensor_is_mixed_delivered_and_recorded",
        "test_an_autonomy_that_paints_on_its_images_changes_no_others",
        "test_mixing_that_leaves_its_budget_makes_a_run_invalid",
        "test_an_object_of_other_cases_isolates_nothing",
        "test_a_vehicle_alone_perceives_all_its_own_sensors",
    ),
    "orchestrator/run/perception/test_stray_errors.py": (
        "test_an_error_outside_of_a_call_is_a_failure_of_the_autonomy",
    ),
    "orchestrator/run/perception/test_visibility_runs.py": (
        "test_a_recipe_that_changes_the_whole_picture_is_measured_too",
        "test_an_object_that_the_recipe_need_not_show_is_not_missed",
        "test_a_recipe_that_shows_no_objects_says_that_it_was_not_measured",
        "test_the_outputs_of_a_measured_mixture_are_held_until_the_next_one",
        "test_beams_are_compared_with_what_geometry_puts_before_them",
    ),
    "orchestrator/run/perception/test_warm_up.py": (
        "test_the_kernels_that_measure_a_mesh_are_loaded_before_the_flight",
    ),
    "orchestrator/run/stages/test_anchor_capture.py": (
        "test_a_flight_that_is_anchored_by_motion_capture",
    ),
    "orchestrator/run/stages/test_landing.py": (
        "test_a_word_that_a_landing_vehicle_is_disarmed_ends_no_run_in_the_air",
    ),
    "orchestrator/run/stages/test_liftoff.py": (),
    "orchestrator/run/stages/test_operator_hold.py": (
        "test_a_hold_before_the_goal_only_delays_it",
        "test_a_hold_after_the_goal_proves_nothing_and_the_flight_goes_on",
        "test_nothing_of_the_flight_ends_it_while_it_is_held",
        "test_a_hold_while_landing_stops_it_in_the_air",
        "test_the_operator_may_abort_during_a_hold",
    ),
    "orchestrator/run/stages/test_twin_coupling.py": (),
    "orchestrator/run/vehicles/test_compiled_physics.py": ("test_a_pair_without_jsbsim_passes",),
    "orchestrator/run/vehicles/test_firmware_record.py": (
        "test_the_firmware_and_a_digest_of_its_parameters",
        "test_the_firmware_that_flew_is_in_the_manifest_and_the_report",
    ),
    "orchestrator/run/vehicles/test_onboard_fences.py": (
        "test_both_autopilots_have_the_new_fence",
        "test_it_is_judged_again_by_the_fence_that_held_then",
        "test_each_vehicle_may_get_one_of_its_own",
        "test_no_autopilot_keeps_a_fence_that_one_of_them_refuses",
        "test_a_radio_that_loses_delays_it",
        "test_a_short_outage_in_the_middle_is_waited_for",
        "test_a_held_vehicle_may_be_given_another_fence",
    ),
    "orchestrator/run/vehicles/test_preflight_runs.py": (
        "test_an_overridden_check_lets_it_fly_and_names_the_person",
        "test_preflight_checks_are_in_the_result_and_the_log",
        "test_the_preflight_shows_that_commands_are_not_signed",
        "test_steps_before_arming_are_recorded_in_their_order",
    ),
    "orchestrator/run_results/test_caveats.py": (
        "test_a_flown_campaign_says_what_failed_and_was_only_reported",
    ),
    "orchestrator/state/test_return_path.py": ("test_it_flies_back_and_stands_at_its_start",),
    "orchestrator/test_autonomy_page.py": ("test_the_autonomy_of_the_page_passes_the_gate",),
    "orchestrator/test_flown_controls.py": ("test_controls_of_each_kind_end_as_expected",),
    "orchestrator/test_wrong_autonomies.py": (
        "test_the_right_one_passes_and_each_wrong_one_fails_by_the_right_oracle",
    ),
    "plugins/calibration/test_boards.py": ("test_corners_are_found_where_they_are",),
    "plugins/calibration/test_calibrate.py": (
        "test_mounting_by_a_video_and_the_poses_of_its_body_whose_clocks_differ",
        "test_a_recorded_run_has_images_and_poses",
        "test_images_that_show_too_little",
    ),
    "plugins/calibration/test_live_search.py": (
        "test_a_search_without_motion_capture_has_no_path",
        "test_board_and_poses_come_together",
    ),
    "plugins/calibration/test_mounting_fit.py": (
        "test_images_while_the_body_was_hidden_are_left_out",
        "test_mounting_and_latency_are_recovered",
        "test_the_poses_of_another_body_do_not_fit",
        "test_poses_that_come_twice_or_in_disorder_do_no_harm",
    ),
    "plugins/ci/test_github_job.py": ("test_run_and_judge_tell_the_job",),
    "plugins/cluster/bench/test_bench_deaths.py": (),
    "plugins/cluster/bench/test_bench_flight.py": (),
    "plugins/cluster/test_ray_engine.py": (
        "test_a_lost_node_keeps_a_campaign_from_nothing_that_others_fly",
        "test_a_file_of_the_node_that_changes_while_the_campaign_flies_ends_it",
        "test_an_operator_reaches_the_run_on_its_node",
        "test_a_worker_that_dies_in_flight_takes_one_run_which_is_not_flown_again",
        "test_an_order_that_no_message_can_hold_is_not_in_the_ledger",
    ),
    "plugins/cluster/test_s3.py": (
        "test_a_server_that_vanishes_is_an_error_with_its_address",
        "test_a_run_comes_back_from_a_bucket",
    ),
    "plugins/cluster/test_store_of_results.py": (
        "test_a_failure_whose_files_cannot_be_sent_is_not_flown_again",
        "test_a_store_that_does_not_answer_keeps_a_resumed_campaign_from_flying",
        "test_a_result_that_cannot_be_sent_stays_on_the_node_that_the_reason_names",
        "test_a_result_sent_for_a_program_that_died_is_fetched_by_the_next_one",
        "test_a_store_that_is_gone_when_the_result_is_fetched_leaves_it_on_the_node",
        "test_an_order_of_an_earlier_start_is_refused_by_the_store",
        "test_a_damaged_file_does_not_count",
        "test_a_worker_that_dies_in_flight_is_waited_for_in_the_store",
        "test_results_through_a_store_are_the_same_to_the_byte",
        "test_a_node_that_sees_another_store_is_refused",
        "test_a_missing_store_is_exit_2",
    ),
    "plugins/console/test_console_flight.py": (),
    "plugins/console/test_fence_editor.py": (
        "test_areas_of_both_kinds_are_sent_as_they_are",
        "test_an_area_is_added_dragged_and_kept_out_of_and_another_removed",
        "test_a_fence_of_exclusions_alone_is_not_sent",
        "test_a_first_fence_is_drawn_around_the_vehicles",
    ),
    "plugins/console/test_page_in_space.py": (
        "test_the_view_in_space_shows_vehicles_fence_and_gate_and_turns",
    ),
    "plugins/console/test_page_truth.py": (
        "test_the_reason_is_whole_on_a_tablet_and_a_phone",
        "test_the_next_run_is_announced_until_the_last",
        "test_two_campaigns_are_named_and_their_flying_vehicles_are_summed",
        "test_choosing_a_run_redraws_all_and_shows_its_events",
        "test_the_head_names_what_has_failed_and_nothing_that_is_only_not_reached_yet",
        "test_margins_are_in_the_first_screen_and_the_dialog_covers_no_abort",
    ),
    "plugins/console/test_page_unseen.py": (
        "test_all_down_has_the_same_time_after_a_reload",
        "test_a_page_that_is_opened_later_shows_the_true_age",
    ),
    "plugins/console/test_two_operators.py": ("test_control_is_handed_over_in_sight_of_both",),
    "plugins/detector/test_detector.py": (
        "test_a_network_of_instance_segmentation_gives_masks",
        "test_the_file_may_state_its_classes",
        "test_names_that_contradict_the_file_are_refused",
    ),
    "plugins/foxglove/test_bridge.py": ("test_an_address_in_use_is_refused_before_anything_flies",),
    "plugins/foxglove/test_bridge_flight.py": (),
    "plugins/impaired_links/test_bad_radio.py": (
        "test_the_pair_flies_over_a_radio_that_loses_and_is_late",
        "test_luck_on_the_radio_is_seeded",
        "test_px4_returns_by_itself_in_an_outage_and_that_ends_at_the_ceiling",
        "test_ardupilot_waits_in_place_and_a_lost_vehicle_is_no_fail_of_the_autonomy",
        "test_a_gap_that_was_recovered_but_too_long_fails",
        "test_a_radio_that_flaps_for_less_than_the_limit_is_flown_by",
        "test_a_radio_that_flaps_for_longer_fails_at_its_first_gap",
    ),
    "plugins/impaired_links/test_impaired_flight.py": ("test_a_flight_over_a_bad_radio",),
    "plugins/injection/test_injected_flights.py": (
        "test_the_real_autopilot_stops_before_a_wall_that_is_not_there_and_again",
        "test_a_twin_that_follows_keeps_from_nothing_by_itself",
        "test_in_mode_sim_the_twin_gets_its_own_lidar",
        "test_an_arducopter_whose_range_sensor_is_silent_is_not_ready",
    ),
    "plugins/logs/test_start_from_log.py": (
        "test_the_log_of_a_run_is_flown_again",
        "test_a_campaign_of_a_log_validates",
    ),
    "plugins/mavsdk/test_mavsdk_run.py": (),
    "plugins/meshes/test_mesh_limits.py": (
        "test_instances_are_counted_before_they_are_made",
        "test_a_small_file_with_a_large_picture_is_refused",
    ),
    "plugins/offline/test_replay_runs.py": (
        "test_a_run_mixed_anew_equals_its_recording",
        "test_steps_that_select_by_time_also_get_images_not_due_in_a_replay",
        "test_images_recorded_as_jpeg_are_replayed_within_what_jpeg_loses",
    ),
    "plugins/programs/test_program_flights.py": (),
    "plugins/pytest/test_pytest_plugin.py": (
        "test_a_fail_is_a_failure_and_an_unproven_run_an_error",
        "test_a_campaign_that_cannot_be_flown_is_an_error_of_each_run",
        "test_the_end_of_a_campaign_outside_of_its_runs_is_an_error_of_its_own",
        "test_an_aborted_run_is_an_error_whether_or_not_it_counts",
        "test_an_exit_code_that_the_runs_explain_is_no_further_error",
    ),
    "plugins/python/test_arguments.py": ("test_one_text_is_no_list_of_letters",),
    "plugins/python/test_flown_places.py": (
        "test_a_program_says_what_a_bench_of_this_machine_needs",
        "test_a_program_flies_on_a_bench_of_this_machine_with_consent_alone",
        "test_a_user_without_the_right_to_arm_cannot_arm_a_bench_by_a_program",
        "test_a_program_names_an_engine",
        "test_pytest_takes_benches_and_an_engine",
    ),
    "plugins/python/test_mock_vehicle.py": (
        "test_the_fixture_in_a_session_of_pytest",
        "test_mavsdk_arms_it_and_it_ends_with_the_program_however_that_ends",
        "test_pymavlink_finds_it_in_an_event_loop_and_faults_act",
        "test_a_port_that_is_taken_is_named",
    ),
    "plugins/python/test_python_docs.py": (
        "test_the_examples_of_the_page_run",
        "test_an_exception_of_the_program_lands_first",
    ),
    "plugins/ros2/test_node_flights.py": (
        "test_a_node_flies_the_same_way_twice",
        "test_a_bag_played_back_into_the_same_node_gives_the_same_setpoints",
        "test_a_node_that_breaks_in_flight_fails_the_run_with_its_last_lines",
        "test_a_node_with_the_topics_of_mavros_flies_by_the_map_of_the_page",
        "test_a_node_of_px4_msgs_arms_climbs_and_lands_by_its_commands",
        "test_a_node_aborts_at_any_stage_and_where_it_ends_itself",
        "test_a_shadow_flies_the_setpoints_of_a_node",
    ),
    "plugins/ros2/test_node_wall_flight.py": ("test_a_node_flies_over_zenoh",),
    "plugins/ros2/test_starter.py": ("test_the_campaign_of_init_flies_by_its_node",),
    "plugins/search/test_search_flown.py": (
        "test_a_failure_is_found_confirmed_made_smaller_and_flown_from_its_file",
        "test_a_search_killed_after_a_flight_had_failed_comes_to_the_same",
    ),
    "plugins/search/test_search_on_bench.py": (
        "test_a_search_on_a_bench_asks_before_each_flight_and_ends_without_consent",
    ),
    "plugins/search/test_search_places.py": (
        "test_a_search_over_a_cluster_finds_the_same_with_workers_that_stay",
        "test_a_search_flies_in_the_fence_of_a_bench_and_not_its_vehicle",
    ),
    "plugins/search/test_search_runner.py": (
        "test_a_search_killed_at_any_batch_goes_on_as_if_it_had_not_been",
    ),
    "plugins/simulator/test_simulator_camera.py": (
        "test_the_reference_simulator_says_that_it_shows_another_case",
        "test_the_reference_simulator_draws_what_our_renderer_draws",
    ),
    "plugins/standalone/test_vehicle_camera.py": (
        "test_a_ground_station_s_connect_sequence_ends_at_pictures_of_the_world",
    ),
    "plugins/start/test_init_command.py": ("test_a_name_that_yaml_reads_as_a_number_is_a_name",),
    "plugins/start/test_json_schemas.py": ("test_the_schemas_are_json_schemas",),
    "plugins/statistics/gap/test_gap_energy.py": (
        "test_the_distance_is_that_of_its_definition",
        "test_pairs_of_one_seed_make_no_mode_nearer",
    ),
    "plugins/statistics/test_conclusions.py": (
        "test_published_counts_are_named_as_those_of_others",
        "test_the_conclusions_come_before_the_tables",
        "test_a_difference_of_passes_says_what_would_show_it",
    ),
    "plugins/statistics/test_plan_command.py": ("test_plan_claims_no_more_than_the_flights_show",),
    "plugins/statistics/test_study.py": (
        "test_the_command_prints_tables_and_one_document",
        "test_a_flight_prints_the_comparison_only_of_modes_beside_reality",
    ),
    "plugins/step_response/test_vehicle_flight.py": (
        "test_ctrl_c_lands_and_disarms_first_however_often",
    ),
    "plugins/stl/test_stl_oracle.py": (
        "test_a_look_in_flight_at_a_part_is_one_at_all",
        "test_a_look_in_flight_costs_no_more_after_many_minutes",
    ),
    "plugins/stream_links/test_flapping.py": ("test_a_flight_by_a_link_that_flaps",),
    "safety/guard/test_guard_embedded.py": (
        "test_the_truth_stays_inside_of_the_fence",
        "test_interrupted_at_any_moment_both_come_down",
    ),
    "test_ci_files.py": ("test_the_action_validates_flies_and_shows_what_failed",),
    "test_tutorial_docs.py": ("test_the_flights_of_the_page_print_what_it_shows",),
    "vehicles/clients/test_clients.py": (
        "test_mavsdk_flies_the_embedded_vehicle",
        "test_scripts_with_pymavlink_fly_the_embedded_vehicle",
        "test_mavproxy_flies_the_embedded_vehicle",
        "test_a_mock_vehicle_answers_all_that_qgroundcontrol_asks",
    ),
    "vehicles/driver/onboard/test_onboard.py": (
        "test_logs_of_a_flight_are_whole",
        "test_fence_mission_and_parameters_are_written_and_read_back",
    ),
    "vehicles/driver/test_conformance.py": (
        "test_each_driver_flies_a_whole_flight",
        "test_a_link_that_flaps_is_reported_each_time_and_the_vehicle_flies_after_it",
    ),
    "vehicles/driver/test_driver.py": ("test_flies_whatever_the_latency",),
    "vehicles/driver/test_driver_parts.py": ("test_awaited_commands_of_a_closed_commander_fail",),
    "vehicles/driver/test_flights_in_a_row.py": (
        "test_ten_flights_in_a_row_of_which_somebody_else_ends_every_second",
    ),
    "vehicles/embedded/autopilot/test_fuzz.py": (
        "test_an_autopilot_survives_every_message_of_the_dialect",
    ),
    "vehicles/embedded/fidelity/test_fidelity.py": (
        "test_every_figure_is_within_reach_of_the_firmware",
        "test_each_segment_is_where_the_firmware_is",
        "test_px4_is_no_farther_from_the_firmwares_flights_than_they_are_from_each_other",
        "test_another_gain_is_seen",
        "test_events_follow_each_other_as_the_firmware_has_them",
        "test_px4_pitches_as_and_when_the_firmware_does",
    ),
    "vehicles/embedded/process/test_embedded_process.py": (
        "test_an_unknown_profile_or_link_is_reported",
    ),
    "vehicles/embedded/process/test_many_clients.py": (
        "test_two_vehicles_at_one_port_of_a_client_are_distinguished",
        "test_a_second_vehicle_at_a_port_to_listen_at_is_refused",
    ),
    "vehicles/mavlink/test_sender_sequence.py": (
        "test_short_outages_of_a_fast_sender_make_no_second_one",
    ),
    "vehicles/perception/test_hsv_kernel.py": ("test_a_campaign_is_validated_without_numba",),
    "wil_campaign/foundation/processes/test_other_systems.py": (
        "test_a_doctor_looks_at_other_systems_too",
        "test_runs_on_other_systems_fly_in_virtual_time_alone",
    ),
    "wil_campaign/foundation/processes/test_parallel_calls.py": (
        "test_results_come_in_order_unless_a_process_is_lost",
    ),
    "wil_campaign/test_installed_plugins.py": (
        "test_a_plugin_observes_the_runs_of_a_campaign_that_has_its_key",
        "test_a_plugin_of_one_file_flies_in_the_gate",
        "test_runs_fly_by_an_engine_of_another_distribution",
        "test_the_plugin_of_the_page_flies",
        "test_a_live_view_with_the_name_of_an_option_of_run_is_named",
        "test_a_live_view_whose_name_is_no_word_is_named",
        "test_a_plugin_tells_how_commands_ended_and_may_fail",
        "test_the_text_of_a_section_is_printed_after_the_verdicts",
        "test_a_plugin_says_which_other_one_it_lacks",
    ),
    "wil_campaign/test_plugin_faults.py": (
        "test_a_plugin_s_sensor_that_fails_is_named",
        "test_a_plugin_s_oracle_that_returns_what_is_no_answer_is_named",
        "test_a_plugin_s_oracle_that_cannot_be_made_is_named",
    ),
    "wil_campaign/test_program_end.py": (
        "test_the_run_server_starts_before_a_command_that_flies_is_imported",
    ),
    "wil_campaign/test_sensor_plugin.py": (),
    "worlds/test_jit.py": (
        "test_the_first_kernel_imports_no_linear_algebra_and_others_still_have_it",
    ),
}
"""Files beneath tests, and their functions that fly in turn; none: all of them."""


def flies_in_turn(file: str, test: str) -> bool:
    """Return whether a test flies in turn. file: beneath tests; test: `name` or `name[case]`."""
    functions = IN_TURN.get(file)
    return functions is not None and (not functions or test.partition("[")[0] in functions)


def share_of_commit(folder: Path) -> int | None:
    """Return which share flies with the commit of a checkout; None, all, where Git names none."""
    try:
        asked = subprocess.run(
            ["git", "rev-parse", "--verify", "HEAD"],  # noqa: S607
            cwd=folder,
            capture_output=True,
            text=True,
            check=True,
        )
    except (OSError, subprocess.CalledProcessError):
        return None
    return int(asked.stdout[:8], 16) % SHARES
