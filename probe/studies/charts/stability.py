"""The stability atlas: presses where methods fail, each solved, refused with a reason, or wrong.

A run goes on with the table where the last one ended; a cell that has changed is solved again.
Every answer is compared with an independent one, of another element on another mesh. A cell is
``wrong`` when the two differ by more than `TOLERANCE_PCT` and three times the stated error, also
when the independent one is solved again on elements of half the size, or when what is stated is
not stable; where that finer one is not found, another element is asked. A cell ``hangs`` when the
answer takes more than `LIMIT_S` of the processor. Rows of single elements show where each breaks;
there the independent answer is that of the element that is chosen by itself, and a large error is
``breaks``, not ``wrong``, since nobody is given it.
"""

import signal
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import as_completed
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

from drivers.core.extras import needs
from drivers.core.processes import Workers
from probe.studies.charts.cells import Cell, cells
from probe.studies.charts.kept_rows import kept_rows, rows_of, write_rows
from probe.studies.solve import first_line
from sim_backend.fem.continuation import continuation
from sim_backend.fem.finite_strain import solve_finite
from sim_backend.fem.model import best_element, build_section
from sim_backend.fem.newton import Load, unloaded
from sim_backend.models.press import CannotSolve, press
from sim_backend.scene.scene_file import Scene, SceneError
from sim_backend.scene.waves import PA_PER_MMHG

with needs("data", "palpate chart"):
    import pandas as pd
with needs("report", "palpate chart"):
    from matplotlib.axes import Axes
    from matplotlib.collections import PathCollection
    from matplotlib.colors import LogNorm
    from matplotlib.figure import Figure

TOLERANCE_PCT = 5.0
LIMIT_S = 120.0
SMALL_PULSE = 0.01
"""Pulses below this share of the force are judged against this share: the two meshes differ."""
CHECK_SHARE = {"Q8R": 0.25, "Q4": 0.08, "Q4M": 0.16, "T6": 0.16, "T6M": 0.16}
"""Size of the independent solution's triangles over the finger's half width: each is three
quadrilaterals, and those of four nodes are stiffer."""

COLUMN = 50
"""Rows of cells in a column of the picture."""

Forces = tuple[float, ...]


@dataclass(frozen=True)
class Answer:
    """Forces [N/m] at each level, their stated error, and whether all are stable."""

    forces: Forces
    estimate_pct: float
    stable: bool


def chart(out: Path, quick: bool = False, progress: Callable[[str], None] = print,
          workers: int = 2, chosen: Sequence[Cell] | None = None) -> pd.DataFrame:  # fmt: skip
    """Judge ``chosen`` cells (all, or every fifth if ``quick``) that ``stability.csv`` in ``out``
    does not hold yet, saving after each; draw ``stability.png``; the table."""
    if chosen is None:
        chosen = cells()[:: 5 if quick else 1]
    file = out / "stability.csv"
    place = {cell.key: n for n, cell in enumerate(chosen)}
    begun = [row for row in rows_of(file) if row.get("key") in place]
    known = {row["key"] for row in begun}
    left = [cell for cell in chosen if cell.key not in known]
    if begun:
        progress(f"{len(begun)} of {len(chosen)} cells are in {file}; {len(left)} are to be solved")
    with kept_rows(file, progress, begun) as rows, closing(judged(left, workers)) as more:
        try:
            for row in more:
                rows.append(row)
                rows.sort(key=lambda row: place[row["key"]])
                write_rows(file, rows)
                if len(rows) % 20 == 0:
                    progress(f"{len(rows)} of {len(chosen)} cells")
        finally:
            if rows:
                draw(pd.DataFrame(rows)).savefig(out / "stability.png", dpi=150, facecolor="white")
    return pd.DataFrame(rows)


def judged(left: Sequence[Cell], workers: int) -> Generator[dict[str, Any]]:
    """Rows of the cells that are ``left``, as they come; closed, it begins no more of them."""
    with Workers(workers) as pool:
        for solved in as_completed([pool.submit(judge, cell) for cell in left]):
            yield solved.result()


