"""Physics, detection, calibration, configuration and export: wrong numbers that stop nothing."""

from mutants.mutant import Mutant

MATERIAL, GROUPS = "sim_backend/fem/material.py", "sim_backend/fem/section_pairs.py"
FINGER, PAIRS = "sim_backend/fem/contact/finger_gaps.py", "sim_backend/fem/contact/pairs.py"
NEWTON, LUMEN = "sim_backend/fem/newton.py", "sim_backend/fem/lumen.py"
POOLED, REFERENCE = (
    "probe/detection/pulse/pooled_evidence.py",
    "probe/detection/pulse/reference.py",
)
HELD, LOST, CLASSIFIER = (
    "probe/detection/pulse/hold_samples.py",
    "probe/detection/pulse/lost_samples.py",
    "probe/detection/classify/classifier.py",
)
BUMPS, STRESS = "probe/detection/map/bumps.py", "probe/core/contact_stress.py"
TARE = "calibration/tare.py"
PLAN, SCAN_PLAN = "probe/planning/plan.py", "probe/config/scan_plan.py"
TANGENTS = ("tests/sim_backend/fem/test_tangents.py", "tests/sim_backend/fem/test_balance.py")
LAW = ("tests/sim_backend/fem/test_material.py",)
PULSE, DETECT = ("tests/probe/detection/test_pulse.py",), ("tests/probe/detection/test_detect.py",)
KINDS = ("tests/probe/detection/test_classifier.py",)
TRAINED, FAST_SOLID = (
    "sim_backend/models/trained_states.py",
    (
        "tests/sim_backend/models/test_trained_states.py::"
        "test_between_the_places_solved_force_and_pulse_are_reported",
        "tests/sim_backend/models/test_trained_states.py::test_a_lump_is_felt_where_it_lies",
    ),
)
LIMITS = "probe/detection/pulse/hold_limits.py"
ENDS = ("tests/probe/detection/test_hold_limits.py",)
DROPPED = ("tests/probe/detection/test_lost_samples.py",)
BEATS = ("tests/probe/detection/test_reference.py",)
TRUTH = ("tests/calibration/test_known_truth.py", "tests/calibration/test_applied.py")
SOFT_RIG = ("tests/probe/config/test_calibrated.py"
            "::test_a_soft_rig_is_moved_on_until_the_tip_is_deep_enough",)  # fmt: skip
PLANNED = ("tests/probe/planning/test_plan.py",)
RIG = ("tests/probe/config/test_rig.py",)
STRESSED = ("tests/probe/core/test_stress_conversion.py",)

