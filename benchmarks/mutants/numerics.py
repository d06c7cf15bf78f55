"""Errors and corners of the finite elements: numbers that are a little wrong."""

from mutants.mutant import Mutant

MATERIAL, LUMEN = "sim_backend/fem/material.py", "sim_backend/fem/lumen.py"
SKIN, REFINE = "sim_backend/fem/contact/elastic_foundation.py", "sim_backend/models/refine.py"
CHOOSE = "sim_backend/models/choose.py"
KERNEL = "sim_backend/fem/kernel"
LAW = ("tests/sim_backend/fem/test_material.py",)
TANGENTS = ("tests/sim_backend/fem/test_tangents.py",)
TINY = ("tests/sim_backend/fem/test_tiny_presses.py",)
RING = ("tests/sim_backend/fem/test_inflated_ring.py",)
AS_COMPILED = ("tests/sim_backend/fem/test_kernel.py::test_cells_and_lumens_of_random_states",)
STABLE = ("tests/sim_backend/fem/test_stability.py",)
FRONTS = ("tests/sim_backend/fem/test_assembly.py",)
FINGERS = ("tests/sim_backend/fem/test_fingers.py",)
REFINED = ("tests/sim_backend/models/test_refine.py",)
PLACE, SCAN = "sim_backend/models/plane_response.py", "sim_backend/models/scan_estimate.py"
SOFT = ("tests/sim_backend/models/test_station_response.py",)
SWEPT = ("tests/sim_backend/models/test_scan_estimate.py",)
CHOSEN = ("tests/sim_backend/models/test_choose.py",)
PASSED = (
    "tests/sim_backend/fem/solid/test_newton.py"
    "::test_a_load_that_is_only_passed_is_solved_roughly_and_changes_no_answer",
)