def judge(cell: Cell) -> dict[str, Any]:
    """One cell's row."""
    row: dict[str, Any] = {
        "family": cell.family, "row": cell.row, "value": cell.value, "how": cell.how,
        "key": cell.key, "verdict": "solved", "error_pct": np.nan, "estimate_pct": np.nan,
        "reason": "", "force_n_per_m": np.nan,
    }  # fmt: skip
    signal.signal(signal.SIGPROF, _too_long)
    began = process_time()
    try:
        scene = Scene.model_validate(cell.scene)
        with _limited():
            answer = _answer(cell, scene)
        row |= {"force_n_per_m": answer.forces[0], "estimate_pct": answer.estimate_pct}
        row |= _checked(cell, scene, answer)
    except (CannotSolve, SceneError, ValueError) as error:
        row |= {"verdict": "refused", "reason": first_line(error)[:200]}
    except TimeoutError:
        row |= {"verdict": "hangs", "reason": f"more than {LIMIT_S:g} s"}
    return row | {"seconds": process_time() - began}


def _answer(cell: Cell, scene: Scene) -> Answer:
    """By what the cell tries."""
    levels = [p * PA_PER_MMHG for p in cell.levels_mmhg]
    x, depth = 1e-3 * cell.x_mm, 1e-3 * cell.depth_mm
    if cell.how in ("auto", "finite", "small"):
        pressed = press(scene, cell.x_mm, cell.depth_mm, cell.levels_mmhg, model=cell.how)
        return Answer(
            tuple(1e3 * s.force_n_per_mm for s in pressed.states), pressed.error_estimate_pct,
            all(s.stable for s in pressed.states),
        )  # fmt: skip
    size = 0.1 * 0.5e-3 * scene.indenter.width_mm_projected
    if cell.how in ("one step", "reversal"):
        section = build_section(scene, x, depth_m=depth, size_m=size)
        down = Load(depth, levels[0])
        path = [down] if cell.how == "one step" else [down, Load(0.0, levels[0]), down]
        solutions = [*continuation(section, unloaded(section), path)][-1:]
    else:
        _, solutions = solve_finite(scene, x, depth, levels, size, cell.how)
    return Answer(tuple(s.force_n_per_m for s in solutions), 1.0, all(s.stable for s in solutions))


def _checked(cell: Cell, scene: Scene, answer: Answer) -> dict[str, Any]:
    """The verdict on an answer."""
    if not np.isfinite(answer.forces).all():
        return {"verdict": "wrong", "reason": "not a number"}
    if not answer.stable:
        return {"verdict": "wrong", "reason": "stated, and not stable"}
    # small strain's own error is shown, not judged: `auto` never takes it where it matters
    shown_only = cell.single_element or cell.how == "small"
    allowed = max(TOLERANCE_PCT, 0.0 if shown_only else 3 * answer.estimate_pct)
    verdict, reason = {"verdict": "solved, unchecked", "error_pct": answer.estimate_pct}, ""
    for element in _others(scene, cell):
        for finer in (1, 2):
            try:
                with _limited():
                    found = _independent(cell, scene, element, finer)
            except (CannotSolve, TimeoutError) as error:
                reason = reason or f"the check by {element}: {error or 'too long'}"[:200]
                break
            difference = _difference_pct(answer.forces, found)
            if difference <= allowed:
                return {"error_pct": difference, "verdict": "solved"}
            verdict = {"error_pct": difference, "verdict": "breaks" if shown_only else "wrong"}
        else:  # a difference on the coarse mesh alone settles nothing: the next one is asked
            return verdict
    return verdict | {"reason": reason}


def _independent(cell: Cell, scene: Scene, element: str, finer: int) -> Forces:
    # what is smaller than the finger, a thin block or a lone vessel, needs finer elements
    half_m = 1e-3 * min(0.5 * scene.indenter.width_mm_projected, 0.5 * scene.surface_mm)
    levels = [p * PA_PER_MMHG for p in cell.levels_mmhg]
    size_m = CHECK_SHARE[element] * half_m / finer
    _, found = solve_finite(scene, 1e-3 * cell.x_mm, 1e-3 * cell.depth_mm, levels, size_m, element)
    return tuple(one.force_n_per_m for one in found)


