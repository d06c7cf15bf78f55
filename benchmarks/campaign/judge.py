"""What was wrong with a run, judged by the truth, the run file, the exit status and the words.

A guard can act only on what it was told, so the true force may exceed the limit by the physics of
stopping and no more:

    k (v (2 / rate + wire + blind) + v^2 / 2a) + 5 sigma + what came from outside

with k the stiffness where it happened, v the greatest speed at which tip and bed closed, ``blind``
what the kind of fault allows (`faults`), a the board's acceleration, sigma the cell's noise.
"""

import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from campaign.cell import NOISE_N, RATE_HZ
from campaign.faults import Draw
from campaign.limits import MAX_DEPTH_M, MAX_FORCE_N
from campaign.scanning import Resumed
from campaign.stored import check_stored, kept_finish, words_kept
from campaign.truth import DEPTH, FORCE, MOVING, SIDE, T, Truth, X, Y, Z
from campaign.world import HARDENING_PER_M
from drivers.core.arrays import Array

WIRE_S = 0.02  # two status periods of the board: the answer in hand, and the stop behind it
ACCELERATION_M_S2 = 1.0
POSE_SLACK_M = 0.1e-3
SIDEWAYS_M, SEEN_S = 1e-3, 0.25
STARVED_S = 0.03  # the truth itself stood still for longer: the machine was the fault, not the scan
STATUSES = (0, 3, 5)
HUNG, KILLED, BUG, ABORTED = None, 137, 70, 5
STAYS = {"SIGINT", "SIGINT to the group", "ctrl-c typed"}
"""A Ctrl-C after any other order to end leaves the probe where it is, in words."""
ASKED = STAYS | {"stop", "SIGINT storm"}
NEVER_BEGAN = "the process that guards did not come up"


@dataclass(frozen=True)
class Verdict:
    """Figures of a run and what was wrong with it; ``void``: the machine was too busy to tell."""

    wrong: tuple[str, ...]
    void: bool
    status: int | None
    finish: str
    up: bool
    force_n: float
    allowed_n: float
    depth_mm: float
    side_n: float
    rest_s: float
    latency_s: float
    late_s: float

    def as_row(self) -> dict[str, Any]:
        """For a line of JSON."""
        return asdict(self)


def load(path: Path) -> Truth:
    """Read what the truth wrote."""
    with np.load(path) as file:
        return Truth(
            *(file[key] for key in ("rows", "lines", "stops", "jogs", "struck")),
            float(file["late_s"]),
        )


def judge(
    draw: Draw,
    truth: Truth,
    *,
    status: int | None,
    answer: dict[str, Any] | None,
    said: str,
    run: Path | None,
    second: int | None = None,
    resumed: Resumed | None = None,
) -> Verdict:
    """Everything that was wrong, with figures."""
    wrong: list[str] = []
    finish = str((answer or {}).get("finish", "none"))
    allowed_n = _allowed_force(draw, truth)
    force_n = float(truth.rows[:, FORCE].max())
    if force_n > allowed_n:
        wrong.append(f"force {force_n:.2f} N, allowed {allowed_n:.2f} N")
    wrong += _check_depth(draw, truth)
    seen = draw.arm and "mm from where it was" in said  # an arm at rest is not stopped once more
    wrong += [] if seen else _check_sideways(draw, truth)
    up = _up(truth)
    if NEVER_BEGAN in said:
        wrong.append("the scan never began")
    wrong += _check_end(draw, truth, up, status, f"{said} {words_kept(run)}")
    wrong += _check_words(draw, truth, status, finish, said, answer)
    if second is not None and second == 0:
        wrong.append("a second program drove the same board")
    if resumed is not None:
        wrong += _check_resumed(resumed, up)
    if run is not None and "replaced" not in draw.name:
        wrong += check_stored(draw, truth, run)
    once = len(draw.faults) == 1 and "storm" not in draw.name  # a second order ends the answer too
    if once and status == ABORTED and finish == "none" and kept_finish(run) == "aborted":
        wrong.append("the run was aborted, and the answer does not say so")
    void = truth.late_s > STARVED_S or starved(draw, said)
    return Verdict(
        tuple(wrong), void, status, finish, up, force_n, allowed_n,
        1e3 * float(-truth.rows[:, Z].min()), float(truth.rows[:, SIDE].max()),
        _rest_s(truth), _latency_s(truth, draw.zero_n), truth.late_s,
    )  # fmt: skip