NUMERICS = (
    Mutant("von Mises by another factor", MATERIAL, "np.sqrt(1.5 * square)", "np.sqrt(square)",
           LAW),
    Mutant("von Mises at another power of the volume", MATERIAL,
           "shear * volume ** (-5 / 3)", "shear * volume ** (-2 / 3)", LAW),
    Mutant("a wedge bends more than its shapes along z", "sim_backend/fem/solid/prism.py",
           "np.stack([zeta - 0.5, -2 * zeta, zeta + 0.5]",
           "np.stack([1.1 * zeta - 0.5, -2.2 * zeta, 1.1 * zeta + 0.5]",
           ("tests/sim_backend/fem/solid/test_convergence.py",)),
    Mutant("several negative pivots count as one", "sim_backend/fem/solid/newton.py",
           "indefinite += solver.negative", "indefinite += solver.negative > 0",
           ("tests/sim_backend/fem/solid/test_newton.py",)),
    Mutant("a third mesh is thought to be as large as it grew before",
           "sim_backend/models/solid_press.py", "GROWTH = (2.7, 1.6)", "GROWTH = (2.7, 2.7)",
           ("tests/sim_backend/models/test_solid_press.py",)),
    Mutant("a leaning finger stands over another place", "sim_backend/fem/solid/finger.py",
           "centre = np.array([x_m + (under + edge) * upright[0],", "centre = np.array([x_m,",
           ("tests/sim_backend/fem/solid/test_finger.py",)),
    Mutant("pressure on the section as it was", LUMEN,
           "thickness, thinner = thinning(f, sides.shear[:, None], sides.bulk[:, None])",
           "thickness, thinner = np.ones(f.shape[:2]), np.zeros_like(f)", AS_COMPILED),
    Mutant("a lumen's force turns with half of its sides", LUMEN,
           "turn = (thickness @ sides.turn)", "turn = (0.5 * thickness @ sides.turn)", AS_COMPILED),
    Mutant("pressure on the section as it was, compiled", f"{KERNEL}/lumen.c",
           "l3 = strain.l3;", "l3 = 1;", RING),
    Mutant("a lumen's force turns with half of its sides, compiled", f"{KERNEL}/lumen.c",
           "(i ? l3 : -l3) * spread[a]", "(i ? 0.5 * l3 : -0.5 * l3) * spread[a]", TANGENTS),
    Mutant("a thickness of the first guess, compiled", f"{KERNEL}/material.h",
           "if (fabs(change) < 1e-8 * root) break;", "break;", TANGENTS),
    Mutant("the pressure does not stiffen, compiled", f"{KERNEL}/material.h",
           "s.scale * s.i1 / 3 - bulk * d->swelling * s.volume;",
           "s.scale * s.i1 / 3 - bulk * d->swelling;", TANGENTS),
    Mutant("a bulk modulus magnifies the rounding of det F - 1", "sim_backend/fem/internal.py",
           "f, swelling = gradient + _AT_REST, area_change(gradient)",
           "f, swelling = gradient + _AT_REST, area_ratio(gradient + _AT_REST) - 1", TINY),
    Mutant("a bulk modulus magnifies the rounding of det F - 1, compiled", f"{KERNEL}/material.h",
           "    d.j = d.f[0] * d.f[3] - d.f[1] * d.f[2];\n",
           "    d.j = d.f[0] * d.f[3] - d.f[1] * d.f[2];\n    d.swelling = d.j - 1;\n", TINY),
    Mutant("what cannot stand is stable", f"{KERNEL}/fronts.c",
           "all->negative += pivot < 0;", "all->negative += 0;", STABLE),
    Mutant("a pivot of zero is divided by", f"{KERNEL}/fronts.c",
           "if (pivot == 0 || !isfinite(pivot)) return 0;", "", FRONTS),
    Mutant("a thickness of the first guess", MATERIAL,
           "root = np.maximum(root - change, 0.5 * root)", "root = 1.0 * root", LAW),
    Mutant("a skin's nodes carry as those of straight sides", SKIN,
           "share[middle] = 2 * whole / 3\n    np.add.at(share, middle - 1, whole / 6)\n"
           "    np.add.at(share, middle + 1, whole / 6)",
           "share[middle] = whole / 2\n    np.add.at(share, middle - 1, whole / 4)\n"
           "    np.add.at(share, middle + 1, whole / 4)", FINGERS),
    Mutant("half of the error is stated", REFINE,
           "error_pct = np.max([left_pct, least_pct, few_pct], axis=0)",
           "error_pct = np.max([left_pct, least_pct, few_pct], axis=0) / 2", REFINED),
    Mutant("a mesh knows a bursting wall as well as any", REFINE,
           "max(abs(pressure * slope - least * below) / _pulse(forces), 1.0)", "1.0", REFINED),
    Mutant("a mesh knows the force of a bursting wall as well as any", REFINE,
           "of_force = pressure * abs(slope)", "of_force = 0.0 * abs(slope)", REFINED),
    Mutant("half of the meshes' change is stated", REFINE,
           "left_pct = changed_pct / (finer**order - 1)",
           "left_pct = changed_pct / 2 / (finer**order - 1)", REFINED),
    Mutant("meshes may agree by chance", REFINE,
           "FLOOR_PCT = np.array([6.0, 20.0])", "FLOOR_PCT = np.array([3.0, 10.0])", REFINED),
    Mutant("a pulse bends everywhere as at the full depth", PLACE,
           "if bend > MUCH * abs(straight):", "if False:", SOFT),
    Mutant("a slope that points far off ends a press", PLACE,
           "        (found,) = continuation(section, state, [load])\n    return found",
           "        raise\n    return found", SOFT),
    Mutant("a wall that nearly bursts is as well known", "sim_backend/models/response.py",
           "np.maximum(np.abs(high - low), np.abs(by_high - by_low))", "np.abs(high - low)", SOFT),
    Mutant("a sweep's pulse is its slope", SCAN,
           "if abs(1 - fall) > MUCH else 1.0", "if False else 1.0", SWEPT),
    Mutant("what is left out is counted once", CHOOSE, "SAFETY = 2.0", "SAFETY = 1.0", CHOSEN),
    Mutant("far inclusions are dropped sooner", CHOOSE,
           "FAR_PCT, FAR_SHARE = 150.0, 0.121", "FAR_PCT, FAR_SHARE = 75.0, 0.121", CHOSEN),
    Mutant("far inclusions are dropped nearer", CHOOSE,
           "FAR_PCT, FAR_SHARE = 150.0, 0.121", "FAR_PCT, FAR_SHARE = 150.0, 0.1", CHOSEN),
    Mutant("inclusions may cost the whole budget", CHOOSE,
           "        if effect_pct > budget_pct / 4:\n            kept, far_pct = scene, 0.0",
           "        if effect_pct > budget_pct:\n            kept, far_pct = scene, 0.0", CHOSEN),
    Mutant("elements of solids are small far away", "sim_backend/fem/solid/build.py",
           "FAR = 1.5", "FAR = 1e9", ("tests/sim_backend/fem/solid/test_build.py"
           "::test_a_thin_wide_block_is_pressed_as_the_axisymmetric_model_does",)),
    Mutant("loads on the way down are solved as closely as answers",
           "sim_backend/fem/solid/newton.py", "ON_THE_WAY = 1e4", "ON_THE_WAY = 1.0", PASSED),
    Mutant("solids' answers are solved as roughly as the way down",
           "sim_backend/fem/solid/newton.py", "left = slack if share + step >= 1.0 else ON_THE_WAY",
           "left = ON_THE_WAY", PASSED),
)  # fmt: skip
