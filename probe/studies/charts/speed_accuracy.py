"""Error against time: every model, element and mesh, and CalculiX and FElupe where installed.

One press of TIHA at two pressures. Errors are those of the force and of the pulse against a
converged finite-strain solution (six-node triangles, a third of the finest size charted). Times are
the processor's, with those of programs that are started, since other work on the machine makes the
clock's longer.
"""

import resource
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np

from drivers.core.extras import needs
from probe.studies.charts.cells import ELEMENTS
from probe.studies.charts.kept_rows import kept_rows
from probe.studies.charts.peers import felupe_forces, has_felupe
from sim_backend.fem.finite_strain import solve_finite
from sim_backend.fem.io.deck import ccx_forces_n_per_mm, write_deck
from sim_backend.fem.io.slab import exported_section
from sim_backend.fem.newton import CannotSolve
from sim_backend.fem.small_strain import solve_small
from sim_backend.models.press import press
from sim_backend.scene.scene_file import Scene, load_scene
from sim_backend.scene.waves import PA_PER_MMHG

with needs("data", "palpate chart"):
    import pandas as pd
with needs("report", "palpate chart"):
    from matplotlib.figure import Figure

X_MM, DEPTH_MM, LEVELS_MMHG = 32.0, 2.5, (80.0, 120.0)
SIZES_MM = (2.0, 1.4, 1.0, 0.7, 0.5, 0.35)
REFERENCE_MM = 0.12
ACCURACIES_PCT = (5.0, 2.0, 1.0, 0.5)
NAMES = {
    ("Q4R", "stress"): "CPS4R", ("Q4", "stress"): "CPS4", ("Q8R", "stress"): "CPS8R",
    ("T6", "stress"): "CPS6", ("Q4R", "strain"): "CPE4R", ("Q4M", "strain"): "CPE4 mean dilatation",
    ("Q8R", "strain"): "CPE8R", ("T6", "strain"): "CPE6", ("T6M", "strain"): "CPE6 mixed",
}  # fmt: skip
PEER_SIZES_MM = (1.4, 0.7)
CCX_LIMIT_S = 300
"""Of the processor."""

Answer = tuple[float, float, int]
"""Force at the first level and pulse [N/m], degrees of freedom."""


def chart(
    out: Path,
    scene_name: str = "TIHA",
    repeats: int = 3,
    progress: Callable[[str], None] = print,
    plane: str | None = None,
) -> pd.DataFrame:
    """Run all, write ``speed-accuracy.csv`` and ``.png`` into ``out``; the table.

    ``plane`` overrides the scene's; FElupe is compared in plane strain only.
    """
    scene = load_scene(scene_name)
    if plane is not None:
        scene = scene.model_copy(update={"plane": plane})
    progress("Solving the reference …")
    force, pulse, _ = _ours(scene, "finite", "T6", REFERENCE_MM)
    with kept_rows(out / "speed-accuracy.csv", progress) as rows:
        for solver, element, size_mm, times, solve in _solvers(scene, repeats):
            progress(f"{solver}, {element}" + (f", {size_mm:g} mm" if size_mm else ""))
            row = {"solver": solver, "element": element, "size_mm": size_mm}
            try:
                processor_s, answer = _timed(solve, times)
            except CannotSolve as error:
                rows.append(row | {"reason": str(error)})
                continue
            rows.append(row | {
                "dofs": answer[2], "processor_s": processor_s, "reason": "",
                "force_error_pct": 100 * abs(answer[0] / force - 1),
                "pulse_error_pct": 100 * abs(answer[1] / pulse - 1),
            })  # fmt: skip
    table = pd.DataFrame(rows)
    draw(table, scene_name).savefig(out / "speed-accuracy.png", dpi=150, facecolor="white")
    return table


def _solvers(
    scene: Scene, repeats: int
) -> Iterator[tuple[str, str, float, int, Callable[[], Answer]]]:
    """Solver, element, its size [mm], how often it is timed, and what solves; of those that are
    installed."""
    plane = scene.plane
    for model, element, size in product(("finite", "small"), ELEMENTS[plane], SIZES_MM):
        solve = partial(_ours, scene, model, element, size)
        yield f"{model} strain", NAMES[element, plane], size, repeats, solve
    for pct in ACCURACIES_PCT:
        solver = f"palpate, accuracy {pct:g} %"
        yield solver, "by itself", 0.0, repeats, partial(_by_itself, scene, pct)
    if shutil.which("ccx"):
        for size in PEER_SIZES_MM:
            yield "CalculiX", NAMES["T6", plane], size, 1, partial(calculix, scene, size)
    if plane == "strain" and has_felupe():
        for size in PEER_SIZES_MM:
            yield "FElupe", NAMES["Q4M", plane], size, 1, partial(_felupe, scene, size)


def _timed(solve: Callable[[], Answer], repeats: int) -> tuple[float, Answer]:
    """Median seconds of the processor of ``repeats``, and the answer."""
    taken = []
    answer: Answer = (np.nan, np.nan, 0)
    for _ in range(repeats):
        began_s = spent_s()
        answer = solve()
        taken.append(spent_s() - began_s)
    return float(np.median(taken)), answer


