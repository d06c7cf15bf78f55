"""Is what a press states true? Random presses from wide ranges, each against a fine solution.

    python benchmarks/random_presses.py [COUNT] [MINUTES] [TABLE.csv]
    python benchmarks/random_presses.py again [TABLE.csv]

Both planes, round and flat fingers of 0.5 to 30 mm, with skins or bonded, blocks of 2 to 25 mm,
inclusions that nearly touch, vessels near the pressure at which they inflate without bound, lone
vessels. The reference keeps everything, at finite strain, on a mesh that is finer everywhere.
Press n is drawn from seed n. Rows are kept as they come, and a run goes on where the last one
stopped, first with presses whose reference had less time than now. ``again`` presses all rows by
the code as it is, against the references that are kept (5 minutes). At the end it says how often
the true errors of force and pulse were within twice, and five times, the stated.
"""

import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from time import monotonic, process_time
from typing import Any

import numpy as np
import pandas as pd

from sim_backend.arrays import Array
from sim_backend.fem.finite_strain import solve_finite
from sim_backend.fem.model import Grading, build_section
from sim_backend.fem.newton import CannotSolve
from sim_backend.models.press import press
from sim_backend.scene.scene_file import Scene, SceneError
from sim_backend.scene.waves import PA_PER_MMHG

TABLE = Path(__file__).parents[1] / "docs" / "pictures" / "random-presses.csv"
LIMIT_S = 60.0
"""Processor time that a press may take."""
FINE_SHARES = (0.3, 0.15, 0.07)
"""Element size over the finger's half width, each mesh the next one's beginning."""
LONE_SHARES = (*FINE_SHARES, 0.045)
"""Of a lone vessel, over its radius where that is less: its mesh follows the size in steps only."""
REFERENCE_LIMIT_S, REFERENCE_NODES = 600.0, 60_000
"""A reference that costs more processor time or memory is not solved."""
NO_REFERENCE = f"no reference in {REFERENCE_LIMIT_S:g} s and {REFERENCE_NODES} nodes"
SMALL_PULSE = 1e-3
"""Pulses below this share of the force are judged against the share, as `press` states."""
BUDGETS_PCT = (0.5, 1.0, 2.0, 5.0)
COLUMNS = (
    "n", "outcome", "kind", "plane", "finger", "width_mm", "height_mm", "depth_mm", "gap_mm",
    "pressures", "budget_pct", "stated_pct", "true_pct", "stated_pulse_pct", "true_pulse_pct",
    "seconds", "dofs", "model", "reference", "said",
)  # fmt: skip


class TooLong(Exception):
    """The processor time allowed was used up."""


@contextmanager
def within(seconds: float) -> Iterator[None]:
    """Raises `TooLong` after so much processor time."""

    def stop(*_: object) -> None:
        raise TooLong

    signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def random_finger(rng: np.random.Generator) -> dict[str, Any]:
    """A finger's table."""
    if rng.random() < 0.6:
        finger: dict[str, Any] = {"shape": "cylinder", "radius_mm": log_uniform(rng, 0.5, 12)}
        half = finger["radius_mm"]
    else:
        width = log_uniform(rng, 1.5, 30)
        finger = {
            "shape": "flat",
            "width_mm": width,
            "edge_radius_mm": width / 2 * rng.uniform(0.15, 0.6),
        }
        half = width / 2
    extra = rng.random()
    if extra < 0.1:
        finger["bonded"] = True
    elif extra < 0.2:
        finger["skin"] = {"thickness_mm": half * rng.uniform(0.05, 0.25), "modulus_kpa": 100.0}
    return finger


def random_inclusion(rng: np.random.Generator, radius: float, nu: float) -> dict[str, Any]:
    """A lump or a vessel of an outer ``radius`` [mm], without its place."""
    modulus = log_uniform(rng, 60, 1500)
    if rng.random() < 0.4:
        return {"kind": "tumour", "diameter_mm": 2 * radius, "modulus_kpa": modulus, "poisson": nu}
    wall = radius * rng.uniform(0.1, 0.4)
    vessel = {
        "kind": "artery", "inner_diameter_mm": 2 * (radius - wall), "wall_mm": wall,
        "modulus_kpa": modulus, "poisson": nu,
    }  # fmt: skip
    if rng.random() < 0.25:
        vessel["stenosis"] = {"fraction": rng.uniform(0.1, 0.5), "modulus_kpa": 10 * modulus}
    return vessel


