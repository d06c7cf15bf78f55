"""What a plane section makes of a real finger: force and pulse over the solid's, finger by scene.

    python benchmarks/third_dimension.py [MINUTES] [TABLE.csv]

Each cell presses 2 mm deep over the middle of a solid scene, at 80 and 120 mmHg, by the finger as
it is; and the scene's section, in plane stress and in plane strain, by its outline across the
vessel, times its length along it. A run goes on where the last one stopped.
"""

import sys
from collections.abc import Iterator
from pathlib import Path
from time import monotonic, process_time

from kept import ROOT, Row, fill, read

from sim_backend.models.press import press
from sim_backend.scene.scene_file import Scene, as_scene

TABLE = ROOT / "docs" / "pictures" / "third-dimension.csv"
DEPTH_MM, PRESSURES_MMHG = 2.0, (80.0, 120.0)
SOLID_PCT, SECTION_PCT = 5.0, 1.0
"""Accuracy asked for: ratios of half and of twice are to be told apart."""

FINGERS: dict[str, dict[str, object]] = {
    "ball 5": {"shape": "sphere", "radius_mm": 5.0},
    "cylinder 5 x 10 along": {"shape": "cylinder", "radius_mm": 5.0, "length_mm": 10.0,
                              "edge_radius_mm": 1.0, "axis": "along"},
    "ball 8": {"shape": "sphere", "radius_mm": 8.0},
    "cylinder 5 x 20 along": {"shape": "cylinder", "radius_mm": 5.0, "length_mm": 20.0,
                              "edge_radius_mm": 1.0, "axis": "along"},
    "cylinder 5 x 10 across": {"shape": "cylinder", "radius_mm": 5.0, "length_mm": 10.0,
                               "edge_radius_mm": 1.0, "axis": "across"},
    "punch 8": {"shape": "flat", "diameter_mm": 8.0, "edge_radius_mm": 1.0},
}  # fmt: skip
SCENES = ("TIHA", "TI", "TIT", "TISA")


def outline(finger: dict[str, object]) -> dict[str, object]:
    """The finger's section across the vessel, and its length along it."""
    if finger["shape"] == "sphere":
        radius = float(str(finger["radius_mm"]))
        return {"shape": "cylinder", "radius_mm": radius, "length_mm": 2 * radius}
    if finger["shape"] == "flat":
        width = finger["diameter_mm"]
        return {"shape": "flat", "width_mm": width, "edge_radius_mm": finger["edge_radius_mm"],
                "length_mm": width}  # fmt: skip
    if finger["axis"] == "across":
        return {"shape": "flat", "width_mm": finger["length_mm"],
                "edge_radius_mm": finger["edge_radius_mm"],
                "length_mm": 2 * float(str(finger["radius_mm"]))}  # fmt: skip
    return {"shape": "cylinder", "radius_mm": finger["radius_mm"], "length_mm": finger["length_mm"]}


def with_finger(scene: Scene, finger: dict[str, object], plane: str) -> Scene:
    content = scene.model_dump(mode="json", exclude_none=True) | {"indenter": finger}
    return Scene.model_validate(content | {"plane": plane})


def cell(finger: str, scene: str) -> Row:
    began = process_time()
    solid = as_scene(f"{scene}-solid")
    beats = PRESSURES_MMHG if solid.arteries else PRESSURES_MMHG[:1]
    x_mm = 0.5 * solid.tissue.width_mm if solid.tissue else 0.0
    real = press(with_finger(solid, FINGERS[finger], "solid"), x_mm, DEPTH_MM, beats,
                 accuracy_pct=SOLID_PCT)  # fmt: skip
    seconds = process_time() - began
    row: dict[str, object] = {
        "model": real.model, "unknowns": real.dofs, "seconds": round(seconds, 1),
        "force_n": real.states[0].force_n, "pulse_n": real.pulse_n,
        "error_pct": real.error_estimate_pct, "pulse_error_pct": real.pulse_error_estimate_pct,
    }  # fmt: skip
    for plane in ("stress", "strain"):
        flat = with_finger(as_scene(scene), outline(FINGERS[finger]), plane)
        section = press(flat, x_mm, DEPTH_MM, beats, accuracy_pct=SECTION_PCT)
        row[f"{plane}_force"] = section.states[0].force_n / real.states[0].force_n
        pulses = section.pulse_n, real.pulse_n
        row[f"{plane}_pulse"] = pulses[0] / pulses[1] if pulses[0] and pulses[1] else None
    return row


ANSWERS = ("model", "unknowns", "seconds", "force_n", "pulse_n", "error_pct", "pulse_error_pct",
           "stress_force", "stress_pulse", "strain_force", "strain_pulse")  # fmt: skip


def in_words(rows: list[dict[str, str]]) -> str:
    """The page's table: a line for the force of each cell, and one for its pulse."""
    lines = ["| scene | finger | N | plane stress over it | plane strain over it |",
             "|---|---|---|---|---|"]  # fmt: skip
    for row in sorted(rows, key=lambda row: (SCENES.index(row["scene"]),
                                             list(FINGERS).index(row["finger"]))):  # fmt: skip
        for what in ("force", "pulse"):
            if row[f"{what}_n"]:
                ratios = " | ".join(
                    f"{float(row[f'{p}_{what}']):.2f}" for p in ("stress", "strain")
                )
                lines.append(
                    f"| {row['scene']}, {what} | {row['finger']} | {float(row[f'{what}_n']):.3g} "
                    f"| {ratios} |"
                )
    return "\n".join(lines)


def main(minutes: float, table: Path) -> None:
    end = monotonic() + 60 * minutes

    def jobs() -> Iterator[tuple[object, ...]]:
        for scene in SCENES:
            for finger in FINGERS:
                if monotonic() < end:
                    yield finger, scene

    fill(table, ("finger", "scene"), ANSWERS, jobs(), cell)
    print(in_words(read(table)))


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 7.0,
         Path(sys.argv[2]) if len(sys.argv) > 2 else TABLE)  # fmt: skip