def spent_s() -> float:
    """Seconds of the processor so far, with those of the programs that this one waited for."""
    both = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in both)


def _ours(scene: Scene, model: str, element: str, size_mm: float) -> Answer:
    solve = solve_finite if model == "finite" else solve_small
    levels = [p * PA_PER_MMHG for p in LEVELS_MMHG]
    section, found = solve(scene, 1e-3 * X_MM, 1e-3 * DEPTH_MM, levels, 1e-3 * size_mm, element)
    low, high = (one.force_n_per_m for one in found)
    return low, high - low, len(section.assembly.free)


def _by_itself(scene: Scene, accuracy_pct: float) -> Answer:
    pressed = press(scene, X_MM, DEPTH_MM, LEVELS_MMHG, accuracy_pct=accuracy_pct)
    low, high = (1e3 * state.force_n_per_mm for state in pressed.states)
    return low, high - low, pressed.dofs


def calculix(scene: Scene, size_mm: float) -> Answer:
    """The press by CalculiX on our mesh. Raises `CannotSolve` where it stops."""
    with tempfile.TemporaryDirectory() as folder:
        deck = write_deck(scene, X_MM, DEPTH_MM, LEVELS_MMHG, Path(folder) / "press.inp",
                          size_mm=size_mm)  # fmt: skip
        done = subprocess.run(["ccx", "-i", deck.stem], cwd=folder, capture_output=True,
                              preexec_fn=_limit_processor, check=False)  # fmt: skip
        if done.returncode in (-signal.SIGXCPU, -signal.SIGKILL):
            raise CannotSolve("time", f"CalculiX took over {CCX_LIMIT_S} s of the processor")
        forces = ccx_forces_n_per_mm(deck) if done.returncode == 0 else []
        if len(forces) < 2:
            raise CannotSolve("CalculiX", "CalculiX stopped without an answer")
    section = exported_section(scene, X_MM, DEPTH_MM, size_mm)
    return 1e3 * forces[0], 1e3 * (forces[1] - forces[0]), len(section.assembly.free)


def _limit_processor() -> None:
    """The system ends the process that calls this after `CCX_LIMIT_S` of its own time."""
    resource.setrlimit(resource.RLIMIT_CPU, (CCX_LIMIT_S, CCX_LIMIT_S))


def _felupe(scene: Scene, size_mm: float) -> Answer:
    levels = [p * PA_PER_MMHG for p in LEVELS_MMHG]
    (low, high), dofs = felupe_forces(scene, 1e-3 * X_MM, 1e-3 * DEPTH_MM, levels, 1e-3 * size_mm)
    return low, high - low, dofs


def pareto(table: pd.DataFrame, error: str) -> pd.DataFrame:
    """The rows that no other beats in both time and error, fastest first."""
    solved = table.dropna(subset=[error]).sort_values(["processor_s", error])
    return solved[solved[error] < solved[error].cummin().shift(fill_value=np.inf)]


def draw(table: pd.DataFrame, scene: str) -> Figure:
    """Two panels, force and pulse, log-log."""
    from probe.report.look import BLUE, GREEN, INK, PURPLE, SKY, VERMILLION

    colours = {"finite strain": VERMILLION, "small strain": BLUE, "CalculiX": GREEN,
               "FElupe": SKY}  # fmt: skip
    figure = Figure(figsize=(10, 4.8), layout="constrained")
    panels = figure.subplots(1, 2, sharex=True)
    solved = table[table.reason == ""]
    for axes, quantity in zip(panels, ("force", "pulse"), strict=True):
        error = f"{quantity}_error_pct"
        front = pareto(solved, error)
        axes.step(front.processor_s, front[error], where="post", color=INK, lw=4, alpha=0.3,
                  label="Pareto front: nothing is both faster and more accurate")  # fmt: skip
        for solver, colour in colours.items():
            of_it = solved[solved.solver == solver]
            for element, marker in zip(of_it.element.unique(), "osv^D", strict=False):
                some = of_it[of_it.element == element]
                axes.plot(some.processor_s, some[error], marker + "-", ms=4, lw=0.8,
                          color=colour, alpha=0.85, label=f"{solver}, {element}")  # fmt: skip
        chosen = solved[solved.element == "by itself"]
        asked = ", ".join(f"{one:g}" for one in ACCURACIES_PCT)
        axes.plot(chosen.processor_s, chosen[error], "*", ms=11, color=PURPLE,
                  label=f"palpate press --accuracy {asked}")  # fmt: skip
        axes.set(xscale="log", yscale="log", ylabel=f"error of the {quantity} [%]",
                 xlabel="processor's time of a press at two pressures [s]")  # fmt: skip
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_formatter("{x:g}")
        axes.set_title(f"{scene}: {quantity}", loc="left")
        axes.grid(alpha=0.25)
    figure.legend(*panels[0].get_legend_handles_labels(), frameon=False, fontsize=7, ncols=4,
                  loc="outside lower center")  # fmt: skip
    return figure