def starved(draw: Draw, said: str) -> bool:
    """The machine's disk stood still though no fault made it."""
    return "has not taken anything" in said and not any(
        fault.kind.name in ("run file locked for long", "no space", "no memory")
        for fault in draw.faults
    )


def _closing_m_s(rows: Array) -> float:
    """The greatest speed, over 5 ms, at which tip and bed closed while they touched."""
    depth = np.maximum(rows[:, DEPTH], 0.0)
    step = max(round(5e-3 / max(float(np.median(np.diff(rows[:, T]))), 1e-4)), 1)
    if len(depth) <= step:
        return 0.0
    speed = (depth[step:] - depth[:-step]) / np.maximum(rows[step:, T] - rows[:-step, T], 1e-3)
    return max(float(speed.max()), 0.0)


def _blind_s(draw: Draw) -> float:
    return max((f.kind.blind_s for f in draw.faults if math.isfinite(f.kind.blind_s)), default=0.0)


def _outside_m(draw: Draw) -> float:
    """How far a hand or a cough moves the tip or the bed, against which no stage can act."""
    way = {"cough": 0.03 * 0.12, "pushed deeper": 8e-3 * 0.25}
    return sum(way.get(fault.kind.name, 0.0) for fault in draw.faults)


def _allowed_force(draw: Draw, truth: Truth) -> float:
    rows, bed = truth.rows, draw.bed
    if not all(fault.kind.heard for fault in draw.faults):
        return math.inf
    worst = rows[int(rows[:, FORCE].argmax())]
    depth, v = max(float(worst[DEPTH]), 0.0), _closing_m_s(rows)
    k = bed.factor(float(worst[X])) * (
        bed.stiffness_n_m * (1 + 2 * HARDENING_PER_M * depth) + bed.relaxing_n_m
    )
    over_m = v * (2 / RATE_HZ + WIRE_S + _blind_s(draw)) + v**2 / (2 * ACCELERATION_M_S2)
    lied_n = 0.0
    if any(math.isinf(fault.kind.blind_s) for fault in draw.faults):
        pressed = truth.lines[:, 2] > 0
        lied = truth.lines[pressed, 2] + draw.zero_n - truth.lines[pressed, 1]
        lied_n = max(float(lied.max(initial=0.0)), 0.0)
    return MAX_FORCE_N + k * (over_m + _outside_m(draw)) + 5 * NOISE_N + lied_n


def _check_depth(draw: Draw, truth: Truth) -> list[str]:
    rows = truth.rows
    v = _closing_m_s(rows)
    over_m = v * (0.1 + WIRE_S + _blind_s(draw)) + v**2 / (2 * ACCELERATION_M_S2)
    below_m = float(-rows[:, Z].min())
    if below_m > MAX_DEPTH_M + POSE_SLACK_M + over_m + _outside_m(draw):
        return [f"{1e3 * below_m:.2f} mm below the planned surface"]
    return []


def _check_sideways(draw: Draw, truth: Truth) -> list[str]:
    """Dragged over the skin, the stage must be told to stop soon, if it can be told and its poses
    show the drag: a cell along the press does not feel it."""
    stages = [f.kind for f in draw.faults if f.kind.where in ("board", "arm")]
    if any(not kind.heard or kind.name == "board lies" for kind in stages):
        return []
    rows = truth.rows
    pressed = rows[:, DEPTH] > 0.2e-3
    if not pressed.any():
        return []
    begins = np.flatnonzero(pressed & ~np.roll(pressed, 1))
    start = np.maximum.accumulate(np.where(pressed & ~np.roll(pressed, 1), np.arange(len(rows)), 0))
    way = np.hypot(rows[:, X] - rows[start, X], rows[:, Y] - rows[start, Y])
    off = np.flatnonzero(pressed & (way > SIDEWAYS_M))
    if len(begins) == 0 or len(off) == 0:
        return []
    since_s = rows[off[0], T]
    reported = truth.stops[(truth.stops > since_s - 1.0)]
    blind_s = SEEN_S + _blind_s(draw)
    if (len(reported) and reported[0] < since_s + blind_s) or rows[-1, T] < since_s + blind_s:
        return []
    return [f"dragged {1e3 * way[off].max():.1f} mm over the skin and not stopped"]


def _up(truth: Truth) -> bool:
    """At rest in the air at the end."""
    last = truth.rows[-1]
    return bool(last[DEPTH] < 0 and last[FORCE] == 0 and not last[MOVING])


