"""The same world, faults and judge on simulated time: one process, no ports, exactly repeatable.

What it adds to the wall clock is speed, and that every broken-off run is resumed over a sound world
and must then be complete, with the complete stations' bytes as they were.
"""

import math
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from campaign.board import Board
from campaign.cell import RATE_HZ, Cell
from campaign.faults import Draw
from campaign.judge import judge, starved
from campaign.limits import (
    HOLD_S,
    INDENTATION_M,
    MAX_DEPTH_M,
    MAX_FORCE_N,
    PITCH_M,
    RAMP_S,
    RETRACT_M,
    START_M,
    STATIONS,
)
from campaign.serve import HOME, Presses, due_s
from campaign.stored import complete_bytes
from campaign.strikes import strike
from campaign.truth import Truth
from campaign.world import Bed, World
from drivers import Block, Channel, Clock, DeviceFault, Pose, SimulatedClock
from probe.config.rig import Rig
from probe.config.scan_limits import limits_for
from probe.config.scan_plan import plan_for
from probe.config.snapshot import run_config
from probe.core.events import Finish, RunEnded
from probe.scan.engine import run_scan
from probe.scan.resume import unfinished
from probe.storage.verify import verify
from probe.storage.writer import Store, create_store, reopen_store

RIG = Rig.model_validate(
    {
        "scan": {
            "start_mm": 1e3 * START_M, "pitch_mm": 1e3 * PITCH_M, "stations": STATIONS,
            "indentation_mm": 1e3 * INDENTATION_M, "ramp_s": RAMP_S, "hold_s": HOLD_S,
            "settle_s": 0.15,
        },
        "safety": {
            "max_force_n": MAX_FORCE_N, "max_depth_mm": 1e3 * MAX_DEPTH_M,
            "retract_mm": 1e3 * RETRACT_M,
        },
        "face_mm2": 100.0,
    }
)  # fmt: skip
PLAN = plan_for(RIG)
LIMITS = limits_for(RIG, PLAN)
AFTER_S = 0.5
STATUS_OF = {Finish.COMPLETED: 0, Finish.FAULTED: 3, Finish.ABORTED: 5}


class Bench:
    """The world at the scan's time; every call to a device first lets it catch up."""

    def __init__(self, drawn: Draw, clock: Clock) -> None:
        self.drawn, self.clock = drawn, clock
        self.world = World(drawn.bed, clock.now(), HOME)
        self.board, self.cell = Board(self.world), Cell(self.world, drawn.seed, drawn.zero_n)
        self.struck = [math.nan] * len(drawn.faults)
        self._presses = Presses(self.world)

    def catch_up(self) -> None:
        """Slice by slice, so that a fault strikes at its instant."""
        now = self.clock.now()
        while self.world.time_s < now - 1e-9:
            self.world.advance(min(now, self.world.time_s + 1e-3))
            self._presses.look()
            self.board.due()
            for n, fault in enumerate(self.drawn.faults):
                at_s = due_s(fault, self.board, self._presses)
                if math.isnan(self.struck[n]) and self.world.time_s >= at_s:
                    self.struck[n] = self.world.time_s
                    strike(fault, self.world, self.board, self.cell)

    def truth(self) -> Truth:
        """As `campaign.judge.load` gives it for the wall clock."""
        jogs = np.array([(t, *target, v) for t, target, v in self.board.jogs]).reshape(-1, 5)
        return Truth(
            np.array(self.world.rows).reshape(-1, 8), np.array(self.cell.lines).reshape(-1, 3),
            np.array(self.board.stops), jogs, np.array(self.struck), 0.0,
        )  # fmt: skip


class BenchStage:
    """The board without its protocol; what ails it is what a driver would make of it."""

    name, simulated = "stage", False

    def __init__(self, bench: Bench) -> None:
        self._bench = bench

    def connect(self) -> None: ...

    def pose(self) -> Pose:
        self._answer()
        return Pose(*(self._bench.board.ills.blind or self._bench.world.place))

    def move(self, target: Pose, speed_m_s: float) -> None:
        self._answer()
        board = self._bench.board
        if board.ills.deaf:
            raise DeviceFault(self.name, "no answer to a move")
        if board.world.moving:
            raise DeviceFault(self.name, "still moving; wait or stop before the next move")
        x, y, z = (1e3 * v for v in target[:3])
        board.jog((x, y, z), speed_m_s)

    def moving(self) -> bool:
        self._answer()
        return self._bench.world.moving

    def stop(self) -> None:
        self._bench.catch_up()
        if not self._bench.board.dead:
            self._bench.board.order(b"\x85")

    def close(self) -> None:
        self.stop()

    def _answer(self) -> None:
        self._bench.catch_up()
        board = self._bench.board
        if board.dead:
            raise DeviceFault(self.name, "connection lost")
        if board.world.time_s < board.ills.mute_until_s:
            raise DeviceFault(self.name, "silent")
        if board.alarmed:
            raise DeviceFault(self.name, "alarm")


