"""What was stored, held against what was true and against what the cell sent."""

import math
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from campaign.faults import Draw
from campaign.limits import HOLD_S, INDENTATION_M
from campaign.truth import FORCE, T, Truth, X, Y, Z
from drivers.core.arrays import Array
from probe.core.errors import RunFileError
from probe.core.events import (
    Note,
    Phase,
    PhaseEntered,
    RunEnded,
    RunStarted,
    Samples,
    StationEnded,
    StationStarted,
)
from probe.storage.run import NotBegun, open_run
from probe.storage.verify import verify

RUN_OF = 12  # so many differences in a row are found once only in what the cell sent
DIGIT_N = 2e-5
TIME_OFF_S = 0.03
FORCE_OFF_N, FORCE_OFF = 0.03, 0.05
PLACE_OFF_M, DEPTH_OFF_M = 0.3e-3, 0.15e-3
CELL = "lines"


def check_stored(draw: Draw, truth: Truth, path: Path) -> list[str]:
    """The file is sound, every sample in it is one that was sent, complete stations are true."""
    try:
        report = verify(path)
        events = _first_session(open_run(path).events())
    except NotBegun:
        return []
    except Exception as error:  # noqa: BLE001 - whatever it is, the run cannot be read
        return [f"the run cannot be read: {type(error).__name__}: {error}"]
    locked = "locked" in draw.name  # then the scan could not close the file, and verify says so
    problems = [p for p in report.problems if not (locked and "did not close this file" in p)]
    wrong = [f"verify: {problem}" for problem in problems[:2]]
    time_s, force_n = _samples(events)
    if len(time_s) < 3 * RUN_OF:
        return wrong
    zero_s = _clock_zero(time_s, force_n, truth.lines)
    if zero_s is None:
        if not _spoiled(draw):
            wrong.append("what is stored was never sent")
        return wrong
    wrong += _check_samples(draw, time_s + zero_s, force_n, truth.lines)
    for station in _complete(events):
        wrong += _check_station(truth, station, events, zero_s)
    return wrong


def words_kept(path: Path | None) -> str:
    """Notes and the last words of a run, which are there for those whose terminal is closed."""
    try:
        events = () if path is None else open_run(path).events()
        return " ".join(
            e.words if isinstance(e, Note) else e.reason
            for e in events
            if isinstance(e, Note | RunEnded)
        )
    except RunFileError:  # `check_stored` says why it cannot be read
        return ""


def kept_finish(path: Path | None) -> str:
    """How a run ended, by its file."""
    try:
        events = () if path is None else open_run(path).events()
        ends = [event.finish.value for event in events if isinstance(event, RunEnded)]
    except RunFileError:
        return "unknown"
    return ends[-1] if ends else "none"


def _first_session(events: Iterable[Any]) -> list[Any]:
    """Without what a resume added: its clock and its zeros are others."""
    found: list[Any] = []
    for event in events:
        if isinstance(event, RunStarted) and found:
            break
        found.append(event)
    return found


def _spoiled(draw: Draw) -> bool:
    """The cell repeats itself or jumps in time, so that samples cannot be told apart."""
    return any(f.kind.name in ("cell stuck", "cell clipped", "cell clock back", "cell clock ahead")
               for f in draw.faults)  # fmt: skip


def _samples(events: list[Any]) -> tuple[Array, Array]:
    blocks = [e.block for e in events if isinstance(e, Samples) and e.device == CELL]
    if not blocks:
        return np.empty(0), np.empty(0)
    return (
        np.concatenate([b.time_s for b in blocks]),
        np.concatenate([b.values[:, 0] for b in blocks]),
    )


