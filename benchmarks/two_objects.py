"""Two bodies 10 to 18 mm from each other: are both found, and do their depths and sizes hold?

    python benchmarks/two_objects.py [SCANS]

Each scan is of a random block with two random lumps or arteries, by the default rig.
"""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from kept import ROOT, Row, exact, fill, read, run

import palpate
from sim_backend.scene.scene_file import Scene

KEPT = ROOT / "docs/results/two-objects.csv"
NEAR_MM = 3.0
ANSWERS = ("bodies", "found", "both", "more", "wrong", "intervals", "held")


def scene(seed: int) -> Scene:
    """A block of 15 to 22 mm with two bodies."""
    rng = np.random.default_rng([seed, 77])
    apart, middle = rng.uniform(10, 18), rng.uniform(26, 38)
    bodies = [_body(rng, middle - apart / 2), _body(rng, middle + apart / 2)]
    file = palpate.load_scene("TIHA").model_dump(exclude_none=True)
    file["tissue"]["height_mm"] = float(rng.uniform(15, 22))
    return Scene.model_validate(file | {"name": "two", "inclusion": bodies})


def _body(rng: np.random.Generator, x_mm: float) -> dict[str, Any]:
    if rng.random() < 0.5:
        return {
            "kind": "tumour", "x_mm": x_mm, "depth_mm": rng.uniform(6, 11), "poisson": 0.49,
            "diameter_mm": rng.uniform(3, 6), "modulus_kpa": rng.uniform(200, 1500),
        }  # fmt: skip
    return {
        "kind": "artery", "x_mm": x_mm, "depth_mm": rng.uniform(7, 11),
        "inner_diameter_mm": rng.uniform(2.5, 4.5), "wall_mm": 0.5,
        "modulus_kpa": rng.uniform(250, 800), "poisson": 0.49,
    }  # fmt: skip


def judged(seed: int, noise_mn: float) -> Row:
    """One scan."""
    block = scene(seed)
    rig = palpate.default_rig(block)
    sensor = rig.sensor[0].model_copy(update={"noise_mn": noise_mn})
    rig = rig.model_copy(update={"sensor": (sensor,)})
    with TemporaryDirectory() as folder:
        ran = palpate.scan(rig, scene=block, seed=seed, out=Path(folder))
        objects = palpate.detect(ran.path).objects
    seen = [[one for one in objects if abs(one.position_mm - body.x_mm) < NEAR_MM]
            for body in block.inclusion]  # fmt: skip
    wrong = [
        one for one in objects if one.kind != "undecided"
        and not any(abs(one.position_mm - b.x_mm) < NEAR_MM + 1 and one.kind == b.kind
                    for b in block.inclusion)
    ]  # fmt: skip
    held: list[bool] = []
    for body, here in zip(block.inclusion, seen, strict=True):
        for one in here:
            across = getattr(body, "diameter_mm", None) or body.inner_diameter_mm  # type: ignore[union-attr]
            for true_mm, ends in (
                (body.depth_mm, one.sizes.depth_ci_m), (across, one.sizes.diameter_ci_m),
            ):  # fmt: skip
                if np.isfinite(ends).all():
                    held.append(ends[0] <= 1e-3 * true_mm <= ends[1])
    return {
        "bodies": " ".join(f"{b.kind}@{b.x_mm:.1f}" for b in block.inclusion),
        "found": " ".join(f"{one.kind.replace(' ', '_')}@{one.position_mm:.1f}" for one in objects),
        "both": int(all(seen)), "more": int(any("more than one" in one.reason for one in objects)),
        "wrong": len(wrong), "intervals": len(held), "held": sum(held),
    }  # fmt: skip


def table(path: Path = KEPT) -> None:
    """How many scans found both, or said that there is more than one."""
    for noise in sorted({r["noise_mn"] for r in read(path)}):
        rows = [r for r in read(path) if r["noise_mn"] == noise]
        known = sum(r["both"] == "1" or r["more"] == "1" for r in rows)
        total = {key: sum(int(r[key]) for r in rows) for key in ("wrong", "intervals", "held")}
        print(
            f"{noise} mN: both or more than one in {known} of {len(rows)}; wrong names "
            f"{total['wrong']}; intervals held {exact(total['held'], total['intervals'])} % of "
            f"{total['intervals']}"
        )


def main(scans: int = 20) -> None:
    """Scan so many blocks, and print the table."""
    jobs = [(seed, noise_mn) for seed in range(scans) for noise_mn in (0.5,)]
    fill(KEPT, ("seed", "noise_mn"), ANSWERS, jobs, judged)
    table()


if __name__ == "__main__":
    run(main)
