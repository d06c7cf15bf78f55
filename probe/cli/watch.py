"""``palpate watch``: what every channel reads now, in the terminal or in a window."""

import sys
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from probe.cli.arguments import Fallback, SceneName
from probe.cli.errors import FAULT
from probe.cli.say import Json, answer, answer_json, inform, visible
from probe.cli.windows import need_windows

if TYPE_CHECKING:  # commands import what they need when they run
    from probe.checks.watch import Reading

REFRESH_S = 0.2
SAID_EVERY_S = 1.0
"""Where standard output is no terminal, as lines."""


def watch(
    rig: Annotated[Path, typer.Argument(metavar="RIG.toml", help="The rig with the sensors.")],
    scene: SceneName = None,
    fallback: Fallback = None,
    seconds: Annotated[
        float | None, typer.Option(min=0.1, help="End by itself. Without: until Ctrl-C.")
    ] = None,
    window: Annotated[bool, typer.Option("--window", help="In a window, with a tare key.")] = False,
    json: Json = False,
) -> None:
    """Show what every channel of a rig's sensors reads now; nothing is moved, tared or stored.

    Values are means over the last second as the devices give them, without calibration; tared is
    against the first second.
    """
    if window:
        need_windows()
    from drivers import WallClock
    from probe.checks.watch import Watch
    from probe.config.devices import open_sensors
    from probe.scan.session import resolve_rig

    whole, simulated = resolve_rig(rig, scene)
    clock = WallClock()
    with (
        open_sensors(whole, clock, simulated, fallback=fallback) as sensors,
        Watch(sensors, clock) as watched,
    ):
        if window:
            from probe.gui.watch import run_watch

            last = run_watch(watched, str(rig), seconds)
        else:
            last = _in_terminal(watched, clock, seconds, quiet=json)
    if json:
        answer_json({"channels": [_as_json(one) for one in last]})
    for fault in sorted({one.fault for one in last if one.fault}):
        inform(fault)
    raise typer.Exit(FAULT if any(one.fault for one in last) else 0)


def _in_terminal(
    watched: Any, clock: Any, seconds: float | None, *, quiet: bool
) -> "list[Reading]":
    """Until the time is over, Ctrl-C, or every sensor is lost; the last readings."""
    from rich.live import Live

    ends_s = None if seconds is None else clock.now() + seconds
    live = sys.stdout.isatty() and not quiet
    said_s = clock.now()
    widths: list[int] = []
    last: list[Reading] = watched.readings()
    try:
        with Live(auto_refresh=False, transient=False) if live else nullcontext() as screen:
            while ends_s is None or clock.now() < ends_s:
                clock.sleep_until(clock.now() + REFRESH_S)
                last = watched.readings()
                if screen is not None:
                    screen.update(_table(last), refresh=True)
                elif not quiet and clock.now() - said_s >= SAID_EVERY_S:
                    said_s = clock.now()
                    if (said := _say(last, widths)) is None:
                        break
                    widths = said
                if all(one.fault for one in last):
                    break
    except KeyboardInterrupt:  # how it is usually left
        pass
    return last


def _say(readings: "list[Reading]", widths: list[int]) -> list[int] | None:
    """A line per channel, in columns whose heads come first; their ``widths``, empty at first.

    None where nobody reads them any more.
    """
    from probe.checks.watch import HEAD

    rows = [one.row() for one in readings]
    lines = rows if widths else [HEAD, *rows]
    widths = widths or [max(map(len, column)) for column in zip(*lines, strict=True)]
    for name, *cells in lines:
        padded = (cell.rjust(width) for cell, width in zip(cells[:-1], widths[1:], strict=False))
        if not answer("  ".join((name.ljust(widths[0]), *padded, cells[-1])).rstrip()):
            return None
    return widths


def _table(readings: "list[Reading]") -> Any:
    from rich.table import Table
    from rich.text import Text

    from probe.checks.watch import HEAD

    table = Table(*HEAD, box=None)
    for one in readings:
        row = (Text(visible(cell)) for cell in one.row())
        table.add_row(*row, style="bold red" if one.fault or one.clipped else None)
    return table


def _as_json(one: "Reading") -> dict[str, Any]:
    return {
        "sensor": one.sensor,
        "channel": one.channel.name,
        "unit": one.channel.unit,
        "role": one.channel.role,
        "simulated": one.channel.simulated,
        "raw": one.raw,
        "tared": one.tared,
        "noise_rms": one.noise,
        "drift_per_s": one.drift,
        "rate_hz": one.rate_hz,
        "wanted_hz": one.wanted_hz,
        "age_s": one.age_s,
        "lost": one.lost,
        "clipped": one.clipped,
        "fault": one.fault,
    }
