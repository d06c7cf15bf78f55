"""Drivers: a stop that is heard, a stale answer that is no answer, a number that is none."""

from mutants.mutant import Mutant

READER, PORTS, LINES = "drivers/core/reader.py", "drivers/core/ports.py", "drivers/lines.py"
GRBL, TALK = "drivers/grbl/stage.py", "drivers/grbl/line.py"
TEST_READER, TEST_GRBL = "tests/drivers/core/test_reader.py", "tests/drivers/test_grbl.py"

DEVICES = (
    Mutant(
        "a UR looks for contact in the next press too", "drivers/ur/client.py",
        "                self._end_detection()\n                self._begin_operation()",
        "                self._begin_operation()",
        ("tests/drivers/ur/test_contact.py::test_another_move_ends_the_search",),
    ),
    Mutant(
        "an older UR that cannot find contact is asked to", "drivers/ur/version.py",
        "return (self.major, self.minor) >= (5, 4)", "return True",
        ("tests/drivers/ur/test_contact.py::test_a_controller_that_has_no_contact_detection_is_refused",),
    ),
    Mutant(
        "an old reading is a zero", READER,
        "if age_s > max(0.5, 5 / self.rate_hz):", "if age_s > 1e9:",
        (f"{TEST_READER}::test_an_old_reading_is_no_zero",),
    ),
    Mutant(
        "a tare hides that a sensor clips", READER,
        "saturated = np.abs(raw) >= self._full_scale",
        "saturated = np.abs(raw - self._zero) >= self._full_scale",
        (f"{TEST_READER}::test_tare_is_subtracted_but_saturation_is_of_the_raw_reading",),
    ),
    Mutant(
        "samples are dropped and not counted", READER,
        "self._lost += 1 + self._waiting.popleft().lost", "self._waiting.popleft()",
        (f"{TEST_READER}::test_what_is_not_read_is_dropped_oldest_first_and_counted",),
    ),
    Mutant(
        "a line that is lost looks silent", READER,
        'self._fault = DeviceFault(self.name, f"connection lost ({error})")', "pass",
        (f"{TEST_READER}::test_a_line_that_ends_is_reported_after_the_last_sample",),
    ),
    Mutant(
        "two programs on one port", PORTS,
        "exclusive=True", "exclusive=False",
        ("tests/drivers/core/test_ports.py",),
    ),
    Mutant(
        "an infinite number is a reading", "drivers/core/reader.py",
        "if not (math.isfinite(sample.time_s) and all(map(math.isfinite, sample.values))):",
        "if not math.isfinite(sample.time_s):",
        ("tests/drivers/test_lines.py",),
    ),
    Mutant(
        "a stop that was not heard is not repeated", GRBL,
        'talk.realtime(JOG_CANCEL if status.state == "Jog" else HOLD)', "pass",
        ("tests/drivers/test_grbl_stops.py",),
    ),
    Mutant(
        "a stop is not sent", GRBL,
        "        talk.realtime(HOLD if self._probing else JOG_CANCEL)", "        pass",
        ("tests/drivers/test_grbl_stops.py",),
    ),
    Mutant(
        "a stop while a move is accepted is lost", GRBL,
        "if stops != self._stops:  # stopped while the board was thinking",
        "if stops > self._stops:",
        ("tests/drivers/test_grbl_stops.py",),
    ),
    Mutant(
        "a second move while one runs", GRBL,
        'raise DeviceFault(self.name, "still moving; wait or stop before the next move")', "pass",
        (f"{TEST_GRBL}::test_a_second_move_is_refused_while_the_first_runs",),
    ),
    Mutant(
        "a silent board is believed", GRBL,
        "if age_s > self._settings.silent_s:", "if age_s > 1e9:",
        ("tests/drivers/test_grbl_stops.py",),
    ),
    Mutant(
        "a board that restarted is believed", GRBL,
        "if talk.restarts > self._restarts:", "if talk.restarts < 0:",
        ("tests/drivers/test_grbl_stops.py"
         "::test_a_board_without_homing_that_restarted_is_not_believed",),
    ),
    Mutant(
        "an alarm is not noticed", GRBL,
        'if talk.alarm is not None or status.state == "Alarm":', 'if status.state == "Never":',
        (f"{TEST_GRBL}::test_a_fault_in_a_move_is_reported_in_words",),
    ),
    Mutant(
        "a target beyond the limits", GRBL,
        "check_target(self.name, self.limits_mm, target)", "pass",
        (f"{TEST_GRBL}::test_a_target_outside_the_travel_is_refused_in_words",
         "tests/drivers/test_grbl_stops.py"),
    ),
    Mutant(
        "faster than the stage may", "drivers/core/stage_limits.py",
        "if not 0 < 1e3 * speed_m_s <= max_speed_mm_s * (1 + 1e-9):",
        "if not 0 < 1e3 * speed_m_s:", ("tests/drivers/test_grbl_stops.py",),
    ),
    Mutant(
        "a lost board looks alive", TALK,
        "            self._lose(str(error))\n        except Exception as error:",
        "            pass\n        except Exception as error:",
        ("tests/drivers/test_grbl_stops.py",),
    ),
)  # fmt: skip
