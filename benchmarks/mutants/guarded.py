"""Guards, the way out, and the engine that obeys them."""

from mutants.mutant import Mutant

GUARDS, POSE = "probe/acquisition/force_limit.py", "probe/acquisition/pose_guard.py"
TIMES = "probe/acquisition/sample_times.py"
MONITOR, RETREAT = "probe/acquisition/safety_monitor.py", "probe/acquisition/retreat.py"
ENGINE, ALIVE = "probe/acquisition/engine.py", "probe/acquisition/stuck_sensor.py"
LOOP, RULES = "probe/acquisition/run_loop.py", "probe/acquisition/stop_rules.py"
CLOCKS = "probe/acquisition/clock_guard.py"
PRESS = "probe/acquisition/press_guard.py"
PRESSES = "probe/acquisition/presses.py"
LEVELS, TOUCHING = "probe/acquisition/levels.py", "probe/acquisition/touching.py"
TEST_MONITOR = "tests/probe/acquisition/test_safety_monitor.py"
TEST_ENGINE = "tests/probe/acquisition/test_engine.py"
TEST_TOUCHING = "tests/probe/acquisition/test_touching.py"
TEST_CONTACT = "tests/probe/acquisition/test_ur_contact.py"
TEST_LIMIT = "tests/probe/acquisition/test_force_limit.py"
TEST_WORLDS = "tests/probe/acquisition/test_worlds_not_built.py"
TEST_PRESSES = "tests/probe/acquisition/test_presses.py"
TEST_FALSE = "tests/probe/acquisition/test_false_sensors.py"
SENSOR_CASES = f"{TEST_MONITOR}::test_what_a_sensor_guard_objects_to"
POSE_CASES = f"{TEST_MONITOR}::test_what_a_pose_guard_objects_to"

