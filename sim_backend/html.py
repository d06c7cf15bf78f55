"""What notebooks show of a result: a table and a small picture, as HTML that needs nothing else."""

from collections.abc import Iterable, Mapping, Sequence
from html import escape as escape
from math import isfinite

WIDTH, HEIGHT, MARGIN = 420, 160, 34
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7")  # Okabe & Ito 2008


def table(rows: Iterable[Sequence[object]], head: Sequence[str] = ()) -> str:
    """Rows of cells as a table; every cell is escaped."""
    top = "".join(f"<th scope='col'>{escape(name)}</th>" for name in head)
    body = "".join(
        "<tr>" + "".join(f"<td>{escape(str(cell))}</td>" for cell in row) + "</tr>" for row in rows
    )
    return f"<table>{f'<tr>{top}</tr>' if top else ''}{body}</table>"


def lines(
    x: Sequence[float], series: Mapping[str, Sequence[float]], x_name: str, y_name: str
) -> str:
    """Curves over ``x`` with the extremes of both axes written beside them; empty if no number."""
    finite = [v for ys in series.values() for v in ys if isfinite(v)]
    if not finite or not any(isfinite(v) for v in x):
        return ""
    left, right = _span([v for v in x if isfinite(v)])
    low, high = _span(finite)

    def at(xv: float, yv: float) -> str:
        across = MARGIN + (WIDTH - 2 * MARGIN) * (xv - left) / (right - left)
        down = HEIGHT - MARGIN - (HEIGHT - 2 * MARGIN) * (yv - low) / (high - low)
        return f"{across:.1f},{down:.1f}"

    drawn = []
    for (name, ys), colour in zip(series.items(), COLOURS, strict=False):
        points = [at(a, b) for a, b in zip(x, ys, strict=True) if isfinite(a) and isfinite(b)]
        drawn.append(
            f'<polyline fill="none" stroke="{colour}" stroke-width="2" points="{" ".join(points)}">'
            f"<title>{escape(name)}</title></polyline>"
        )
        drawn += [
            f'<circle r="3" fill="{colour}" cx="{p.split(",")[0]}" cy="{p.split(",")[1]}"/>'
            for p in points
        ]
    words = [
        (MARGIN, HEIGHT - MARGIN + 14, "start", f"{left:g}"),
        (WIDTH - MARGIN, HEIGHT - MARGIN + 14, "end", f"{right:g}"),
        (WIDTH / 2, HEIGHT - 6, "middle", x_name),
        (MARGIN, MARGIN - 6, "start", f"{high:.4g} {y_name}: {', '.join(series)}"),
        (MARGIN + 4, HEIGHT - MARGIN - 4, "start", f"{low:.4g}"),
    ]
    return _svg("".join(drawn) + "".join(_word(*word) for word in words))


def over_places(
    x: Sequence[float], y: Sequence[float], series: Mapping[str, Sequence[float]], unit: str
) -> str:
    """``series`` over places in mm: curves along x of a row, a map each where y differs too."""
    several = len({round(v, 3) for v in y if isfinite(v)}) > 1
    if not several:
        return "".join(lines(x, {name: values}, "x mm", unit) for name, values in series.items())
    return "".join(_map(x, y, values, f"{unit}: {name}") for name, values in series.items())


def _map(x: Sequence[float], y: Sequence[float], values: Sequence[float], title: str) -> str:
    """A square at each place, the darker the larger its value; y goes up."""
    places = [(a, b, v) for a, b, v in zip(x, y, values, strict=True) if isfinite(a + b + v)]
    if not places:
        return ""
    (left, right), (low, high) = _span([a for a, _, _ in places]), _span([b for _, b, _ in places])
    least, most = _span([v for _, _, v in places])
    columns = len({round(a, 3) for a, _, _ in places})
    rows = len({round(b, 3) for _, b, _ in places})
    side = min((WIDTH - 2 * MARGIN) / columns, 2 * HEIGHT / rows)
    tall = side * (rows - 1)
    drawn = []
    for a, b, v in places:
        across = MARGIN + side * (columns - 1) * (a - left) / (right - left)
        down = MARGIN + tall * (high - b) / (high - low)
        drawn.append(
            f'<rect x="{across:.1f}" y="{down:.1f}" width="{side:.1f}" height="{side:.1f}" '
            f'fill="{COLOURS[0]}" fill-opacity="{0.05 + 0.95 * (v - least) / (most - least):.2f}">'
            f"<title>x {a:g} mm, y {b:g} mm: {v:.4g}</title></rect>"
        )
    bottom = MARGIN + tall + side
    words = [
        (MARGIN, MARGIN - 6, "start", f"{least:.4g} to {most:.4g} {title}, the darker the more"),
        (
            MARGIN,
            bottom + 14,
            "start",
            f"x {left:g} to {right:g} mm, y {low:g} to {high:g} mm (up)",
        ),
    ]
    return _svg("".join(drawn) + "".join(_word(*word) for word in words), bottom + 24)


def section(
    width_mm: float, height_mm: float, circles: Iterable[tuple[float, float, float, str]]
) -> str:
    """A block to scale with ``circles`` (x, depth, radius [mm], what it is)."""
    scale = (WIDTH - 2 * MARGIN) / width_mm
    high = height_mm * scale
    drawn = [
        f'<rect x="{MARGIN}" y="{MARGIN}" width="{width_mm * scale:.1f}" height="{high:.1f}" '
        'fill="#f3d9c9" stroke="#666"/>'
    ]
    for x_mm, depth_mm, radius_mm, what in circles:
        drawn.append(
            f'<circle cx="{MARGIN + x_mm * scale:.1f}" cy="{MARGIN + depth_mm * scale:.1f}" '
            f'r="{radius_mm * scale:.1f}" fill="#c44" fill-opacity="0.5" stroke="#a22">'
            f"<title>{escape(what)}</title></circle>"
        )
    caption = _word(WIDTH / 2, MARGIN + high + 16, "middle", f"{width_mm:g} x {height_mm:g} mm")
    return _svg("".join(drawn) + caption, MARGIN + high + 24)


def _span(values: Sequence[float]) -> tuple[float, float]:
    low, high = min(values), max(values)
    return (low, high) if high > low else (low - 0.5, high + 0.5)


def _word(x: float, y: float, anchor: str, text: str) -> str:
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" font-size="11" text-anchor="{anchor}" '
        f'fill="currentColor">{escape(text)}</text>'
    )


def _svg(inside: str, height: float = HEIGHT) -> str:
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{height:.0f}" '
        f'viewBox="0 0 {WIDTH} {height:.0f}" role="img">{inside}</svg>'
    )