def random_press(n: int) -> tuple[Scene, float, float, tuple[float, ...], dict[str, Any]]:
    """A scene, x and depth [mm], pressures [mmHg], and what to say of them."""
    rng = np.random.default_rng(n)
    nu = float(rng.choice([0.3, 0.45, 0.49, 0.49, 0.497]))
    height = log_uniform(rng, 2, 25)
    raw: dict[str, Any] = {
        "name": f"random {n}",
        "plane": str(rng.choice(["stress", "strain"])),
        "indenter": random_finger(rng),
    }
    gap = np.nan
    kind = str(rng.choice(["nothing", "one", "pair", "surface", "bottom", "alone"],
                          p=[0.1, 0.4, 0.15, 0.15, 0.1, 0.1]))  # fmt: skip
    largest = min(4.0, 0.4 * height)
    one = random_inclusion(rng, radius := log_uniform(rng, min(0.4, largest / 2), largest), nu)
    x = 32.0
    if kind == "alone":
        vessel = random_inclusion(rng, radius := rng.uniform(1.5, 4), nu)
        while vessel["kind"] != "artery":
            vessel = random_inclusion(rng, radius, nu)
        raw["inclusion"] = [{**vessel, "x_mm": 5.0, "depth_mm": radius}]
        raw["support"] = {"contact": str(rng.choice(["bonded", "frictionless"]))}
        height, x = 2 * radius, 5.0 + radius * float(rng.choice([0.0, 0.005, 0.2]))
    else:
        raw["tissue"] = {"width_mm": 64.0, "height_mm": height,
                         "modulus_kpa": log_uniform(rng, 5, 150), "poisson": nu}  # fmt: skip
        space = height - 2 * radius
        gap = log_uniform(rng, 3e-3, min(0.5, space / 2))
        deep = radius + space * rng.uniform(0.1, 0.9)
        deep = {"surface": radius + gap, "bottom": height - radius - gap}.get(kind, deep)
        both = [{**one, "x_mm": 32.0, "depth_mm": deep}]
        if kind == "pair":
            second = random_inclusion(rng, other := radius * rng.uniform(0.5, 1.0), nu)
            both.append({**second, "x_mm": 32.0 + radius + gap + other, "depth_mm": deep})
        if kind != "nothing":
            raw["inclusion"] = both
        x += float(rng.choice([0.0, rng.uniform(-12, 12)]))
    scene = Scene.model_validate(raw)
    half = scene.indenter.width_mm_projected / 2
    depth = min(half * rng.uniform(0.05, 0.6), height * rng.uniform(0.03, 0.45))
    low = float(rng.choice([0.0, 60.0, 80.0]))
    pressures = (low, low + log_uniform(rng, 20, 150)) if scene.arteries else (0.0,)
    said = {"n": n, "kind": kind, "plane": scene.plane, "finger": scene.indenter.shape,
            "width_mm": 2 * half, "height_mm": height, "depth_mm": depth,
            "gap_mm": gap if kind in ("pair", "surface", "bottom") else np.nan,
            "pressures": " ".join(f"{p:.4g}" for p in pressures)}  # fmt: skip
    return scene, x, depth, pressures, said


def reference(scene: Scene, x_mm: float, depth_mm: float, pressures: tuple[float, ...]) -> Array:
    """Forces [N/mm] with everything kept, on a mesh that is finer everywhere. Raises `TooLong`."""
    half_m = 0.5e-3 * scene.indenter.width_mm_projected
    levels = [p * PA_PER_MMHG for p in pressures]
    solved = None
    shares = FINE_SHARES
    if scene.tissue is None:
        shares, half_m = LONE_SHARES, min(half_m, 1e-3 * scene.inclusion[0].outer_radius_mm)
    for share in shares:
        size_m = share * half_m

        def at_wall(radius_m: float, share: float = share, size_m: float = size_m) -> float:
            return min(max(0.4 * size_m, 0.25 * share * radius_m), 0.8 * share * radius_m)

        grading = Grading(
            0.15 * size_m, at_wall, 0.35, max(share, 0.1) * 1e-3 * scene.surface_mm, 5 * share
        )
        mesh = build_section(scene, 1e-3 * x_mm, depth_m=1e-3 * depth_mm, size_m=size_m,
                             grading=grading).mesh  # fmt: skip
        if len(mesh.nodes) > REFERENCE_NODES:
            raise TooLong
        solved = solve_finite(scene, 1e-3 * x_mm, 1e-3 * depth_mm, levels, size_m,
                              grading=grading, coarser=solved)  # fmt: skip
    assert solved is not None
    return np.array([1e-3 * one.force_n_per_m for one in solved[1]])


def errors_pct(forces: Array, truth: Array) -> tuple[float, float]:
    """Of force and of the span over the pressures."""
    largest = float(np.abs(truth).max())
    force = 100 * float(np.abs(forces - truth).max()) / largest
    span = float(np.ptp(truth))
    pulse = 100 * abs(float(np.ptp(forces)) - span) / max(span, SMALL_PULSE * largest)
    return force, pulse if len(truth) > 1 else np.nan


