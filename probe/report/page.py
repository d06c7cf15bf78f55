"""One self-contained HTML page: the finding, the figures, every setting and version."""

import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from importlib import resources
from typing import Any

from matplotlib.figure import Figure

from drivers import Channel
from probe.report.look import INK, simulated_words


@dataclass(frozen=True)
class Picture:
    """A figure with its file name (no ending) and caption; ``wide`` spans the page."""

    name: str
    caption: str
    figure: Figure
    wide: bool = False


def page(
    title: str,
    finding: Mapping[str, Any],
    pictures: Sequence[Picture],
    config: Mapping[str, Any],
    channels: Mapping[str, Sequence[Channel]],
    remarks: Sequence[str] = (),
) -> str:
    """The page's text. ``finding`` is the JSON of ``palpate detect``; ``remarks`` say what the
    page could not show and why."""
    css = (resources.files("probe.report") / "page.css").read_text(encoding="utf-8")
    simulated = tuple(finding["simulated"])
    parts = [
        "<!doctype html><html lang='en'><head><meta charset='utf-8'>"
        "<meta name='viewport' content='width=device-width, initial-scale=1'>"
        f"<title>{escape(title)}</title><style>{css}</style></head><body>",
        f"<h1>{escape(title)}</h1>",
    ]
    if simulated:
        words = escape(simulated_words(simulated))
        parts.append(f"<p class='simulated' role='note'>{words}</p>")
    if finding["finish"] != "completed":
        parts.append(
            f"<p class='bad' role='note'>This run was {escape(finding['finish'])}: it shows only "
            "the stations that were complete.</p>"
        )
    parts.append(f"<p class='finding'>Finding: {escape(finding['finding'])}</p>")
    parts.append(_objects(finding["objects"]))
    parts += [f"<p class='bad' role='note'>{escape(text)}</p>" for text in remarks]
    parts.append("<h2>Maps and traces</h2><div class='figures'>")
    parts += [_picture(p) for p in pictures]
    parts.append("</div><h2>Stations</h2>" + _stations(finding["stations"]))
    parts.append("<h2>Channels</h2>" + _channels(channels))
    settings = escape(json.dumps(config, indent=1, default=str))
    parts.append(
        "<h2>Settings and versions</h2>"
        + _table(("what", "version"), list(config.get("versions", {}).items()))
        + f"<details><summary>All settings of the run</summary><pre>{settings}</pre></details>"
    )
    return "\n".join(parts) + "</body></html>\n"


def svg(figure: Figure) -> str:
    """The figure as inline SVG, its ink in the page's own text colour (so it follows dark)."""
    text = io.StringIO()
    figure.savefig(text, format="svg", transparent=True, metadata={"Date": None})
    drawing = text.getvalue()
    return drawing[drawing.index("<svg") :].replace(INK, "currentColor")


def _picture(picture: Picture) -> str:
    caption = escape(picture.caption)
    kind = " class='wide'" if picture.wide else ""
    drawing = svg(picture.figure).replace("<svg ", f"<svg role='img' aria-label='{caption}' ", 1)
    return f"<figure{kind}>{drawing}<figcaption>{caption}</figcaption></figure>"


def _objects(objects: Sequence[Mapping[str, Any]]) -> str:
    rows = []
    for one in objects:
        place, interval = one.get("position_mm"), one.get("position_ci_mm")
        rows.append(
            (
                one["kind"],
                "unknown" if place is None else f"{place:.2f}",
                "unknown" if not interval else f"{interval[0]:.2f} to {interval[1]:.2f}",
                _digits(one["peak_pa"]),
                _digits(one["pulse_pa"]),
                _digits(one["confidence"]),
            )
        )
    head = ("object", "x [mm]", "interval [mm]", "peak [Pa]", "pulse [Pa]", "confidence")
    return _table(head, rows) if rows else ""


def _stations(stations: Sequence[Mapping[str, Any]]) -> str:
    rows = [
        (str(n), *(_digits(s[key]) for key in ("x_mm", "baseline_pa", "pulse_pa")))
        for n, s in enumerate(stations)
    ]
    return _table(("station", "x [mm]", "baseline [Pa]", "pulse [Pa]"), rows)


def _channels(channels: Mapping[str, Sequence[Channel]]) -> str:
    rows = [
        (f"{device}.{c.name}", c.unit, c.role, "SIMULATED" if c.simulated else "measured")
        for device, each in channels.items()
        for c in each
    ]
    return _table(("channel", "unit", "role", "source"), rows)


def _digits(value: float | None) -> str:
    return "unknown" if value is None else f"{value:.4g}"


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    top = "".join(f"<th scope='col'>{escape(h)}</th>" for h in head)
    body = "".join(
        "<tr>" + "".join(f"<td>{escape(str(cell))}</td>" for cell in row) + "</tr>" for row in rows
    )
    return f"<div class='scroll'><table><tr>{top}</tr>{body}</table></div>"
