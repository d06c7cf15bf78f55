"""Draws the README's picture from four scans of the phantom: `python docs/pictures/make.py`.

Above: the section of TIHA under the finger, coloured by von Mises stress. Below: the pulse along
the surface of the paper's four scenes in tissue, and what was found in each.
"""

import tempfile
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.tri import Triangulation

import palpate
from probe.report.look import BLUE, GREEN, HEAT, INK, PURPLE, VERMILLION

SCENES = {"TI": INK, "TIT": GREEN, "TIHA": VERMILLION, "TISA": BLUE}
OUT = Path(__file__).with_name("phantoms.png")
BELOW = 0.75
"""How far up the intervals are shaded: the legend stands above."""


def draw_section(axes: Axes) -> None:
    """TIHA pressed 2.5 mm deep over its artery, at systole."""
    pressed = palpate.press(palpate.load_scene("TIHA"), 32.0, 2.5, (120.0,))
    picture, state = pressed.solved.picture, pressed.solved.states[0]
    place = 1e3 * (picture.nodes_m + picture.displacement_m(state))
    mesh = Triangulation(place[:, 0], place[:, 1], picture.triangles)
    stress_kpa = 1e-3 * picture.von_mises_pa(state)
    shown = axes.tripcolor(mesh, stress_kpa, cmap=HEAT, shading="gouraud", vmin=0, vmax=30)
    axes.set(aspect="equal", xlim=(8, 56), xlabel="x [mm]", ylabel="y [mm]")
    axes.figure.colorbar(shown, ax=axes, label="von Mises [kPa]", extend="max")
    axes.set_title("TIHA pressed 2.5 mm, 120 mmHg in the artery", loc="left", fontsize=9)


def draw_pulses(axes: Axes, folder: Path) -> None:
    """One scan of each scene; what was found stands in the legend."""
    for name, colour in SCENES.items():
        scanned = palpate.scan(scene=name, out=folder, seed=1)
        found = palpate.detect(scanned.path).as_json()
        x = [one["x_mm"] for one in found["stations"]]
        pulse = [one["pulse_pa"] for one in found["stations"]]
        axes.plot(x, pulse, "o-", ms=3, color=colour, label=f"{name}: {found['finding']}")
        for one in found["objects"]:
            axes.axvspan(*one["position_ci_mm"], ymax=BELOW, color=PURPLE, alpha=0.15, lw=0)
    axes.set(xlabel="x [mm]", ylabel="pulse [Pa]")
    axes.set_title("Pulse at each of 15 stations, and the finding", loc="left", fontsize=9)
    axes.set_yscale("symlog", linthresh=10)
    axes.set(ylim=(0, 20000), yticks=[0, 10, 100, 1000], yticklabels=["0", "10", "100", "1000"])
    axes.legend(frameon=False, fontsize=8, ncols=2, loc="upper left")


def main() -> None:
    """Scan, detect, draw."""
    figure = Figure(figsize=(7.0, 4.6), layout="constrained")
    above, below = figure.subplots(2, 1)
    draw_section(above)
    with tempfile.TemporaryDirectory() as folder:
        draw_pulses(below, Path(folder))
    figure.text(0.995, 0.995, "SIMULATED", fontsize=7, color=VERMILLION, ha="right", va="top")
    figure.savefig(OUT, dpi=160, facecolor="white")


if __name__ == "__main__":
    main()
