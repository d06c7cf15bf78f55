"""What readers from outside broke: each mend is taken back."""

from mutants.mutant import Mutant

UNUSUAL = "tests/probe/detection/test_unusual_scans.py"
FIELDS = "tests/probe/detection/test_field.py"
HELD = "tests/probe/detection/test_hold_samples.py"
FORCES = "tests/probe/acquisition/test_preflight.py"
FAST = "tests/sim_backend/models/test_surrogate.py"
ROOM = "tests/sim_backend/scene/test_room.py"
SOLID = "tests/sim_backend/models/test_solid_press.py"

OUTSIDE = (
    Mutant("a row that rises on one side is a lump", "probe/detection/map/row_rivals.py",
           "(_waves(x_m), _further_edges(x_m), rises)",
           "(_waves(x_m), _further_edges(x_m))",
           (f"{UNUSUAL}::test_a_row_that_is_stiffer_on_one_side_is_no_lump",)),
    Mutant("a map that rises on one side is a lump", "probe/detection/map/field_objects.py",
           "rise = odds_of_a_straight_rise(levels, bumps, spot)", "rise = 0.0",
           (f"{FIELDS}::test_a_map_that_is_higher_on_one_side_shows_no_lump",)),
    Mutant("steps rise along x only", "probe/detection/map/field_rivals.py",
           "np.pi / DIRECTIONS * np.arange(DIRECTIONS)", "np.zeros(DIRECTIONS)",
           (f"{FIELDS}::test_a_step_in_any_direction_is_no_lump",)),
    Mutant("the end of a ridge is a lump", "probe/detection/map/field_rivals.py",
           "for rise in (step, shape):", "for rise in (step,):",
           (f"{FIELDS}::test_the_end_of_a_ridge_in_a_corner_is_no_lump",)),
    Mutant("what lies at the end of a row is named", "probe/detection/map/row_objects.py",
           'if said.kind != "undecided" and at in (0, len(line.x_m) - 1):',
           'if said.kind != "undecided" and at in ():',
           (f"{UNUSUAL}::test_an_object_at_the_end_of_a_row_is_not_named",)),
    Mutant("an interval stops at the end of its row", "probe/detection/map/row_objects.py",
           "bump.half_width_m if bump else 0.0", "0.0",
           (f"{UNUSUAL}::test_an_object_at_the_end_of_a_row_is_not_named",)),
    Mutant("what lies at the edge of a map is named", "probe/detection/map/field_objects.py",
           'return one if one.kind == "undecided" else replace(one, kind="undecided"',
           'return one if one.kind else replace(one, kind="undecided"',
           (f"{FIELDS}::test_what_lies_at_the_edge_of_a_map_or_under_an_odd_zero_is_not_named",)),
    Mutant("a level below zero is compared with", "probe/detection/map/field_objects.py",
           "if min(ground, whole) <= 0:", "if min(ground, whole) <= -1e99:",
           (f"{FIELDS}::test_what_lies_at_the_edge_of_a_map_or_under_an_odd_zero_is_not_named",)),
    Mutant("a contrast beyond those of all kinds is the nearest kind's",
           "probe/detection/classify/classifier.py", "BEYOND = 0.01", "BEYOND = 0.0",
           ("tests/probe/detection/test_classifier.py"
            "::test_a_contrast_beyond_all_kinds_is_no_kind_s",)),
    Mutant("averages go by the clock", "probe/detection/pulse/hold_samples.py",
           "if many > 1 and abs(", "if many > 1e9 and abs(",
           (f"{HELD}::test_the_clocks_zero_changes_nothing",
            f"{HELD}::test_jitter_of_the_stamps_puts_as_many_samples_into_each_average")),
    Mutant("missing samples close up", "probe/detection/pulse/hold_samples.py",
           "gaps = np.rint(np.diff(time_s) / each_s)",
           "gaps = np.minimum(np.rint(np.diff(time_s) / each_s), 1)",
           (f"{HELD}::test_missing_samples_are_missing_where_they_were",)),
    Mutant("less than a beat tells a heart's rate", "probe/detection/heart_rate.py",
           "WHOLE_BEAT = 1.2", "WHOLE_BEAT = 0.0",
           ("tests/probe/detection/test_heart_rate.py"
            "::test_holds_of_less_than_a_beat_tell_no_slow_heart_from_a_fast_one",)),
    Mutant("the dry run lets any force pass", "probe/acquisition/preflight.py",
           "if pressed.force_n <= NEAR_LIMIT * limit_n:", "if pressed.force_n <= 1e9 * limit_n:",
           (f"{FORCES}::test_a_press_that_the_force_limit_would_end_is_said",)),
    Mutant("any press is measured as it is solved", "probe/acquisition/preflight.py",
           "sure = _is_measured_as_solved(rig, scene)", "sure = True",
           (f"{FORCES}::test_a_force_that_may_not_be_measured_as_solved_is_a_warning",)),
    Mutant("a press beside the block is made", "probe/config/devices.py",
           "if stage.simulated and (why", "if not stage.simulated and (why",
           ("tests/probe/acquisition/test_dry_run.py",)),
    Mutant("metres pass for millimetres", "probe/acquisition/dry_run.py",
           "if plan.indentation_m < ARRIVED_M:", "if plan.indentation_m < 0:",
           (f"{FORCES}::test_a_press_as_shallow_as_an_arrival_is_warned_of",)),
    Mutant("a narrow bump lies between the places solved", "sim_backend/models/trained_states.py",
           "BUMP_SHARE = 0.25", "BUMP_SHARE = 25.0",
           (f"{FAST}::test_a_bump_narrower_than_the_usual_step_is_known",)),
    Mutant("no state is held back over a bump", "sim_backend/models/trained_states.py",
           "HELD_NEAR = 0.4", "HELD_NEAR = 0.0",
           (f"{FAST}::test_a_bump_between_the_places_is_in_the_stated_error",)),
    Mutant("an oblique vessel takes no more room than a straight one", "sim_backend/scene/room.py",
           "np.sqrt(1 + (leans**2).max(axis=0))", "np.sqrt(1 + 0 * (leans**2).max(axis=0))",
           (f"{ROOM}::test_an_oblique_vessel_needs_room_for_its_cut",)),
    Mutant("between oblique vessels there is room as between straight ones",
           "sim_backend/scene/room.py", "np.sqrt(1 + (ways @ lean) ** 2)",
           "np.sqrt(1 + 0 * (ways @ lean) ** 2)",
           (f"{ROOM}::test_between_oblique_vessels_there_is_room_for_their_cuts",)),
    Mutant("a round block has no least radius", "sim_backend/models/solid_press.py",
           "return half_contact(finger, depth_m)", "return 0.0 * half_contact(finger, depth_m)",
           (f"{SOLID}::test_a_round_finger_over_a_side_or_an_end_is_pressed_as_a_solid",)),
    Mutant("a stenosis ends where it ends, however thin the layer",
           "sim_backend/fem/solid/build.py", "LEAST_LAYER = 0.01", "LEAST_LAYER = 0.0",
           ("tests/sim_backend/fem/solid/test_build.py"
            "::test_no_layer_is_as_thin_as_rounding_leaves_it",)),
)  # fmt: skip
