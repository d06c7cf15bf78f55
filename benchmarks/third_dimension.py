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

from sim_backend.models.press import CannotSolve, press
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
SCENES: dict[str, tuple[str, dict[str, float], dict[str, float]]] = {
    "TIHA": ("TIHA", {}, {}), "TI": ("TI", {}, {}),
    "TIT": ("TIT", {}, {}), "TISA": ("TISA", {}, {}),
    "TIHA at 6 mm": ("TIHA", {}, {"depth_mm": 6.0}),
    "TIT at 6 mm": ("TIT", {}, {"depth_mm": 6.0}),
    "TIHA in 30 mm": ("TIHA", {"height_mm": 30.0}, {}),
    "TIHA in 20 kPa": ("TIHA", {"modulus_kpa": 20.0}, {}),
}  # fmt: skip
"""What each is made of: a scene of the paper, with another tissue and inclusion."""


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


def made(name: str, finger: str, plane: str) -> Scene:
    """A scene of the table under a finger: a solid, or its section."""
    paper, tissue, inclusion = SCENES[name]
    solid = plane == "solid"
    content = as_scene(f"{paper}-solid" if solid else paper).model_dump(
        mode="json", exclude_none=True
    )
    content["tissue"] |= tissue
    content["inclusion"] = [one | inclusion for one in content.get("inclusion", ())]
    content |= {"indenter": FINGERS[finger] if solid else outline(FINGERS[finger]), "plane": plane}
    return Scene.model_validate(content)


def cell(finger: str, scene: str) -> Row | None:
    """Both presses; None where the finger cannot press so deep."""
    began = process_time()
    solid = made(scene, finger, "solid")
    beats = PRESSURES_MMHG if solid.arteries else PRESSURES_MMHG[:1]
    x_mm = 0.5 * solid.tissue.width_mm if solid.tissue else 0.0
    try:
        real = press(solid, x_mm, DEPTH_MM, beats, accuracy_pct=SOLID_PCT)
    except CannotSolve as limit:
        print(f"{finger}, {scene}: {limit}")
        return None
    seconds = process_time() - began
    row: dict[str, object] = {
        "model": real.model, "unknowns": real.dofs, "seconds": round(seconds, 1),
        "force_n": real.states[0].force_n, "pulse_n": real.pulse_n,
        "error_pct": real.error_estimate_pct, "pulse_error_pct": real.pulse_error_estimate_pct,
    }  # fmt: skip
    for plane in ("stress", "strain"):
        section = press(made(scene, finger, plane), x_mm, DEPTH_MM, beats, accuracy_pct=SECTION_PCT)
        row[f"{plane}_force"] = section.states[0].force_n / real.states[0].force_n
        pulses = section.pulse_n, real.pulse_n
        row[f"{plane}_pulse"] = pulses[0] / pulses[1] if pulses[0] and pulses[1] else None
    return row


ANSWERS = ("model", "unknowns", "seconds", "force_n", "pulse_n", "error_pct", "pulse_error_pct",
           "stress_force", "stress_pulse", "strain_force", "strain_pulse")  # fmt: skip


def in_words(rows: list[dict[str, str]]) -> str:
    """The page's table: a line for each cell."""
    lines = ["| scene | finger | N | mN | " + " | ".join(
        f"{plane}: {what}" for plane in ("stress", "strain")
        for what in ("force", "pulse", "pulse/force")) + " |",
        "|---" * 10 + "|"]  # fmt: skip
    for row in sorted(rows, key=lambda row: (list(SCENES).index(row["scene"]),
                                             list(FINGERS).index(row["finger"]))):  # fmt: skip
        if not row["force_n"]:
            lines.append(f"| {row['scene']} | {row['finger']} | none |" + " |" * 7)
            continue
        pulse_mn = f"{1e3 * float(row['pulse_n']):.3g}" if row["pulse_n"] else ""
        cells = [row["scene"], row["finger"], f"{float(row['force_n']):.3g}", pulse_mn]
        for plane in ("stress", "strain"):
            force = float(row[f"{plane}_force"])
            cells.append(f"{force:.2f}")
            if row[f"{plane}_pulse"]:
                pulse = float(row[f"{plane}_pulse"])
                cells += [f"{pulse:.2f}", f"{pulse / force:.2f}"]
            else:
                cells += ["", ""]
        lines.append("| " + " | ".join(cells) + " |")
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