def _difference_pct(forces: Forces, other: Forces) -> float:
    a, b = np.array(forces), np.array(other)
    largest = float(np.abs(b).max())
    if largest < 1e-9:
        return 100.0 * float(np.abs(a).max() > 1e-6)
    difference = float(np.abs(a - b).max()) / largest
    if len(b) > 1:
        span = max(float(np.ptp(b)), SMALL_PULSE * largest)
        difference = max(difference, float(abs(np.ptp(a) - np.ptp(b))) / span)
    return 100 * difference


def _others(scene: Scene, cell: Cell) -> tuple[str, ...]:
    """Independent elements; the others do not wrinkle where the first does."""
    if cell.single_element and cell.how != best_element(scene):
        return (best_element(scene),)
    if best_element(scene) == "Q4M":
        return "T6M", "T6"
    return ("Q8R", "Q4") if scene.plane == "stress" else ("Q8R", "T6M", "Q4M")


@contextmanager
def _limited() -> Iterator[None]:
    """Raises TimeoutError after `LIMIT_S` of the processor."""
    signal.setitimer(signal.ITIMER_PROF, LIMIT_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)


def _too_long(_signal: int, _frame: object) -> None:
    raise TimeoutError


def draw(table: pd.DataFrame) -> Figure:
    """A strip per row of cells, in columns: colour is the error, signs are refusals."""
    from probe.report.look import INK

    strips = list(table.groupby(["family", "row"], sort=False))
    columns = -(-len(strips) // COLUMN)
    rows = max(-(-len(strips) // columns), 3)
    figure = Figure(figsize=(2 + 6.5 * columns, 0.26 * rows + 1.2), layout="constrained")
    shown = None
    every = np.atleast_1d(figure.subplots(1, columns))
    for n, axes in enumerate(every):
        some = strips[n * rows : (n + 1) * rows]
        shown = _draw_column(axes, some) or shown
        axes.set_yticks(range(len(some)), [f"{family}: {row}" for (family, row), _ in some])
        axes.tick_params(axis="y", labelsize=7)
        axes.set(xticks=[], xlim=(-0.6, 11.6), ylim=(rows - 0.2, -0.8))
        axes.spines[:].set_visible(False)
    figure.suptitle("■ solved (colour: difference from an independent solution)    × refused with "
                    "its physical reason    ○ wrong    △ hangs    □ framed: solved, unchecked",
                    fontsize=10, color=INK)  # fmt: skip
    if shown is not None:
        figure.colorbar(shown, ax=every, label="difference [%]", shrink=0.4, aspect=40)
    return figure


def _draw_column(axes: Axes, strips: Sequence[tuple[Any, pd.DataFrame]]) -> PathCollection | None:
    from probe.report.look import INK, PURPLE

    shown = None
    for y, (_, some) in enumerate(strips):
        x = np.arange(len(some))
        solved = some.verdict.isin(["solved", "breaks", "solved, unchecked"]).to_numpy()
        frames = [PURPLE if v == "solved, unchecked" else "none" for v in some.verdict[solved]]
        shown = axes.scatter(
            x[solved], np.full(solved.sum(), y), c=some.error_pct[solved].clip(1e-2, 100),
            norm=LogNorm(1e-2, 100), cmap="cividis", marker="s", s=110, edgecolors=frames,
        )  # fmt: skip
        for verdict, sign, colour in (("refused", "x", INK), ("wrong", "o", PURPLE),
                                      ("hangs", "^", PURPLE)):  # fmt: skip
            those = (some.verdict == verdict).to_numpy()
            axes.scatter(x[those], np.full(those.sum(), y), marker=sign, color=colour, s=50)
        for at, value in zip(x, some.value, strict=True):
            axes.text(float(at), y + 0.44, value, fontsize=5, ha="center", va="center", color=INK)
    return shown