def _check_end(draw: Draw, truth: Truth, up: bool, status: int | None, said: str) -> list[str]:
    last, wrong = truth.rows[-1], []
    if last[MOVING] and not any(f.kind.name == "board stalled" for f in draw.faults):
        wrong.append("still moving after the end")
    if up:
        return wrong
    must = all(fault.kind.up for fault in draw.faults)
    names = [fault.kind.name for fault in draw.faults]
    stayed = set(names) & STAYS and len(names) > 1 and "as asked" in said
    if must and not stayed:
        wrong.append(f"left {1e3 * last[DEPTH]:.2f} mm deep with {last[FORCE]:.2f} N")
    elif last[DEPTH] > 0 and status != KILLED:
        if "not lifted" not in said.lower():
            wrong.append("left pressed without a word about it")
        elif "as asked" in said and not set(names) & ASKED:
            wrong.append("left pressed as asked, and nobody asked")
    return wrong


def _check_words(
    draw: Draw, truth: Truth, status: int | None, finish: str, said: str,
    answer: dict[str, Any] | None,
) -> list[str]:  # fmt: skip
    names = {fault.kind.name for fault in draw.faults}
    if status is HUNG:
        return ["hangs"]
    if status == KILLED:
        return [] if "SIGKILL" in names else ["killed, by whom?"]
    wrong = [] if answer or "no space" in names else ["no answer"]
    if status == BUG or "Traceback" in said:
        wrong.append(f"a bug, exit {status}: {said.strip()[-200:]}")
    elif status not in STATUSES and not (answer or {}).get("error"):
        wrong.append(f"exit {status}")
    if (status == 0) != (finish == "completed") and finish != "none":
        wrong.append(f"exit {status}, but {finish}")
    if status == 3 and not said.strip() and "terminal closed" not in names:
        wrong.append("a fault without a word")
    if finish == "completed" and _had_to_end(draw, truth):
        wrong.append("completed in spite of the fault")
    return wrong


def _check_resumed(resumed: Resumed, up: bool) -> list[str]:
    """After a kill the run goes on, if it was not complete, and ends with the probe up."""
    wrong = []
    said = " ".join(resumed.said.split())
    tripped = up and resumed.status == 3  # a guard ended the resumed scan, with the probe up
    excused = "stations are complete" in said or tripped
    if resumed.status != 0 and not excused:
        wrong.append(f"cannot be resumed, exit {resumed.status}: {said[-200:]}")
    elif resumed.status == 0 and not up:
        wrong.append("left pressed after the resume")
    if not resumed.kept:
        wrong.append("a complete station was changed by the resume")
    return wrong


def _had_to_end(draw: Draw, truth: Truth) -> bool:
    """A fault that must end the scan struck while a press was still to come or to last."""
    pressed = np.flatnonzero(truth.rows[:, DEPTH] > 0)
    if len(pressed) == 0:
        return False
    last_s = truth.rows[pressed[-1], T]
    return any(
        fault.kind.ends and struck_s + fault.kind.blind_s + 0.15 < last_s
        for fault, struck_s in zip(draw.faults, truth.struck, strict=True)
    )


def _rest_s(truth: Truth) -> float:
    """From the cause to rest; NaN if nothing struck.

    The cause is the last fault, or the force that then broke the limit.
    """
    struck = truth.struck[np.isfinite(truth.struck)]
    if len(struck) == 0:
        return math.nan
    rows, cause_s = truth.rows, float(struck.max())
    over = np.flatnonzero((rows[:, FORCE] > MAX_FORCE_N) & (rows[:, T] > cause_s))
    cause_s = float(rows[over[0], T]) if len(over) else cause_s
    busy = np.flatnonzero((rows[:, MOVING] > 0) | (np.diff(rows[:, Z], prepend=rows[0, Z]) != 0))
    return max(float(rows[busy[-1], T] - cause_s), 0.0) if len(busy) else 0.0


def _latency_s(truth: Truth, zero_n: float) -> float:
    """From the first line over the limit to the first order to stop on the wire; NaN without one.

    Only where no order came before.
    """
    over = truth.lines[:, 1] - zero_n > MAX_FORCE_N
    if not over.any():
        return math.nan
    felt_s = float(truth.lines[over][0, 0])
    later = truth.stops[truth.stops > felt_s]
    before = truth.stops[(truth.stops < felt_s) & (truth.stops > felt_s - 1.0)]
    return float(later[0] - felt_s) if len(later) and len(before) == 0 else math.nan
