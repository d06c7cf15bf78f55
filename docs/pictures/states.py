"""Draws the scan's state machine from the code: `python docs/pictures/states.py`.

Arrows to `stopping` stand as one, from the box of all phases that have it.
"""

from pathlib import Path

from probe.core.events import Phase
from probe.core.states import ALLOWED

OUT = Path(__file__).with_name("states.svg")
AT = {
    Phase.IDLE: (300, 30),
    Phase.CONNECTING: (300, 100),
    Phase.HOMING: (300, 160),
    Phase.TRAVELLING: (300, 220),
    Phase.TARING: (300, 280),
    Phase.APPROACHING: (300, 340),
    Phase.INDENTING: (300, 400),
    Phase.HOLDING: (300, 460),
    Phase.RETRACTING: (300, 520),
    Phase.PAUSED: (480, 370),
    Phase.STOPPING: (90, 520),
    Phase.FINISHED: (300, 620),
}
"""The middle of each box."""
BENT = {
    (Phase.CONNECTING, Phase.TRAVELLING): (1, 40),
    (Phase.CONNECTING, Phase.FINISHED): (-1, 125),
    (Phase.HOMING, Phase.FINISHED): (-1, 95),
    (Phase.RETRACTING, Phase.TRAVELLING): (1, 60),
}
"""Arrows along the middle column: to which side they swing (1 right), and how far."""
WIDE, HIGH = 120, 34
HEAD = """<svg xmlns="http://www.w3.org/2000/svg" width="580" height="650" viewBox="0 0 580 650">
<title>The phases of a scan and which may follow which</title>
<style>
text { font: 15px system-ui, "DejaVu Sans", sans-serif; text-anchor: middle; fill: #1b1f24; }
rect { fill: #f4f6f8; stroke: #57606a; }
rect.running { fill: none; stroke-dasharray: 5 4; }
path { fill: none; stroke: #57606a; stroke-width: 1.5; marker-end: url(#tip); }
marker path { fill: #57606a; stroke: none; marker-end: none; }
@media (prefers-color-scheme: dark) { text { fill: #e6edf3; } rect { fill: #262d35; } }
</style>
<defs><marker id="tip" viewBox="0 0 8 8" refX="8" refY="4" markerWidth="8" markerHeight="8"
 orient="auto"><path d="M0 0 8 4 0 8z"/></marker></defs>"""


def arrow(now: Phase, then: Phase) -> str:
    """From the edge of one box to the edge of the other."""
    (x, y), (to_x, to_y) = AT[now], AT[then]
    if (now, then) in BENT:
        side, swing = BENT[now, then]
        x, to_x = x + side * WIDE / 2, to_x + side * WIDE / 2
        out = side * swing
        return f'<path d="M{x:g} {y} C{x + out:g} {y} {to_x + out:g} {to_y} {to_x:g} {to_y}"/>'
    if x == to_x:  # the next box below
        return f'<path d="M{x} {y + HIGH / 2:g} V{to_y - HIGH / 2:g}"/>'
    if y == to_y:
        side = 1 if to_x > x else -1
        return f'<path d="M{x + side * WIDE / 2:g} {y} L{to_x - side * WIDE / 2:g} {to_y}"/>'
    if AT[now][0] == AT[Phase.RETRACTING][0]:  # from the column's side into the bottom or top
        edge = HIGH / 2 if to_y < y else -HIGH / 2
        return f'<path d="M{x + WIDE / 2:g} {y} Q{to_x} {y} {to_x} {to_y + edge:g}"/>'
    out = 30 if now is Phase.PAUSED and to_y > y else 0  # beside the arrow that comes up here
    edge = -HIGH / 2 if to_y < y else HIGH / 2
    side = 1 if to_x < x else -1
    return (
        f'<path d="M{x + out} {y + edge:g} Q{x + out} {to_y} {to_x + side * WIDE / 2:g} {to_y}"/>'
    )


def box(phase: Phase) -> str:
    """A phase with its name."""
    x, y = AT[phase]
    return (
        f'<rect x="{x - WIDE / 2:g}" y="{y - HIGH / 2:g}" width="{WIDE}" height="{HIGH}" rx="8"/>'
        f'<text x="{x}" y="{y + 5}">{phase.value}</text>'
    )


def drawing() -> str:
    """The picture as SVG."""
    running = [AT[phase] for phase, after in ALLOWED.items() if Phase.STOPPING in after]
    left, right = min(x for x, _ in running) - 70, max(x for x, _ in running) + 90
    top, bottom = min(y for _, y in running) - 27, max(y for _, y in running) + 27
    stopping_x, stopping_y = AT[Phase.STOPPING]
    parts = [
        HEAD,
        f'<rect class="running" x="{left}" y="{top}" width="{right - left}" '
        f'height="{bottom - top}" rx="12"/>',
        f'<path d="M{left} 340 Q{stopping_x} 340 {stopping_x} {stopping_y - HIGH / 2:g}"/>',
        *(
            arrow(now, then)
            for now, after in ALLOWED.items()
            for then in after
            if then is not Phase.STOPPING
        ),
        *map(box, ALLOWED),
    ]
    return "\n".join([*parts, "</svg>\n"])


if __name__ == "__main__":
    OUT.write_text(drawing(), encoding="utf-8")
