"""One scan struck by one fault, stored in a real run file, checked, resumed and checked again.

What is checked of force and depth does not come from the guards but from the phantom: the truth at
every millisecond. A force guard may be exceeded only by the physics of stopping:

    k (2 v / rate + v^2 / 2a) + 5 sigma

(two samples at the speed v of contact, the way to rest at acceleration a, the sensor's noise),
with k the stiffest thing met. Depth likewise, plus the guard's slack for a jittering pose.
"""

import resource
import sqlite3
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

import numpy as np
from numpy.typing import NDArray

from drivers import Clock, SimulatedClock, WallClock
from probe.control import Control
from probe.describe import run_config
from probe.devices import connect
from probe.engine import run_scan
from probe.events import (
    Event,
    Finish,
    Phase,
    PhaseEntered,
    RunEnded,
    Samples,
    StationEnded,
)
from probe.guards import POSE_SLACK_M
from probe.resume import resume, unfinished
from probe.rig import Rig
from probe.run import NotBegun, open_run
from probe.store import Store, create_store
from probe.verify import verify
from sim_backend.faults import SENSOR_FAULTS, STAGE_FAULTS, FaultySensor, FaultyStage
from sim_backend.phantom import Phantom, Respond
from sim_backend.scene import Scene, load_scene

Array = NDArray[np.float64]

USER_FAULTS = ("abort", "stop", "ctrl-c storm", "pause storm")
WORLD_FAULTS = ("hard lump", "surface higher", "physics fails")
DISK_FAULTS = ("disk full", "file may not grow", "slow disk", "disk hangs")
HOUSE_FAULTS = ("observer fails",)
REAL_TIME_FAULTS = ("clock step", "observer blocks")
KINDS = (
    STAGE_FAULTS + SENSOR_FAULTS + USER_FAULTS + WORLD_FAULTS + DISK_FAULTS + HOUSE_FAULTS
    + REAL_TIME_FAULTS
)  # fmt: skip

STIFFNESS_N_M, HARD = 400.0, 30.0
SENSOR_RATE_HZ, NOISE_N, ACCELERATION = 500.0, 0.5e-3, 1.0
HANG_S = 5.0
BIN_S = 0.02  # ten samples
ALIKE_N = 6 * NOISE_N * (2 / 10) ** 0.5  # six times the noise of the difference of two bins
SEED = 7  # of every scan's noise: one undisturbed run serves all comparisons
RIG = Rig.model_validate(
    {
        "scan": {"start_mm": 24, "stations": 5},
        "safety": {"max_force_n": 1.6, "max_depth_mm": 3.0},
    }
)
SCENE = load_scene("TIHA")
STATIONS = frozenset(range(5))


@dataclass(frozen=True)
class Bed:
    """Springs with a vessel, the analytic answer of the campaign: F = k d + A p d / 2.5 mm."""

    stiffness_n_m: float
    area_m2: float

    def force_n(self, depth_m: Array, pressure_pa: Array) -> Array:
        """Normal force [N], 0 in the air."""
        depth = np.maximum(depth_m, 0.0)
        force: Array = self.stiffness_n_m * depth + self.area_m2 * pressure_pa * depth / 2.5e-3
        return force

    def von_mises_pa(self, depth_m: Array, pressure_pa: Array) -> Array:
        """The force on 1 cm2."""
        return self.force_n(depth_m, pressure_pa) / 1e-4


def bed(_scene: Scene, x_m: float, _depth_m: float) -> Bed:
    """Tissue with an artery at 32 mm."""
    near = float(np.exp(-(((x_m - 0.032) / 0.006) ** 2)))
    return Bed(STIFFNESS_N_M * (1 + 0.1 * near), 2e-6 * near)


@dataclass(frozen=True)
class Outcome:
    """One run: what struck when, how it ended, and what was wrong (empty: nothing).

    ``lag_s`` is the longest that an event waited to be committed; NaN where it is not known.
    """

    kind: str
    at_s: float
    finish: str
    stations: int
    force_n: float
    depth_m: float
    hang_s: float
    lag_s: float
    wrong: tuple[str, ...]


