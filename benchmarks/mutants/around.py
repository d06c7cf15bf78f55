"""Signals, the remote control, rehearsals, and what a rig file may ask for."""

from mutants.mutant import Mutant

COMMANDS, REMOTE = "probe/acquisition/commands.py", "probe/acquisition/remote.py"
REHEARSAL = "probe/acquisition/rehearsal.py"
RIG, PLAN = "probe/config/rig.py", "probe/config/scan_limits.py"
TEST_COMMANDS = "tests/probe/acquisition/test_commands.py"
TEST_REMOTE = "tests/probe/acquisition/test_remote.py"
TEST_RESUME = "tests/probe/acquisition/test_resume.py"
TEST_ENGINE = "tests/probe/acquisition/test_engine.py"
TEST_FALLBACK = "tests/probe/config/test_fallback.py"
TEST_RIG = "tests/probe/config/test_rig.py"
ENDING = '("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT", "SIGTSTP")'
SIGNALS = f"{TEST_COMMANDS}::test_any_signal_aborts_and_ctrl_c_after_it_stops"

AROUND = (
    *(
        Mutant(
            f"{name} kills the scan", COMMANDS,
            ENDING, ENDING.replace(f', "{name}"', "").replace(f'"{name}", ', ""),
            (), (f"wall 3 {kind}",),
        )
        for name, kind in (
            ("SIGINT", "ctrl-c typed"), ("SIGTERM", "SIGTERM"), ("SIGHUP", "SIGHUP"),
            ("SIGQUIT", "ctrl-backslash typed"),
        )
    ),
    Mutant(
        "ctrl-z leaves the probe pressed", COMMANDS,
        ENDING, ENDING.replace(', "SIGTSTP"', ""),
        (TEST_COMMANDS,),
    ),
    Mutant(
        "a second ctrl-c does not stop", COMMANDS,
        "            control.stop()",
        "            control.abort()",
        (SIGNALS,),
    ),
    Mutant(
        "a pause takes back an abort", COMMANDS,
        "return max((", "return min((",
        (f"{TEST_COMMANDS}::test_the_most_urgent_command_wins_and_an_abort_stays",),
    ),
    Mutant(
        "ctrl-c reaches the robot's client", "drivers/ur/client.py",
        "        os.setsid()", "        os.getpid()",
        ("tests/drivers/ur/test_ur.py::test_ctrl_c_at_a_terminal_is_not_for_the_client",),
    ),
    Mutant(
        "a lost terminal kills", "probe/cli/say.py",
        "    with suppress(OSError):  # the terminal may be gone; the scan and its file are not\n"
        "        print(visible(text), file=sys.stderr, flush=True)",
        "    print(visible(text), file=sys.stderr, flush=True)",
        ("tests/probe/cli/test_lost_terminal.py",),
    ),
    Mutant(
        "anybody may stop a scan", REMOTE,
        "if not known:", "if known is None:",
        (f"{TEST_REMOTE}::test_strangers_and_noise_change_nothing",),
    ),
    Mutant(
        "the scan listens to the whole network", REMOTE,
        '("127.0.0.1", 0)', '("0.0.0.0", 0)',
        ("tests/probe/acquisition/test_remote_door.py",),
    ),
    Mutant(
        "everybody can read the secret", REMOTE,
        "0o600", "0o644",
        ("tests/probe/acquisition/test_remote_door.py",),
    ),
    Mutant(
        "a simulated force guards a real stage", REHEARSAL,
        "and all(c.simulated for c in force_channels)",
        "and not force_channels",
        (f"{TEST_FALLBACK}::test_a_real_stage_with_a_virtual_sensor_rehearses_a_scan",),
    ),
    Mutant(
        "a rehearsal touches", REHEARSAL,
        "AIR_M = 10e-3", "AIR_M = -5e-3",
        (f"{TEST_FALLBACK}::test_a_real_stage_with_a_virtual_sensor_rehearses_a_scan",),
    ),
    Mutant(
        "newtons over no face", "probe/acquisition/prepare.py",
        "if force_channels and face_mm2 is None:", "if force_channels is None:",
        (f"{TEST_RIG}::test_wrong_devices_name_key_and_value",
         "tests/probe/acquisition/test_force_limit.py"),
    ),
    Mutant(
        "faster than the limit allows", RIG,
        "if speed > safety.max_speed_mm_s:", "if speed > 1e9:",
        (f"{TEST_RIG}::test_wrong_rigs_name_file_key_and_value",),
    ),
    Mutant(
        "a touch beyond the limit", RIG,
        "if scan.touch_n is not None and scan.touch_n >= safety.max_force_n:",
        "if scan.touch_n is not None and scan.touch_n >= 1e9:",
        (f"{TEST_RIG}::test_wrong_rigs_name_file_key_and_value",),
    ),
    Mutant(
        "a plan deeper than the limit", PLAN,
        "if safety.max_depth_mm is not None and safety.max_depth_mm < deepest_mm - ROUNDING_MM:",
        "if safety.max_depth_mm is not None and safety.max_depth_mm < 0:",
        (f"{TEST_RIG}::test_wrong_rigs_name_file_key_and_value",),
    ),
    Mutant(
        "a plan out of the workspace", PLAN,
        "    check_reach(plan, (x, y, z))\n", "",
        (f"{TEST_RIG}::test_wrong_rigs_name_file_key_and_value",),
    ),
    Mutant(
        "a run goes on with another calibration", "probe/acquisition/resume.py",
        "if _files(config) != left.files:", "if _files(config) == 0:",
        (f"{TEST_RESUME}::test_another_calibration_or_wave_is_another_run",),
    ),
    Mutant(
        "a viewer's bug ends the scan", "probe/acquisition/observers.py",
        "        except Exception as error:  # noqa: BLE001 - a viewer's bug must not end a scan",
        "        except ZeroDivisionError as error:",
        ("tests/probe/acquisition/test_engine.py::test_a_broken_viewer_is_noted_and_left_alone",),
    ),
    Mutant(
        "samples are stored under the station before", "probe/acquisition/event_bus.py",
        "for from_s in starts[1:]), len(times)]", "for from_s in starts[:-1]), len(times)]",
        (f"{TEST_ENGINE}::test_every_sample_of_a_press_is_in_and_labelled",),
    ),
)  # fmt: skip
