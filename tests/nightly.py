"""What flies each night and not with each change: cases whose sisters fly with each change.

A sixth of the processor's time of all tests went into flights that differ from another one in the
autopilot, a seed or a number, or whose way another test flies, too. `pytest --nightly` and
`.ci/run --nightly` fly them, and so does whoever names a file or a test: only a run of all tests
leaves them out, and says so.
"""

from collections.abc import Mapping

NIGHTLY: Mapping[str, Mapping[str, tuple[str, ...]]] = {
    "campaigns/checks/test_case_warnings.py": {
        "test_time_without_a_processor_is_not_the_autonomys": (),
    },
    "faults/test_virtual_kills.py": {
        "test_both_vehicles_come_down_after_any_trouble": ("7", "77"),
        "test_both_vehicles_come_down_and_nothing_passes_after_any_kill": ("3", "9"),
        "test_a_step_of_the_wall_clock_changes_nothing": (),
    },
    "faults/test_clock_steps.py": {
        "test_a_clock_that_steps_on_and_back_disturbs_no_flight": ("wil",),
    },
    "faults/test_field_faults.py": {
        "test_messages_of_a_second_sender_hide_no_wall": ("text",),
        "test_a_part_that_is_lost_is_refused_or_nothing_says_that_it_was_there": ("obj cut",),
    },
    "faults/test_signal_faults.py": {
        "test_no_fault_of_a_signal_makes_a_flight_pass_that_must_fail": ("9",),
    },
    "faults/test_socket_flights.py": {
        "test_motion_capture_that_repeats_itself_before_a_wall_proves_nothing": (),
    },
    "faults/exceptions/test_injected_exceptions.py": {
        "test_no_exception_is_lost": ("sim-kinds1", "wil-kinds2"),
        "test_a_watcher_that_raises_at_the_end_of_a_flight_is_no_pass": (
            "exception-done",
            "cancelled-end",
        ),
    },
    "faults/exceptions/test_wall_exceptions.py": {"test_no_exception_is_lost": ("the guard",)},
    "orchestrator/campaign/test_attached_run.py": {
        "test_an_attached_simulation_that_offers_its_ground_truth_is_judged_by_it": (
            "px4-HIL_STATE_QUATERNION",
        ),
        "test_an_attached_px4_and_a_launched_arducopter_fly_as_a_pair": (),
    },
    "orchestrator/campaign/test_side_by_side.py": {
        "test_one_of_two_campaigns_with_one_broker_port_flies_and_the_other_says_why": (),
    },
    "orchestrator/campaign/test_reevaluation.py": {
        "test_a_recorded_run_is_judged_as_it_was_flown": ("sets0-PASS", "sets1-FAIL"),
        "test_judge_counts_the_end_of_a_campaign_outside_of_its_runs": ("ended0", "ended3"),
    },
    "orchestrator/external/test_reading_flights.py": {
        "test_a_sensor_that_is_spoiled_in_flight_proves_nothing": ("freezes", "is no number"),
        "test_depth_that_is_spoiled_proves_nothing": ("not a number",),
    },
    "orchestrator/external/test_sourced_flights.py": {
        "test_a_live_camera_that_repeats_its_last_image_with_new_stamps_proves_nothing": ("False",),
        "test_a_live_camera_that_stalls_or_dies_in_flight": ("error0-INVALID",),
        "test_a_recording_that_fails_in_flight_is_an_error_and_lands": ("is over",),
    },
    "orchestrator/external/test_attached_readings.py": {
        "test_requested_readings_come_over_the_socket_of_the_vehicle": (
            "px4-rangefinder-DISTANCE_SENSOR",
            "ardupilot-imu-RAW_IMU",
        ),
    },
    "orchestrator/run/flight/test_run.py": {
        "test_limits_keep_a_reckless_autonomy_inside_of_the_fence": ("gate",),
        "test_a_vehicle_that_dies_in_flight_is_an_error_and_the_other_lands": ("goal",),
        "test_a_full_disk_lands_the_flight_and_is_an_error": ("JudgeLogWriter",),
    },
    "orchestrator/run/flight/test_actor_flight.py": {
        "test_an_actor_that_does_not_fly_its_motion_makes_the_run_invalid": (
            "max_offset_m=0.01-off its",
        ),
    },
    "orchestrator/run/flight/test_actor_links.py": {
        "test_an_attached_actor_at_another_place_flies_the_way_of_its_object": (),
        "test_the_guard_lands_both_when_the_program_is_killed": (),
        "test_a_launched_actor_moves_its_object_by_its_ground_truth": (),
    },
    "orchestrator/run/flight/test_lockstep_run.py": {
        "test_processes_that_are_late_make_a_flight_slow_and_not_red": ("wil-options1",),
        "test_an_unaltered_flight_passes": (),
    },
    "orchestrator/run/flight/test_scenarios.py": {
        "test_the_scenario_passes_in_simulation": ("avoid-slow",),
    },
    "orchestrator/run/flight/test_scaled_run.py": {
        "test_a_launched_simulator_leads_at_the_pace_that_it_attains": (),
    },
    "orchestrator/run/flight/test_wire_faults.py": {
        "test_estimators_loss_is_invalid": ("fix-fix_type 1-px4", "glitch-GLITCH-ardupilot"),
        "test_heading_corrected_in_flight_is_no_pass": ("3.0-px4", "0.0-ardupilot"),
        "test_fix_that_is_lost_is_a_fault_whatever_is_judged": ("px4",),
        "test_dead_reckoning_that_is_permitted_is_a_caveat": ("ardupilot",),
    },
    "orchestrator/run/flight/test_ground.py": {
        "test_a_vehicle_that_touches_the_ground_in_flight_fails": (
            "px4-[[0, 0, -1.8, 1.2], [0, 0, 1, 1.5]]",
            "ardupilot-[[0.5, 0, -1, 1.2], [1, 0, -0.3, 1.65], [0, 0, 1, 1.5]]",
        ),
    },
    "orchestrator/run/judging/test_run_evidence.py": {
        "test_a_radio_is_held_to_its_rate_or_to_what_the_campaign_says": (
            "sets0-PASS-0.062",
            "sets1-INVALID-0.25",
        ),
        "test_motion_capture_counts_from_takeoff_to_landed": (
            "alter-land-from the position by truth",
        ),
    },
    "orchestrator/run/perception/test_autonomy_calls.py": {
        "test_a_faulty_autonomy_fails_the_run_and_all_land": (
            "ask-the autonomy of real crashed: SystemExit: 0 (",
            "<lambda>-the autonomy of real returned nothing, not a Command",
        ),
    },
    "orchestrator/run/perception/test_perception.py": {
        "test_mixing_that_leaves_its_budget_makes_a_run_invalid": ("skew",),
    },
    "orchestrator/run/perception/test_stray_errors.py": {
        "test_an_error_outside_of_a_call_is_a_failure_of_the_autonomy": ("thread", "callback"),
    },
    "orchestrator/run/stages/test_landing.py": {
        "test_a_word_that_a_landing_vehicle_is_disarmed_ends_no_run_in_the_air": ("gate",),
    },
    "orchestrator/run/stages/test_operator_hold.py": {
        "test_a_hold_before_the_goal_only_delays_it": (
            "gate-takeoff-0.3",
            "gate-at_height-0.2",
            "gate-ardupilot-takeoff-2.5",
        ),
        "test_a_hold_after_the_goal_proves_nothing_and_the_flight_goes_on": ("gate",),
    },
    "orchestrator/run/stages/test_twin_coupling.py": {
        "test_a_slower_or_faster_twin_leaves_the_real_flight_as_it_is": (
            "follow-0.8-0.45",
            "shadow-0.8-3.0",
        ),
    },
    "orchestrator/run/vehicles/test_firmware_record.py": {
        "test_the_firmware_and_a_digest_of_its_parameters": ("px4",),
    },
    "orchestrator/run/vehicles/test_onboard_fences.py": {
        "test_a_radio_that_loses_delays_it": ("px4",),
    },
    "plugins/impaired_links/test_bad_radio.py": {
        "test_the_pair_flies_over_a_radio_that_loses_and_is_late": ("4-gate",),
        "test_a_gap_that_was_recovered_but_too_long_fails": ("gate-ardupilot",),
        "test_a_radio_that_flaps_for_less_than_the_limit_is_flown_by": ("gate",),
    },
    "plugins/impaired_links/test_impaired_flight.py": {
        "test_a_flight_over_a_bad_radio": (
            "bad0-6-px4",
            "bad1-7-ardupilot",
            "bad2-3-px4",
            "bad3-4-ardupilot",
        ),
    },
    "plugins/offline/test_replay_runs.py": {
        "test_images_recorded_as_jpeg_are_replayed_within_what_jpeg_loses": (),
        "test_steps_that_select_by_time_also_get_images_not_due_in_a_replay": (),
    },
    "plugins/programs/test_program_flights.py": {
        "test_a_program_is_sent_mixtures_of_the_size_that_the_recipe_gives_them": (),
    },
    "plugins/python/test_flown_places.py": {"test_a_program_names_an_engine": ()},
    "plugins/ros2/test_node_flights.py": {"test_a_node_flies_the_same_way_twice": ("stays",)},
    "plugins/search/test_search_runner.py": {
        "test_a_missing_extra_is_refused_with_the_remedy_before_anything_is_written": (
            "tpe-optuna",
        ),
    },
    "safety/guard/test_guard_embedded.py": {
        "test_interrupted_at_any_moment_both_come_down": ("0", "6", "8"),
        "test_the_truth_stays_inside_of_the_fence": ("1.5",),
    },
    "vehicles/clients/test_clients.py": {
        "test_mavproxy_flies_the_embedded_vehicle": ("px4",),
        "test_scripts_with_pymavlink_fly_the_embedded_vehicle": (
            "ardupilot-udp-udpin:127.0.0.1:{}",
        ),
        "test_mavsdk_flies_the_embedded_vehicle": ("ardupilot-tcp-tcpout://127.0.0.1:{}",),
    },
    "vehicles/driver/test_conformance.py": {
        "test_each_driver_flies_a_whole_flight": (
            "mavlink-px4-memory",
            "mavlink-px4-impaired",
            "mavlink-ardupilot-memory",
            "mavlink-ardupilot-udp",
            "mavsdk-px4-udp",
            "mavsdk-ardupilot-impaired",
            "mavsdk-ardupilot-tcp",
        ),
    },
    "vehicles/driver/test_flights_in_a_row.py": {
        "test_ten_flights_in_a_row_of_which_somebody_else_ends_every_second": ("px4",),
    },
    "vehicles/driver/onboard/test_onboard.py": {
        "test_logs_of_a_flight_are_whole": ("good-1-ardupilot", "bad-2-px4"),
    },
    "vehicles/embedded/autopilot/test_fuzz.py": {
        "test_an_autopilot_survives_every_message_of_the_dialect": ("ground-px4", "air-ardupilot"),
    },
    "vehicles/embedded/fidelity/test_fidelity.py": {
        "test_every_figure_is_within_reach_of_the_firmware": ("px4 jsbsim", "ardupilot compiled"),
    },
}
"""Files, their test functions, and which cases of each fly with each change none the less."""


def flies_nightly(file: str, test: str) -> bool:
    """Return whether a test flies each night only. file: beneath tests; test: `name[case]`."""
    function, _, case = test.partition("[")
    kept = NIGHTLY.get(file, {}).get(function)
    return kept is not None and case.removesuffix("]") not in kept