class BenchSensor:
    """The cell without its line: text becomes numbers as any driver would make them."""

    name, rate_hz = "lines", RATE_HZ
    channels = (Channel("force", "N", "force", full_scale=20.0),)

    def __init__(self, bench: Bench) -> None:
        self._bench = bench
        self._zero, self._recent = 0.0, [0.0]

    def connect(self) -> None: ...
    def start(self) -> None: ...

    def read(self) -> Block:
        self._bench.catch_up()
        cell = self._bench.cell
        said = cell.due().decode()
        if cell.dead:
            raise DeviceFault(self.name, "connection lost")
        samples = []
        for line in said.splitlines():
            stamp, value = line.split()[:2]
            with suppress(ValueError):
                number = float(value)
                if math.isfinite(number):
                    samples.append((1e-3 * float(stamp) + cell.zero_s, number))
        times, raw = np.array([s[0] for s in samples]), np.array([s[1] for s in samples])
        self._recent = [*self._recent, *raw.tolist()][-20:]
        values = (raw - self._zero).reshape(-1, 1)
        return Block(times, values, np.zeros(values.shape, bool))

    def tare(self) -> None:
        self._zero = float(np.mean(self._recent))

    def stop(self) -> None: ...
    def close(self) -> None: ...


def run_draw(drawn: Draw) -> dict[str, Any]:
    """One run on simulated time, and its resumption, as a row."""
    with TemporaryDirectory(prefix="palpate-campaign-") as folder:
        path = Path(folder) / "scan.run"
        clock = SimulatedClock()
        bench = Bench(drawn, clock)
        with create_store(path) as store:
            ended = _scan(bench, store, {})
        clock.sleep_until(clock.now() + AFTER_S)
        bench.catch_up()
        verdict = judge(
            drawn, bench.truth(), status=STATUS_OF[ended.finish],
            answer={"finish": ended.finish.value}, said=ended.reason, run=path,
        )  # fmt: skip
        resumed, changed = _resumed(drawn, path)
    return {
        "kinds": [fault.kind.name for fault in drawn.faults],
        "said": [ended.reason, resumed],
        **verdict.as_row(),
        "void": verdict.void or starved(sound_after(drawn), resumed),
        "wrong": [*verdict.wrong, *changed],
    }


def _scan(bench: Bench, store: Store, left: dict[str, Any]) -> RunEnded:
    return run_scan(
        PLAN,
        BenchStage(bench),
        [BenchSensor(bench)],
        bench.clock,
        store,
        LIMITS,
        config=run_config(RIG, None, PLAN, bench.drawn.seed),
        **left,
    )


def sound_after(drawn: Draw) -> Draw:
    """The world without faults in which a run is resumed."""
    return Draw(drawn.seed + 1, (), Bed(), drawn.serial)


def _resumed(drawn: Draw, path: Path) -> tuple[str, list[str]]:
    """Resume over a sound world: why it ended, and what was wrong; what was complete must keep its
    bytes."""
    left = unfinished(path)
    if not left.missing:
        return "", []
    before = complete_bytes(path)
    sound = sound_after(drawn)
    with reopen_store(path) as store:
        ended = _scan(
            Bench(sound, SimulatedClock(left.start_s)),
            store,
            {"completed": left.completed, "attempts": left.attempts},
        )
    report, wrong = verify(path), []
    whole = ended.finish is Finish.COMPLETED and report.stations_complete == STATIONS
    if not whole and not starved(sound, ended.reason):
        wrong.append(f"not resumable: {ended.reason}")
    after = complete_bytes(path)
    if any(after.get(station) != stored for station, stored in before.items()):
        wrong.append("a complete station was changed by the resume")
    return ended.reason, wrong + [f"verify after resume: {p}" for p in report.problems[:2]]