def run_one(seed: int, kind: str) -> Outcome:
    """One scan struck by one fault, then resumed until complete; all drawn from the seed."""
    rng = np.random.default_rng(seed)
    real_time = kind in REAL_TIME_FAULTS
    at_s = float(rng.uniform(0.0, 3.0 if real_time else 13.0))
    path = Path(mkdtemp(prefix="palpate-fault-")) / "scan.run"
    struck = Struck(kind, at_s, rng, path)
    with suppress(ArithmeticError):  # physics fails: re-raised after the stop
        struck.scan(WallClock() if real_time else SimulatedClock())
    wrong = struck.check()
    finish, complete = "not begun", 0
    altered = kind in ("hard lump", "surface higher", "pause storm") or real_time
    try:
        finish = open_run(path).finish or "broken off"
        complete = verify(path).stations_complete
        wrong += check_file(path, struck.told, struck.committed)
        wrong += check_resumed(
            path, unchanged_s=0.0 if altered else at_s, compare=kind != "hard lump"
        )
    except NotBegun:
        if struck.committed:
            wrong.append("what was committed is gone")
    for file in path.parent.iterdir():
        file.unlink()
    path.parent.rmdir()
    return Outcome(
        kind, at_s, finish, complete, struck.force_n, struck.depth_m, struck.hang_s,
        struck.lag_s, tuple(wrong),
    )  # fmt: skip