ELSEWHERE = (
    Mutant("volume is kept by half the bulk modulus", MATERIAL,
           "stress = rigid.stress + (bulk * volume_change)[..., None] * cofactor",
           "stress = rigid.stress + (0.5 * bulk * volume_change)[..., None] * cofactor", LAW),
    Mutant("the thickness does not thin", MATERIAL,
           "thin.by_h * thin.h) / -thin.stiffness", "thin.by_h * thin.h) / thin.stiffness", LAW),
    Mutant("a tangent without its turning pressure", MATERIAL,
           "turning = (bulk * (volume_change - lag))[..., None, None] * _TWIST",
           "turning = 0 * _TWIST", LAW),
    Mutant("a finger's edge is sharp", FINGER,
           "gap = np.where(flat, self.y - points[:, 1], distance - self.radius)",
           "gap = np.where(flat, self.y - points[:, 1], distance)", TANGENTS),
    Mutant("a normal does not turn", FINGER,
           "return gap, normal, np.where(round_part, 1 / safe, 0.0)",
           "return gap, normal, np.zeros_like(safe)", TANGENTS),
    Mutant("a skin is rigid", FINGER, "if finger.skin_m:", "if False:",
           ("tests/sim_backend/fem/test_fingers.py",)),
    Mutant("contact may pull", PAIRS,
           "return (multiplier > complementarity * self.open(multiplier)) | self.bonded",
           "return (np.abs(multiplier) > complementarity * self.open(multiplier)) | self.bonded",
           ("tests/sim_backend/fem/test_balance.py", "tests/sim_backend/fem/test_closed_forms.py")),
    Mutant("lumens close through each other", GROUPS,
           "for walls in section.walls if section.self_contact else ():", "for walls in ():",
           ("tests/sim_backend/fem/test_mesh_transfer.py",)),
    Mutant("neighbours are taken for one", POOLED,
           "chdtrc(2 * len(searches), total", "chdtrc(2, total", PULSE + DETECT),
    Mutant("neighbours' beats are averaged", POOLED,
           "total = np.sum([", "total = np.mean([",
           ("tests/probe/detection/test_pooled_evidence.py",)),
    Mutant("every slope is a beat", REFERENCE,
           "energy[peaks] >= MIN_ENERGY * usual", "energy[peaks] >= 0", BEATS),
    Mutant("an inverted reference stays so", REFERENCE,
           "slope if float((slope**3).sum()) >= 0 else -slope", "slope", BEATS),
    Mutant("beats are found by height", REFERENCE,
           "find_peaks(energy, distance=closest)", "find_peaks(smooth, distance=closest)", BEATS),
    Mutant("spikes are believed", LOST,
           "return np.asarray(np.abs(off) <= SPIKE_SIGMAS * scatter)",
           "return np.ones(len(signal), dtype=bool)", DROPPED),
    Mutant("gaps of one value are readings", HELD, "np.where(stale & ~station.saturated, np.nan,",
           "np.where(stale & False, np.nan,", DROPPED),
    Mutant("a sensor that drops out is believed", HELD,
           "kept[kept] = ~dropped_out(mean[kept])", "pass", DROPPED),
    Mutant("coarse readings are gaps", LOST,
           "far = ~(edge <= SPIKE_SIGMAS *", "far = ~(edge <= 0 *", DROPPED),
    Mutant("held readings are drop-outs", LOST,
           "1.4826 * float(np.median(size[size > 0]))", "1.4826 * float(np.median(size))", DROPPED),
    Mutant("a map is looked at all at once", "probe/detection/map/field.py",
           "AT_ONCE = 1 << 19", "AT_ONCE = 1 << 30",
           ("tests/probe/detection/test_field.py::"
            "test_a_large_map_takes_no_more_memory_than_a_small_one",)),
    Mutant("a negative stiffness is equal", "probe/detection/compare.py",
           "if press.level_pa <= 0:", "if False:", DETECT),
    Mutant("a hold lasts to the middle of the lift", LIMITS,
           "if not len(above) or smooth[-1] >= RAMP_RISE * level:", "if True:", ENDS),
    Mutant("a lift's first step is hold", LIMITS,
           "float(time_s[np.argmax(below)]) if below.any() else end_s", "end_s", ENDS),
    Mutant("a step is a gap", LOST, "<= BACK * size[k]]", "<= 2 * size[k]]", DROPPED),
    Mutant("clipped samples are believed", HELD,
           "kept = inside & whole & ~clipped", "kept = inside & whole", PULSE + DETECT),
    Mutant("a press in the air is contact", HELD,
           "if rise <= CONTACT_SIGMAS * error:", "if rise <= -1e99:",
           ("tests/probe/detection/test_unusual_scans.py",)),
    Mutant("something else is impossible", CLASSIFIER,
           "likelihood[ELSE] = PRIOR[ELSE] * max(density * any_pulse, 1e-300)",
           "likelihood[ELSE] = 0.0", KINDS),
    Mutant("a hold of one value is exact", "probe/detection/pulse/rounding.py",
           "    if not hold.stretches:\n        return hold\n", "    return hold\n",
           ("tests/probe/detection/test_rounding.py"
            "::test_steps_that_no_noise_reaches_over_are_no_pulse_and_hide_one",)),
    Mutant("nothing is impossible", CLASSIFIER,
           "nothing = against_nothing(seen.chance)", "nothing = 0.0", KINDS),
    Mutant("any share names a kind", CLASSIFIER,
           "if kind == best and share[best] >= MIN_POSTERIOR:", "if kind == best:", DETECT),
    Mutant("five stations show a bump", BUMPS,
           "if n < MIN_STATIONS:\n        return Row((), np.full(n, np",
           "if n < 3:\n        return Row((), np.full(n, np",
           ("tests/probe/detection/test_bumps.py",)),
    Mutant("close stations make narrow tissue", "probe/detection/map/bump_fit.py",
           "max(WIDEST * station_m, min(WIDEST_M, WIDEST_SHARE * span_m))", "WIDEST * station_m",
           ("tests/probe/detection/test_bumps.py"
            "::test_an_artery_below_close_stations_is_one",)),
    Mutant("clusters are a row's pitch", "probe/detection/repeats.py",
           "np.cumsum(np.sqrt(longest))", "np.cumsum(np.ones(len(longest)))",
           ("tests/probe/detection/test_repeats.py"
            "::test_neither_clusters_nor_a_hole_are_what_a_row_can_show",)),
    Mutant("a bump has one shape", "probe/detection/map/bump_doubts.py",
           "weight, square = 1.0", "weight, square = 1e12",
           ("tests/probe/detection/test_bumps.py"
            "::test_an_interval_holds_whatever_the_shape_between_far_stations",)),
    Mutant("one explains what two do", BUMPS, "COST_OF_TWO = 4", "COST_OF_TWO = 1e9",
           ("tests/probe/detection/test_bumps.py"
            "::test_two_arteries_near_each_other_are_two_and_one_is_one",)),
    Mutant("two may not be looked for", BUMPS,
           "before, 0.0, count)", "before, 1e9, count)",
           ("tests/probe/detection/test_bumps.py::test_three_that_hide_each_other_are_found_together",)),
    Mutant("one always leaves little enough", BUMPS,
           "if left @ left < cost:", "if left @ left < 100 * cost:",
           ("tests/probe/detection/test_bumps.py"
            "::test_two_arteries_near_each_other_are_two_and_one_is_one",)),
    Mutant("beats are shorter than a block", "probe/detection/pulse/beat_train.py",
           "block = int(p.lengths[0])", "block = int(p.lengths[0]) + 1",
           ("tests/probe/detection/test_beat_train.py",)),
    Mutant("a decay has no doubt of its own", "probe/detection/pulse/fit.py",
           "inverse @ inverse.T - whole[:k, k:] @ taken.T", "inverse @ inverse.T",
           ("tests/probe/detection/test_fit.py",)),
    Mutant("taxels are a face each", STRESS,
           'share = len(columns) if role == "taxel" else 1', "share = 1", STRESSED + DETECT),
    Mutant("units are not looked at", STRESS, "return factor / area_m2", "return 1 / area_m2",
           STRESSED),
    Mutant("a pressure's unit is not looked at", STRESS,
           'if unit == "Pa":\n        return factor', 'if unit == "Pa":\n        return 1.0',
           STRESSED),
    Mutant("a tare does not drift", TARE,
           "return np.asarray(values - self.bias - np.multiply.outer(since, self.drift))",
           "return np.asarray(values - self.bias)", TRUTH),
    Mutant("a tare is good for ever", TARE,
           "return tolerance / worst if worst > 0", "return 1e9 if worst > 0", TRUTH),
    Mutant("a soft rig presses deeper", "probe/core/cut_stations.py",
           "depth = depth - self.compliance_m_per_n", "depth = depth + self.compliance_m_per_n",
           SOFT_RIG),
    Mutant("a soft rig is sent less deep", "probe/acquisition/engine.py",
           "depth = plan.indentation_m + yielded_m", "depth = plan.indentation_m - yielded_m",
           SOFT_RIG),
    Mutant("a steep surface is pressed straight down", "probe/planning/press_direction.py",
           "return (sine * pose.ry, -sine * pose.rx, math.cos(angle))", "return (0.0, 0.0, 1.0)",
           PLANNED),
    Mutant("any slope is pressed", PLAN, "if steep_deg > STEEPEST_DEG:", "if steep_deg > 90:",
           PLANNED),
    Mutant("rows are not run to and fro", PLAN,
           "(i if j % 2 == 0 else columns - 1 - i, j)", "(i, j)", PLANNED),
    Mutant("travel is lower than the surface", PLAN,
           "return max(pose.z for pose", "return min(pose.z for pose", PLANNED),
    Mutant("compliance is not in the depth limit", SCAN_PLAN,
           "max_deflection_m=compliance_m_per_n * rig.safety.max_force_n", "max_deflection_m=0.0",
           ("tests/probe/config/test_calibrated.py", "tests/probe/acquisition/test_engine.py")),
    Mutant("the heart's interval is half as wide", "probe/detection/heart_rate.py",
           "reach = 60 * NORMAL_95", "reach = 30 * NORMAL_95",
           ("tests/probe/detection/test_heart_rate.py",)),
    Mutant("the pulses' ratio is turned over", "probe/detection/compare.py",
           "_ratio(one.size_pa, other.size_pa)", "_ratio(other.size_pa, one.size_pa)",
           ("tests/probe/detection/test_detect.py::"
            "test_compare_names_the_stiffer_with_the_weaker_pulse",)),
    Mutant("a sample of which one taxel is clipped counts", HELD,
           "station.saturated.any(axis=1)", "station.saturated.all(axis=1)", PULSE),
    Mutant("the tool's centre has the moment's deviation", "calibration/gravity.py",
           "np.eye(3) / mass", "np.eye(3)", TRUTH),
    Mutant("depth takes no slope along y", "sim_backend/phantom/phantom.py",
           "math.hypot(1.0, rise, lift)", "math.hypot(1.0, rise)",
           ("tests/sim_backend/phantom/test_phantom.py",)),
    Mutant("an exported y is x", "probe/storage/export.py",
           "columns[name] = last[name]", 'columns[name] = last["x_mm"]',
           ("tests/probe/storage/test_export.py::test_csv",)),
    Mutant("a modulus is fitted to the block's middle", "probe/calibrate/tissue_force.py",
           "0.5 * width_mm if x_mm is None else x_mm", "0.5 * width_mm",
           ("tests/probe/calibrate/test_tissue_force.py",)),
    Mutant("a table in another unit is fitted", "probe/calibrate/fits.py",
           "    check_units(kind, measured)\n", "", ("tests/probe/calibrate/test_units.py",)),
    Mutant("degrees pass for radians", "probe/calibrate/units.py",
           "largest > FULL_TURN_RAD", "largest > 1000 * FULL_TURN_RAD",
           ("tests/probe/calibrate/test_units.py",)),
    Mutant("below what was solved a force stands still", "probe/calibrate/tissue_force.py",
           " + last * np.maximum(depth_m - sunk, 0.0)", "",
           ("tests/probe/calibrate/test_tissue_force.py",)),
    Mutant("a surface above the first reading is taken as it comes", "probe/calibrate/fits.py",
           "reached_m <= KNOWN * deepest_m", "True", ("tests/probe/calibrate/test_units.py",)),
    Mutant("a modulus does not know its model's error", "calibration/tissue.py",
           "    covariance[:moduli, :moduli] += (forward_off / 2) ** 2\n", "", TRUTH),
    Mutant("a round block's error is half of it", "sim_backend/models/solid_press.py",
           "block_pct = 50 *", "block_pct = 25 *",
           ("tests/sim_backend/models/test_solid_press.py",)),
    Mutant("a solid's fast model knows one end", TRAINED,
           "np.asarray(over(left(half - z)) + over(left(half + z))) / 2",
           "np.asarray(over(left(half - z)))", FAST_SOLID),
    Mutant("a lump is no reason for places close to each other", TRAINED,
           "spots = [spot for one in scene.inclusion for spot in _along(one)]", "spots = []",
           FAST_SOLID),
)  # fmt: skip
