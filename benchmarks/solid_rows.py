"""What detection finds in a row over a solid, and in the rows that its plane sections make of it.

    python benchmarks/solid_rows.py [MINUTES]

The scenes and fingers of third_dimension.py, scanned with each scene's default rig; what lies in
them is at 32 mm. Goes on where docs/results/solid-rows.csv ends; a solid's row takes minutes.
"""

import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from time import monotonic

from kept import ROOT, Row, fill, read
from third_dimension import FINGERS, SCENES, made

import palpate
from probe.calibrate.scene_from_measurement import write_scene
from sim_backend.models.press import CannotSolve

OUT = ROOT / "docs" / "results" / "solid-rows.csv"
PLANES = ("solid", "stress", "strain")
ANSWERS = ("found", "confidence", "place_mm", "low_mm", "high_mm")


def judge(scene: str, finger: str, plane: str) -> Row:
    """One row's finding, and its clearest object."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "scene.toml"
        write_scene(made(scene, finger, plane), file)
        rig = palpate.default_rig(palpate.load_scene(file))
        try:
            run = palpate.scan(rig, file, folder, seed=1).path
        except CannotSolve as limit:
            print(f"{scene}, {finger}, {plane}: {limit}")
            return {"found": "not solved"}
        found = palpate.detect(palpate.open_run(run).recording())
    best = max(found.objects, key=lambda one: one.confidence, default=None)
    row: dict[str, object] = {"found": found.finding}
    if best is not None:
        low, high = best.position_ci_m
        row |= {"confidence": f"{best.confidence:.3f}", "place_mm": f"{1e3 * best.position_m:.2f}",
                "low_mm": f"{1e3 * low:.2f}", "high_mm": f"{1e3 * high:.2f}"}  # fmt: skip
    return row


def in_words(rows: list[dict[str, str]]) -> str:
    """The page's table."""
    lines = ["| scene | finger | on the solid | plane stress | plane strain |", "|---" * 5 + "|"]
    said = {(r["scene"], r["finger"], r["plane"]): _said(r) for r in rows}
    for scene in SCENES:
        for finger in FINGERS:
            cells = [said.get((scene, finger, plane), "") for plane in PLANES]
            if all(cells):
                lines.append(f"| {scene} | {finger} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _said(row: dict[str, str]) -> str:
    if not row["place_mm"]:
        return row["found"]
    return f"{row['found']} at {float(row['place_mm']):.1f} mm"


def main(minutes: float) -> None:
    end = monotonic() + 60 * minutes

    def jobs() -> Iterator[tuple[object, ...]]:
        for finger in FINGERS:
            for scene in SCENES:
                for plane in PLANES:
                    if monotonic() < end:
                        yield scene, finger, plane

    fill(OUT, ("scene", "finger", "plane"), ANSWERS, jobs(), judge)
    print(in_words(read(OUT)))


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 60.0)