class Struck:
    """A scan that is struck by a fault of ``kind`` at ``at_s`` of its clock."""

    def __init__(self, kind: str, at_s: float, rng: np.random.Generator, path: Path) -> None:
        self.kind, self.at_s, self.rng, self.path = kind, at_s, rng, path
        self.told: list[Event] = []
        self.committed = 0
        self.force_n = self.depth_m = self.hang_s = self.lag_s = 0.0
        self._phantom: Phantom | None = None
        self._control = Control()
        self._heard_s = time.perf_counter()
        self._begun = False
        self._pauses = 0
        self._over = threading.Event()

    def scan(self, clock: Clock) -> None:
        """Scan until the end, whatever it is."""
        kind, at_s = self.kind, self.at_s
        if kind == "clock step":
            clock = SteppingClock(at_s, float(self.rng.choice([-1, 1]) * self.rng.uniform(0.3, 3)))
        respond = self._respond(clock)
        opened = connect(RIG, clock, SCENE, seed=SEED, respond=respond)
        self._phantom = opened.phantom
        assert self._phantom is not None
        if kind == "surface higher":
            self._phantom.surface = lambda x, _y: 1.2e-3 if x > 27e-3 else 0.0
        store = create_store(self.path)
        self._heard_s = time.perf_counter()
        try:
            with opened, store, self._spoiled():
                run_scan(
                    RIG.plan,
                    FaultyStage(opened.stage, clock, kind, at_s),
                    [FaultySensor(s, clock, kind, at_s) for s in opened.sensors],
                    clock,
                    lambda event: self._sink(event, store, clock),
                    RIG.limits,
                    control=self._control,
                    observers=[lambda _event: self._observe(clock)],
                    config=run_config(RIG, SCENE, RIG.plan, SEED),
                )  # fmt: skip
        finally:
            self._hear()
            self.committed, self.lag_s = store.committed, store.slowest_s
            self._measure(clock.now())

    def check(self) -> list[str]:
        """Limits and time."""
        wrong = []
        scan, limits = RIG.scan, RIG.limits
        speed = 1e-3 * (scan.approach_mm_s if self.kind == "surface higher" else 2.5)
        over_m = 2 * speed / SENSOR_RATE_HZ + speed**2 / (2 * ACCELERATION)
        stiffness = STIFFNESS_N_M * 1.2 * (HARD if self.kind == "hard lump" else 1.0)
        if self.force_n > limits.max_force_n + stiffness * over_m + 5 * NOISE_N:
            wrong.append(f"force {self.force_n:.3f} N")
        if self.depth_m > limits.max_depth_m + POSE_SLACK_M + over_m:
            wrong.append(f"depth {1e3 * self.depth_m:.3f} mm")
        if self.hang_s > HANG_S:
            wrong.append(f"hung for {self.hang_s:.1f} s")
        return wrong

    def _respond(self, clock: Clock) -> Respond:
        def respond(scene: Scene, x_m: float, depth_m: float) -> Bed:
            if self.kind == "physics fails" and clock.now() >= self.at_s:
                raise ArithmeticError("the section could not be solved")
            if self.kind == "hard lump" and x_m > 27e-3:
                return Bed(STIFFNESS_N_M * HARD, 0.0)
            return bed(scene, x_m, depth_m)

        return respond

    def _sink(self, event: Event, store: Store, clock: Clock) -> None:
        self._hear()
        struck = clock.now() >= self.at_s
        if struck and not self._begun:
            self._begun = True
            if self.kind == "disk full":
                store._connection.execute("PRAGMA max_page_count = 1")
            if self.kind == "file may not grow":
                log = self.path.with_name(self.path.name + "-wal")
                limit = log.stat().st_size if log.exists() else 4096
                resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
        store(event)
        self.told.append(event)
        if struck and isinstance(event, Samples | PhaseEntered):
            self._wish(event)

    def _observe(self, clock: Clock) -> None:
        if self.kind == "observer fails" and clock.now() >= self.at_s:
            raise RuntimeError("window closed")
        if self.kind == "observer blocks" and clock.now() >= self.at_s and not self._over.is_set():
            self._over.set()
            time.sleep(2.5)

    def _wish(self, event: Event) -> None:
        """What an impatient person does."""
        if self.kind in ("abort", "ctrl-c storm"):
            self._control.abort()
        if self.kind in ("stop", "ctrl-c storm"):
            self._control.stop()
        if self.kind == "pause storm" and isinstance(event, PhaseEntered):
            if event.phase is Phase.PAUSED:
                threading.Timer(0.005, self._control.resume).start()
            elif event.station is not None and event.phase is Phase.HOLDING and self._pauses < 4:
                self._control.pause(now=self._pauses % 2 == 0)
                self._pauses += 1

    @contextmanager
    def _spoiled(self) -> Iterator[None]:
        """A disk that is slow or hangs: someone else keeps the file locked."""
        thread = threading.Thread(target=self._keep_locked, daemon=True)
        if self.kind in ("slow disk", "disk hangs"):
            thread.start()
        try:
            yield
        finally:
            self._over.set()
            if thread.is_alive():
                thread.join()
            resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY,) * 2)

    def _keep_locked(self) -> None:
        until_s = self.at_s / 13 * 0.3  # the whole scan takes about 0.3 s of the wall's time
        self._over.wait(until_s)
        other = sqlite3.connect(self.path, isolation_level=None, timeout=1.0)
        while not self._over.is_set():
            with suppress(sqlite3.OperationalError):
                other.execute("BEGIN IMMEDIATE")
                slow_s = float(self.rng.uniform(0.02, 0.5))
                self._over.wait(4.0 if self.kind == "disk hangs" else slow_s)
                other.execute("ROLLBACK")
            self._over.wait(0.15)
        other.close()

    def _hear(self) -> None:
        now_s = time.perf_counter()
        self.hang_s, self._heard_s = max(self.hang_s, now_s - self._heard_s), now_s

    def _measure(self, end_s: float) -> None:
        """Greatest true force, and depth below the planned surface, whatever the sensor said."""
        assert self._phantom is not None
        t = np.arange(0.0, end_s + 0.1, 1e-3)
        legs = self._phantom.tip.legs(t)
        self.depth_m = -min(float(leg.points(t[span])[:, 2].min()) for leg, _, span in legs)
        if self.kind == "physics fails":
            self.force_n = float("nan")  # there is no force where nothing could be solved
        else:
            self.force_n = float(self._phantom.force_n(t).max())