def _clock_zero(time_s: Array, force_n: Array, lines: Array) -> float | None:
    """What to add to the scan's time for the machine's, found by a run of equal differences."""
    sent = np.diff(lines[:, 1])
    for first in range(0, len(force_n) - RUN_OF - 1, RUN_OF):
        wanted = np.diff(force_n[first : first + RUN_OF + 1])
        if np.ptp(wanted) < 10 * DIGIT_N:
            continue
        windows = np.lib.stride_tricks.sliding_window_view(sent, RUN_OF)
        found = np.flatnonzero((np.abs(windows - wanted) < DIGIT_N).all(axis=1))
        if len(found) == 1:
            return float(lines[found[0], 0] - time_s[first])
    return None


def _check_samples(draw: Draw, at_s: Array, force_n: Array, lines: Array) -> list[str]:
    """Each stored step from sample to sample is one that was sent, at about that time."""
    if _spoiled(draw):
        return []
    near = np.clip(np.searchsorted(lines[:, 0], at_s - TIME_OFF_S), 0, len(lines) - 1)
    steps, strange = np.diff(force_n), 0
    for n, step in enumerate(steps):
        window = lines[near[n] : near[n] + 40, 1]
        if len(window) < 2:
            continue
        if not (np.abs(np.subtract.outer(window, window) - step) < DIGIT_N).any():
            strange += 1
    # a tare shifts all that follow, once a station
    return [f"{strange} stored samples were never sent"] if strange > 4 else []


def _complete(events: list[Any]) -> Iterator[tuple[StationStarted, float, float]]:
    """Complete stations with when their hold began and ended, scan time."""
    started: StationStarted | None = None
    held_s = math.nan
    for event in events:
        if isinstance(event, StationStarted):
            started, held_s = event, math.nan
        elif isinstance(event, PhaseEntered) and event.phase is Phase.HOLDING:
            held_s = event.time_s
        elif isinstance(event, StationEnded) and event.complete and started is not None:
            yield started, held_s, held_s + HOLD_S


def _check_station(
    truth: Truth,
    station: tuple[StationStarted, float, float],
    events: list[Any],
    zero_s: float,
) -> list[str]:
    """A station that is called complete was pressed where it says, as deep, and as hard."""

    begun, from_s, to_s = station
    rows = truth.rows
    held = rows[(rows[:, T] > from_s + zero_s + 0.05) & (rows[:, T] < to_s + zero_s - 0.05)]
    time_s, force_n = _samples(events)
    said = force_n[(time_s > from_s + 0.05) & (time_s < to_s - 0.05)]
    name = f"station {begun.station + 1} is complete, but"
    if len(said) == 0 or len(held) == 0:
        return [f"{name} holds no samples"]
    wrong = []
    off_m = float(np.hypot(held[:, X] - begun.x_m, held[:, Y] - begun.y_m).max())
    if off_m > PLACE_OFF_M:
        wrong.append(f"{name} was {1e3 * off_m:.2f} mm off its place")
    depth_off_m = float(np.abs(-held[:, Z] - INDENTATION_M).max())
    if depth_off_m > DEPTH_OFF_M:
        wrong.append(f"{name} was {1e3 * depth_off_m:.2f} mm off its depth")
    true_n, said_n = float(held[:, FORCE].mean()), float(said.mean())
    reported = any(isinstance(e, Note) and e.level in ("warning", "fault") for e in events)
    if abs(true_n - said_n) > FORCE_OFF_N + FORCE_OFF * true_n and not reported:
        wrong.append(f"{name} says {said_n:.2f} N of true {true_n:.2f} N")
    return wrong


def complete_bytes(path: Path) -> dict[int, bytes]:
    """All samples of each complete station."""
    run = open_run(path)
    events = list(run.events())
    complete = {
        (e.station, e.attempt) for e in events if isinstance(e, StationEnded) and e.complete
    }
    found: dict[int, bytes] = {}
    for event in events:
        key = (getattr(event, "station", None), getattr(event, "attempt", None))
        block = getattr(event, "block", None)
        if block is not None and key in complete:
            found[event.station] = found.get(event.station, b"") + block.values.tobytes()
    return found