def judge(n: int, kept: dict[str, Any]) -> dict[str, Any]:
    """Press ``n``'s row; its reference is solved unless the ``kept`` row has it, or why not."""
    scene, x, depth, pressures, row = random_press(n)
    budget = BUDGETS_PCT[n % len(BUDGETS_PCT)]
    row["budget_pct"] = budget
    began = process_time()
    try:
        with within(LIMIT_S):
            found = press(scene, x, depth, pressures, accuracy_pct=budget)
    except (CannotSolve, SceneError) as limit:
        return row | {"outcome": "refused", "said": str(limit), "seconds": process_time() - began}
    except TooLong:
        return row | {"outcome": "too long", "seconds": LIMIT_S}
    except Exception as error:  # noqa: BLE001 - crashes are what this looks for
        return row | {"outcome": "crashed", "said": f"{type(error).__name__}: {error}"}
    row |= {"seconds": process_time() - began, "dofs": found.dofs, "model": found.model,
            "stated_pct": found.force_error_estimate_pct,
            "stated_pulse_pct": found.pulse_error_estimate_pct}  # fmt: skip
    if kept.get("outcome") == "unchecked":
        return row | {key: kept[key] for key in ("outcome", "said")}
    try:
        with within(REFERENCE_LIMIT_S):
            truth = (
                np.array([float(one) for one in kept["reference"].split()])
                if kept.get("reference")
                else reference(scene, x, depth, pressures)
            )
    except TooLong:
        return row | {"outcome": "unchecked", "said": NO_REFERENCE}
    except CannotSolve as error:
        return row | {"outcome": "unchecked", "said": f"{type(error).__name__}: {error}"}
    row["reference"] = " ".join(f"{one:.8g}" for one in truth)
    forces = np.array([state.force_n_per_mm for state in found.states])
    force, pulse = errors_pct(forces, truth)
    return row | {"outcome": "solved", "true_pct": force, "true_pulse_pct": pulse}


def told(table: pd.DataFrame) -> str:
    """How often what was stated holds."""
    outcomes = ", ".join(f"{k} {v}" for k, v in table.outcome.value_counts().items())
    solved = table[table.outcome == "solved"]
    of_force, of_pulse = (
        solved[f"true{of}_pct"] / solved[f"stated{of}_pct"] for of in ("", "_pulse")
    )
    ratio = np.fmax(of_force, of_pulse)
    held = {limit: int((ratio <= limit).sum()) for limit in (2, 5)}
    lines = [
        f"{len(table)} presses: {outcomes}",
        f"true errors within 2 x stated in {held[2]} of {len(solved)}, within 5 x in {held[5]}, "
        f"largest {ratio.max():.1f} x; longest press {table.seconds.max():.0f} s of processor",
    ]
    lines += [
        f"    press {r.n}: {r.kind}, {r.plane}, {r.true_pct:.2g} / {r.true_pulse_pct:.2g} % true, "
        f"{r.stated_pct:.2g} / {r.stated_pulse_pct:.2g} % stated"
        for r in solved[ratio > 2].itertuples()
    ]
    return "\n".join(lines)


def main() -> None:
    """Go on with the table until ``COUNT`` rows or ``MINUTES`` are reached, or judge it again."""
    again = sys.argv[1:2] == ["again"]
    given = sys.argv[2 if again else 1 :]
    path = Path(given.pop()) if given and given[-1].endswith(".csv") else TABLE
    rows = {row["n"]: row for row in read(path)}
    count = len(rows) if again else int(given[0]) if given else 600
    minutes = float(given[1]) if len(given) > 1 else 60.0
    began = monotonic()
    for n in range(count):
        if n in rows and not again and not had_less_time(rows[n]):
            continue
        if monotonic() - began > 60 * minutes:
            break
        found = judge(n, rows[n] if again else {})
        rows[n] = {k: f"{v:.5g}" if isinstance(v, float) else v for k, v in found.items()}
        table = pd.DataFrame([rows[k] for k in sorted(rows)], columns=list(COLUMNS))
        table.to_csv(part := path.with_suffix(".part"), index=False)
        part.replace(path)
    print(told(pd.read_csv(path)))


def read(path: Path) -> list[dict[str, Any]]:
    """The rows so far, as they were written."""
    if not path.exists():
        return []
    table = pd.read_csv(path, dtype=str, keep_default_na=False)
    return [row | {"n": int(row["n"])} for row in table.to_dict("records")]


def had_less_time(row: dict[str, Any]) -> bool:
    """Whether a row has no reference, and more would be spent on it now."""
    before = ("TooLong", "no reference in")
    return str(row["said"]).startswith(before) and row["said"] != NO_REFERENCE


if __name__ == "__main__":
    main()