class SteppingClock(WallClock):
    """A wall clock that is set by ``step_s`` at ``at_s``."""

    def __init__(self, at_s: float, step_s: float) -> None:
        super().__init__()
        self._at_s, self._step_s = at_s, step_s

    def now(self) -> float:
        """The time, wrong from the step on."""
        now = super().now()
        return now if now < self._at_s else now + self._step_s


def check_file(path: Path, told: list[Event] | None, committed: int) -> list[str]:
    """The file is sound and holds, to the bit, what was told: at least all that was committed."""
    report = verify(path)
    wrong = list(report.problems[:3])
    if report.events < committed:
        wrong.append(f"{committed - report.events} committed events are lost")
    if told is not None:
        stored = list(open_run(path).events())
        if len(stored) > len(told) + 1:
            wrong.append("more is stored than was told")
        if not all(map(same, stored, told)):
            wrong.append("something else is stored than was told")
    return wrong


def check_resumed(path: Path, *, unchanged_s: float, compare: bool = True) -> list[str]:
    """Resume; stations complete before ``unchanged_s`` must equal the undisturbed run's bytes."""
    wrong = []
    left = unfinished(path)
    before = {n: stored_bytes(path, n) for n in left.completed}
    ends = [e for e in open_run(path).events() if isinstance(e, StationEnded) and e.complete]
    early = {e.station for e in ends if e.time_s < unchanged_s}
    if any(before[n] != undisturbed()[0][n] for n in early):
        wrong.append("a station differs from the undisturbed scan's")
    if left.missing or open_run(path).finish is not Finish.COMPLETED:
        ended = resume(path, respond=bed).ended
        if ended.finish is not Finish.COMPLETED:
            wrong.append(f"not resumable: {ended.reason}")
    report = verify(path)
    wrong += report.problems[:3]
    if report.stations_complete != len(STATIONS) or report.finish is not Finish.COMPLETED:
        wrong.append("not complete after the resume")
    if any(stored_bytes(path, n) != before[n] for n in before):
        wrong.append("a complete station was changed by the resume")
    repeated = STATIONS if compare else STATIONS - left.completed
    force_n = held_force(path)
    if any(np.abs(force_n[n] - undisturbed()[1][n]).max() > ALIKE_N for n in repeated):
        wrong.append("a station's force differs from the undisturbed scan's")
    return wrong


@cache
def undisturbed() -> tuple[dict[int, list[bytes]], dict[int, Array]]:
    """Bytes and held force of every station, when nothing strikes."""
    path = Path(mkdtemp(prefix="palpate-fault-")) / "calm.run"
    struck = Struck("none", 0.0, np.random.default_rng(0), path)
    struck.scan(SimulatedClock())
    found = {n: stored_bytes(path, n) for n in STATIONS}, held_force(path)
    path.unlink()
    path.parent.rmdir()
    return found


def stored_bytes(path: Path, station: int) -> list[bytes]:
    """The checksums of a station's blocks of samples, over all of their bytes."""
    query = "SELECT sha256 FROM event WHERE kind = 'samples' AND station = ? ORDER BY id"
    connection = sqlite3.connect(path)
    found = [digest for (digest,) in connection.execute(query, (station,))]
    connection.close()
    return found


def held_force(path: Path) -> dict[int, Array]:
    """The force [N] in each `BIN_S` of every station's hold: its level and its beat."""
    recording = open_run(path).recording()
    edges = np.arange(0.02, 0.8, BIN_S)
    found = {}
    for one in recording.stations:
        part = np.digitize(one.time_s - one.hold_s, edges)
        means = [one.signal_pa[part == n].mean() for n in range(1, len(edges))]
        found[one.index] = np.array(means) * recording.face_m2
    return found


def same(a: Event, b: Event) -> bool:
    """Equal to the bit."""
    if not (isinstance(a, Samples) and isinstance(b, Samples)):
        return a == b or (isinstance(a, RunEnded) and isinstance(b, RunEnded))
    mine, theirs = a.block, b.block
    return (a.device, a.station, a.attempt) == (b.device, b.station, b.attempt) and all(
        getattr(mine, name).tobytes() == getattr(theirs, name).tobytes()
        for name in ("time_s", "values", "saturated")
    )
