"""One self-contained HTML page: the finding, the figures, every setting and version."""

import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from importlib import resources
from typing import TYPE_CHECKING, Any

from drivers import Channel
from probe.core.finding_words import (
    headline,
    number_words,
    over_rows,
    percent,
    reach,
    simulated_words,
    size_words,
)
from probe.core.finding_words import remarks as said_of
from probe.core.places import has_rows, presses_all
from probe.report.look import BLUE, INK
from sim_backend import html

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Picture:
    """A figure with its file name (no ending) and caption."""

    name: str
    caption: str
    figure: "Figure"


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
    parts.append(_about(config))
    parts.append(f"<p class='finding'>Finding: {escape(headline(finding))}</p>")
    parts += [f"<p>{escape(line)}</p>" for line in said_of(finding)]
    parts.append(_objects(finding["objects"]))
    parts += [f"<p class='bad' role='note'>{escape(text)}</p>" for text in remarks]
    parts.append("<h2>Maps and traces</h2><div class='figures'>")
    parts += [_picture(p) for p in pictures]
    parts.append("</div><h2>Stations</h2>" + _stations(finding["stations"]))
    if steps := finding.get("steps"):
        parts.append("<h2>Steps</h2>" + _steps(steps))
    parts.append("<h2>Channels</h2>" + _channels(channels))
    settings = escape(json.dumps(config, indent=1, default=str))
    parts.append(
        "<h2>Settings and versions</h2>"
        + _table(("what", "version"), list(config.get("versions", {}).items()))
        + f"<details><summary>All settings of the run</summary><pre>{settings}</pre></details>"
    )
    return "\n".join(parts) + "</body></html>\n"


def svg(figure: "Figure") -> str:
    """The figure as inline SVG, its ink and curves in the page's own colours, also in the dark."""
    text = io.StringIO()
    figure.savefig(text, format="svg", transparent=True, metadata={"Date": None})
    drawing = text.getvalue()
    return (
        drawing[drawing.index("<svg") :].replace(INK, "currentColor").replace(BLUE, "var(--curve)")
    )


def _picture(picture: Picture) -> str:
    caption = escape(picture.caption)
    drawing = svg(picture.figure).replace("<svg ", f"<svg role='img' aria-label='{caption}' ", 1)
    return f"<figure>{drawing}<figcaption>{caption}</figcaption></figure>"


def _about(config: Mapping[str, Any]) -> str:
    """Who scanned what, how, and with which devices: what a reader wants to know first."""
    labels, plan, rig = (config.get(key) or {} for key in ("labels", "plan", "rig"))
    at_most = "" if presses_all(config) else "at most "
    deepest = "at most " if plan.get("force_n") else ""
    devices = [
        (rig.get("stage") or {}).get("driver"),
        *(s["driver"] for s in rig.get("sensor", ())),
    ]
    stated = {
        **{str(key): str(value) for key, value in labels.items()},
        "stations": f"{at_most}{len(plan['stations'])}" if plan.get("stations") else "",
        "force": _with_unit(plan.get("force_n"), "N"),
        "depth": deepest + _with_unit(plan.get("indentation_mm"), "mm"),
        "ramp": "" if deepest else _with_unit(plan.get("ramp_s"), "s"),
        "hold": _with_unit(plan.get("hold_s"), "s"),
        "rig": " + ".join(str(driver) for driver in devices if driver),
    }
    words = (f"<b>{escape(key)}</b> {escape(text)}" for key, text in stated.items() if text)
    return f"<p class='about'>{' &middot; '.join(words)}</p>"


def _with_unit(value: float | None, unit: str) -> str:
    return "" if value is None else f"{value:g} {unit}"


def _objects(objects: Sequence[Mapping[str, Any]]) -> str:
    rows = []
    for one in objects:
        place, interval = one.get("position_mm"), one.get("position_ci_mm")
        rows.append(
            (
                one["kind"],
                number_words(place, ".2f"),
                "unknown" if not interval else f"{interval[0]:.2f} to {interval[1]:.2f}",
                _pascal(one["peak_pa"]),
                _pascal(one["pulse_pa"]),
                "–" if one["kind"] == "undecided" else percent(one["confidence"]),
            )
        )
    head = (
        "object",
        "x [mm]",
        "95 % [mm]",
        "stiffer by [Pa]",
        "pulse [Pa]",
        "confidence",
    )
    across = (f"{one['kind']}: {', '.join(parts)}" for one in objects if (parts := over_rows(one)))
    lines = "".join(f"<p>{escape(line)}</p>" for line in across)  # too long for a phone's column
    return _table(head, rows) + lines if rows else ""


def _stations(stations: Sequence[Mapping[str, Any]]) -> str:
    """Counted from 1; with y only where stations differ in it."""
    axes = ("x_mm", "y_mm") if has_rows(s["y_mm"] for s in stations) else ("x_mm",)
    rows = [
        (
            str(s["station"]),
            *(number_words(s[axis], ".2f") for axis in axes),
            *size_words(s),
        )
        for s in stations
    ]
    places = [f"{axis[0]} [mm]" for axis in axes]
    sizes = ("baseline [Pa]", "± 95 %", "pulse [Pa]", "± 95 %")
    return _table(("station", *places, *sizes), rows)


def _steps(steps: Sequence[Mapping[str, Any]]) -> str:
    """The hold-down curve of each station."""
    rows = [
        (
            str(step["station"]),
            number_words(step["depth_mm"], ".2f"),
            number_words(step["force_n"], ".3f"),
            *(
                number_words(None if n is None else 1e3 * n, ".2f")
                for n in (step["pulse_n"], reach(step["pulse_sd_n"]))
            ),
        )
        for step in steps
    ]
    return _table(("station", "depth [mm]", "force [N]", "pulse [mN]", "± 95 %"), rows)


def _channels(channels: Mapping[str, Sequence[Channel]]) -> str:
    rows = [
        (f"{device}.{c.name}", c.unit, c.role, "SIMULATED" if c.simulated else "measured")
        for device, each in channels.items()
        for c in each
    ]
    return _table(("channel", "unit", "role", "source"), rows)


def _pascal(value: float | None) -> str:
    """Whole pascals where there are a hundred or more, else one decimal."""
    return number_words(value, ".0f" if value is not None and abs(value) >= 100 else ".1f")


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A bound and its sign stay in one line."""
    return f"<div class='scroll'>{html.table(rows, head).replace('&lt; ', '&lt;&nbsp;')}</div>"