GUARDED = (
    Mutant(
        "the force is not limited", GUARDS,
        "if not all(abs(load) <= self._limit_n for load in loads):",
        "if not loads:",
        (), ("simulated 5 hard bed",),
    ),
    Mutant(
        "a force that is not a number passes", GUARDS,
        "if not all(abs(load) <= self._limit_n for load in loads):",
        "if any(abs(load) > self._limit_n for load in loads):",
        (SENSOR_CASES,),
    ),
    Mutant(
        "a pull is not limited", GUARDS,
        "if not all(abs(load) <= self._limit_n for load in loads):",
        "if not all(load <= self._limit_n for load in loads):",
        (SENSOR_CASES,),
    ),
    Mutant(
        "only the newest force of a block is looked at", GUARDS,
        "if not all(abs(load) <= self._limit_n for load in loads):",
        "if not all(abs(load) <= self._limit_n for load in loads[-1:]):",
        (SENSOR_CASES,),
    ),
    Mutant(
        "saturation is ignored", GUARDS,
        "block.saturated[:, self._clips].any():", "block.saturated[:, :0].any():",
        (SENSOR_CASES,),
    ),
    Mutant(
        "taxels are averaged", GUARDS,
        "[sum(one) for one in each]", "[sum(one) / len(one) for one in each]",
        (f"{TEST_MONITOR}::test_pressure_is_guarded_as_force_on_the_face",),
    ),
    Mutant(
        "sideways force is not limited", GUARDS,
        "if not norm <= limit:", "if norm < 0:",
        (f"{TEST_LIMIT}::test_sideways_force_and_torque_are_limited",),
    ),
    Mutant(
        "sideways force is never looked at", "probe/acquisition/force_limit.py",
        "        self.tared = True", "        self.tared = False",
        (f"{TEST_LIMIT}::test_a_sideways_force_ends_the_scan_and_lifts",),
    ),
    Mutant(
        "a rig whose limit holds nothing is scanned with", MONITOR,
        "if not lifts_only and not any(guard.feels for _, guard in self._sensors):",
        "if not self._sensors:",
        (f"{TEST_LIMIT}::test_a_rig_whose_limit_holds_nothing_does_not_move",),
    ),
    Mutant(
        "samples of the future are believed", TIMES,
        "last <= now_s + FUTURE_S", "last <= now_s + 1e9",
        (SENSOR_CASES,),
    ),
    Mutant(
        "samples of the past are believed", TIMES,
        "pairwise((self._last_s, *times))", "pairwise((-1e9, *times))",
        (SENSOR_CASES,),
    ),
    Mutant(
        "a stuck sensor is believed", GUARDS,
        "if (dead := self._alive.check(used)) is not None:",
        "if (dead := self._alive.check(used[:0])) is not None:",
        (f"{TEST_FALSE}::test_a_sensor_that_does_not_feel_is_found_out",),
        ("simulated 3 cell stuck",),
    ),
    Mutant(
        "the sensor's own noise is not learned", ALIVE,
        "MIN_PAIRS = 100", "LEARNED = 1_000_000_000",
        (f"{TEST_FALSE}::test_a_sensor_that_does_not_feel_is_found_out",),
        ("simulated 3 cell stuck",),
    ),
    Mutant(
        "a press that is not felt goes on", LEVELS,
        "not mean <= least_n(name, err) for name, (mean, err) in levels.items()",
        "True for _ in levels",
        ("tests/probe/acquisition/test_way_out.py::test_a_press_is_felt_as_a_push",),
    ),
    Mutant(
        "a clip that the lift shows is not told", LEVELS,
        "abs(fell_n) <= max(FLAT * foretold_n, noise_n)", "fell_n < -foretold_n",
        (f"{TEST_FALSE}"
         "::test_a_sensor_that_clips_in_the_last_of_a_press_is_noted_when_the_lift_begins",),
    ),
    Mutant(
        "a beat that hides the lift is a clip", LEVELS,
        "0 < error <= STILL * usual[name]", "0 < error",
        (f"{TEST_FALSE}"
         "::test_a_force_that_falls_or_that_noise_hides_is_not_taken_for_one_that_clips",),
    ),
    Mutant(
        "a tare in contact hides its load", LEVELS,
        "if not abs(change_n) <=", "if abs(change_n) > 1e9 +",
        (f"{TEST_FALSE}::test_a_load_is_not_taken_as_zero",),
    ),
    Mutant(
        "the depth is not limited", POSE,
        "if not depth <= self._limits.max_depth_m + POSE_SLACK_M:", "if depth > 1e9:",
        (POSE_CASES,),
    ),
    Mutant(
        "a depth that is not a number passes", POSE,
        "if not depth <= self._limits.max_depth_m + POSE_SLACK_M:",
        "if depth > self._limits.max_depth_m + POSE_SLACK_M:",
        (f"{TEST_MONITOR}::test_where_the_surface_is_not_known_nothing_may_press",),
    ),
    Mutant(
        "no workspace", POSE,
        "if not low - POSE_SLACK_M <= at <= high + POSE_SLACK_M:",
        "if not -1e9 <= at <= 1e9:",
        (POSE_CASES,),
    ),
    Mutant(
        "a pose that is not a number passes", POSE,
        "if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(z)):",
        "if not math.isfinite(x):",
        (POSE_CASES,),
    ),
    Mutant(
        "any speed", POSE,
        "if ahead_m > limit_m_s * POSE_AGE_S:", "if ahead_m > 1e9:",
        (f"{TEST_MONITOR}::test_a_stage_that_is_too_fast_is_noticed",),
    ),
    Mutant(
        "any way", POSE,
        "if off_m > allowed_m:", "if off_m > 1e9:",
        (f"{TEST_WORLDS}::test_a_probe_that_somebody_else_moves_is_noticed",),
        ("simulated 30 pulled sideways",),
    ),
    Mutant(
        "a clock may stand", CLOCKS,
        "if jump_s < -self._limit_s:", "if jump_s < -1e9:",
        (f"{TEST_WORLDS}::test_a_computer_that_slept_is_noticed",),
    ),
    Mutant(
        "a clock may jump ahead", CLOCKS,
        "if jump_s > self._limit_s:", "if jump_s > 1e9:",
        ("tests/probe/acquisition/test_guards_of_guards.py",),
    ),
    Mutant(
        "the probe is never lifted", RETREAT,
        "self._start(pose._replace(z=max(self._lift_z_m, pose.z)), self._speed_m_s)",
        "self._start(pose, self._speed_m_s)",
        (), ("simulated 5 hard bed",),
    ),
    Mutant(
        "a stop is sent once", RETREAT,
        "            self._stopped_s = now_s\n            self._stop()",
        "            self._stopped_s = now_s",
        (f"{TEST_WORLDS}::test_a_stop_is_repeated_until_it_is_heard",),
    ),
    Mutant(
        "a lift that goes down goes on", RETREAT,
        "if down_m > WRONG_WAY_M or aside_m > 5 * WRONG_WAY_M:", "if down_m > 1e9:",
        (f"{TEST_WORLDS}::test_a_lift_that_goes_down_is_stopped",),
    ),
    Mutant(
        "a lift is tried once", RETREAT,
        "elif now_s - self._tried_s >= LIFT_AGAIN_S:", "elif self._tried_s == -math.inf:",
        ("tests/probe/acquisition/test_way_out.py::test_a_lift_that_was_refused_is_tried_again",),
    ),
    Mutant(
        "a silent device is waited for", MONITOR,
        "        if silent_s > most_s:", "        if silent_s > 1e9:",
        (f"{TEST_WORLDS}::test_a_force_sensor_that_falls_silent_in_the_hold_ends_it",),
    ),
    Mutant(
        "a moving stage is silent's guess", MONITOR,
        'key = "late_s" if self._in_motion else "silence_s"', 'key = "silence_s"',
        (f"{TEST_WORLDS}::test_a_sensor_that_is_silent_beside_another_is_not_waited_for",),
    ),
    Mutant(
        "bursts hide what may build up", PRESS,
        "most_s = min(limits.late_s, room_n / (limits.hardest_n_m * speed_m_s))",
        "most_s = limits.late_s",
        (f"{TEST_WORLDS}::test_a_sensor_that_speaks_in_bursts_does_not_get_near_the_tissue",),
    ),
    Mutant(
        "a press may be too fast for its sensor", PRESS,
        "if speed > most_m_s * (1 + ROUNDING):", "if speed > 1e9:",
        (f"{TEST_LIMIT}::test_a_press_too_fast_for_its_sensor_is_refused",),
    ),
    Mutant(
        "a force that stops to rise is believed", PRESS,
        "if rose_n >= FLAT * foretold_n or", "if rose_n >= -1e9 or",
        (f"{TEST_FALSE}::test_a_force_that_stops_to_rise_is_not_believed",),
    ),
    Mutant(
        "a press that nobody feels goes on", PRESSES,
        "> self._within_m:", "> 1e9:",
        (f"{TEST_PRESSES}::test_a_press_that_is_not_felt_half_way_down_ends_there",),
    ),
    Mutant(
        "every sensor must feel a press", PRESSES,
        "if any(guard.in_contact()", "if all(guard.in_contact()",
        (f"{TEST_PRESSES}::test_one_sensor_that_feels_the_press_is_enough",),
    ),
    Mutant(
        "a search must feel the surface at once", PRESSES,
        "or self._searches:", "or False:",
        (f"{TEST_PRESSES}::test_a_surface_that_is_searched_may_be_low",),
    ),
    Mutant(
        "what noise hides is asked for", PRESS,
        "or least_n > LITTLE_SHARE * self._limit_n:", "or least_n > 1e9:",
        (f"{TEST_PRESSES}::test_what_noise_hides_of_little_tissue_is_not_asked_for",),
    ),
    Mutant(
        "what is harder than was said is pressed", PRESS,
        "            self._too_fast()\n            or self", "            self",
        (f"{TEST_FALSE}::test_what_is_harder_than_was_said_is_not_pressed",),
    ),
    Mutant(
        "a clip at the end of a press is believed", PRESS,
        "return self._stood_still(now) if self._times else None", "return None",
        (f"{TEST_FALSE}::test_a_sensor_that_clips_at_the_end_of_a_press_is_found_out_in_the_hold",),
    ),
    Mutant(
        "noise alone is a press that stood still", PRESS,
        " or share > LAST_SHARE:", ":",
        (f"{TEST_FALSE}"
         "::test_a_force_that_falls_or_that_noise_hides_is_not_taken_for_one_that_clips",),
    ),
    Mutant(
        "a faint clip passes for soft tissue", PRESS,
        "FAINT_WAY_M = 1e-3", "FAINT_WAY_M = 1.0",
        (f"{TEST_FALSE}::test_a_sensor_that_clips_far_below_the_limit_does_not_pass_for_soft_tissue",),
    ),
    Mutant(
        "what few readings show counts as contact", LEVELS,
        "return max(MIN_STANDARD_ERRORS * error, faint)", "return MIN_STANDARD_ERRORS * error",
        ("tests/probe/acquisition/test_way_out.py::test_a_press_is_felt_as_a_push",),
    ),
    Mutant(
        "a pose that says up is believed", RETREAT,
        " and (self.lifting or not self._led_down)", "",
        ("tests/probe/acquisition/test_way_out.py"
         "::test_a_tip_that_was_sent_down_is_lifted_though_its_pose_never_changed",),
    ),
    Mutant(
        "what is read before a tare is contact", "probe/acquisition/force_limit.py",
        "        self._newest.clear()\n", "",
        (f"{TEST_MONITOR}::test_what_was_read_before_a_tare_is_in_no_mean_after_it",),
    ),
    Mutant(
        "a blocked engine is waited for", MONITOR,
        "if time.monotonic() - self._engine_s > self._limits.engine_s:",
        "if time.monotonic() - self._engine_s > 1e9:",
        (f"{TEST_MONITOR}::test_a_blocked_engine_does_not_leave_the_probe_in_the_tissue",),
    ),
    Mutant(
        "a dead thread is not missed", MONITOR,
        "        if late_s > DEAD_S:", "        if late_s > 1e9:",
        ("tests/probe/acquisition/test_guards_of_guards.py",),
    ),
    Mutant(
        "a guard that fails is not told", MONITOR,
        'self.object("guard", f"{type(error).__name__}: {error}", can_retract=True)', "pass",
        ("tests/probe/acquisition/test_guards_of_guards.py",),
    ),
    Mutant(
        "a stop waits for the engine", MONITOR,
        '        if self._control.command is RunCommand.STOP:\n            self.object(',
        '        if self._control.command is None:\n            self.object(',
        (f"{TEST_MONITOR}::test_a_stop_acts_while_the_engine_is_blocked",),
    ),
    Mutant(
        "the scan goes on after a trip", RULES,
        "return None if seen.trip is None else interruption_of(seen.trip)", "return None",
        ("tests/probe/acquisition/test_guards_of_guards.py::test_a_trip_ends_a_long_hold",),
    ),
    Mutant(
        "a full disk is ignored", RULES,
        "if seen.sink_error is None:", "if True:",
        (f"{TEST_ENGINE}::test_a_full_disk_lifts_the_probe",),
    ),
    Mutant(
        "an abort is ignored", RULES,
        "if seen.command is not RunCommand.ABORT:", "if True:",
        (f"{TEST_ENGINE}::test_abort_retracts",),
    ),
    Mutant(
        "a slow observer is waited for", ENGINE,
        "bus = EventBus(clock, sink, observers, threaded=threaded)",
        "bus = EventBus(clock, sink, observers, threaded=False)",
        (f"{TEST_WORLDS}::test_a_slow_observer_delays_nothing_and_hears_everything",),
    ),
    Mutant(
        "a stage may rest anywhere", LOOP,
        "if off > ARRIVED_M and not touched:", "if off > 1e9:",
        (f"{TEST_WORLDS}::test_a_stage_that_comes_to_rest_elsewhere_presses_nothing",),
    ),
    Mutant(
        "a station ends before its samples are in", LOOP,
        "while complete and self.monitor.seen_s() < now:", "while False:",
        (f"{TEST_WORLDS}::test_a_station_waits_for_what_its_sensor_says_late",),
    ),
    Mutant(
        "nothing touched is a touch", TOUCHING,
        "if loop.go(lowest, TOUCH_M_S, until=touches):",
        "if not loop.go(lowest, TOUCH_M_S, until=touches):",
        (f"{TEST_TOUCHING}::test_touch_finds_the_surface",
         f"{TEST_TOUCHING}::test_nothing_to_touch_is_a_fault_that_says_what_was_felt"),
    ),
    Mutant(
        "a contact in the air is a surface", TOUCHING,
        "if most_n < touch_n:", "if most_n < 0:",
        (f"{TEST_CONTACT}::test_contact_in_the_air_is_a_fault",),
    ),
    Mutant(
        "going back from a contact is a sensor's fault", MONITOR,
        "if odd is not None and not abilities.touched(self._stage):", "if odd is not None:",
        (f"{TEST_CONTACT}::test_the_press_begins_where_contact_began",),
    ),
    Mutant(
        "complete stations are pressed again", ENGINE,
        "if place.index not in completed:", "if place.index not in ():",
        (f"{TEST_ENGINE}::test_a_resumed_run_skips_what_is_complete",),
    ),
    Mutant(
        "a tip that stands in the tissue as a scan connects is left there", ENGINE,
        "if (why := self._leave(error)).finish is not None:",
        "if (why := error).finish is not None:",
        ("tests/probe/acquisition/test_connecting.py",),
    ),
    Mutant(
        "a probe that was not lifted is not told", ENGINE,
        "if retreat.why_not is not None or not retreat.done:", "if not retreat.done:",
        (), ("simulated 24 board restarts",),
    ),
    Mutant(
        "a scan that dies leaves its probe", "probe/acquisition/guard_process.py",
        "if not self.started or self.finished:", "if self.started or self.finished:",
        ("tests/probe/acquisition/test_guard_process.py"
         "::test_a_scan_that_stands_still_or_dies_is_lifted[9]",),
    ),
    Mutant(
        "nobody takes over from dead guards", "probe/acquisition/guard_client.py",
        "if self._closing or not first:", "if True:",
        ("tests/probe/acquisition/test_guard_process.py"
         "::test_when_the_guards_die_or_hang_others_take_over_and_lift[9]",),
    ),
    Mutant(
        "a terminal's signals reach the guards", "probe/acquisition/guard_client.py",
        "start_new_session=True,", "start_new_session=False,",
        ("tests/probe/acquisition/test_guard_process.py::test_ctrl_c_at_the_terminal_lifts",),
    ),
    Mutant(
        "who takes over without a sensor does not lift", "probe/acquisition/guard_client.py",
        "for order in (self._order, alone):", "for order in (self._order,):",
        ("tests/probe/acquisition/test_guard_process.py::"
         "test_who_takes_over_lifts_without_a_sensor_that_is_gone_too",),
    ),
    Mutant(
        "who takes over and hangs is waited for", "probe/acquisition/guard_client.py",
        "            self._process.kill()  # one that hangs still has the devices\n", "",
        ("tests/probe/acquisition/test_guard_process.py::"
         "test_who_takes_over_and_hangs_is_not_waited_for",),
    ),
)  # fmt: skip
