"""A scan from a rig to a run file: the one call behind ``palpate scan`` and notebooks."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from operator import index
from pathlib import Path
from typing import TYPE_CHECKING

from drivers import Clock, ConfigError, SimulatedClock, WallClock
from probe.checks.run_size import need_room
from probe.config.load_rig import load_rig
from probe.config.rig import Fallback, Rig, SceneChoice, default_rig
from probe.config.scan_limits import limits_for
from probe.config.scan_plan import plan_for
from probe.config.scan_planner import planner_for
from probe.config.snapshot import check_text
from probe.core.errors import StoreError
from probe.core.events import Event, Finish, Note, RunEnded
from probe.core.log import log_event
from probe.guards.commands import Control
from probe.guards.guard_process import Order
from probe.guards.opening import OpenedRig, opened_devices
from probe.guards.prepare import Prepared, prepare
from probe.scan.choosing import Chooser
from probe.scan.engine import run_guarded
from probe.scan.event_bus import EventSink
from probe.scan.progress import in_notebook
from probe.scan.remote import listening
from probe.storage.writer import Store, create_store
from sim_backend import html
from sim_backend.scene.scene_file import Scene, as_scene, load_scene

if TYPE_CHECKING:  # a rig that only scans needs no phantom
    from sim_backend.phantom.phantom import Respond

DEFAULT_SCENE = "TIHA"


@dataclass(frozen=True)
class ScanResult:
    """Where the run is stored, its last event, and what a person should know: ``notes``.

    These are the devices' notes and every warning of the scan. A result stands for its run's file
    wherever a path is taken.

    Examples
    --------
    >>> import palpate
    >>> result = palpate.scan(palpate.Rig(scan={"stations": 3}), "TIHA", seed=1)
    >>> result.path.suffix, result.ended.finish.value, result.notes
    ('.run', 'completed', ())
    """

    path: Path
    ended: RunEnded
    notes: tuple[str, ...]

    def __fspath__(self) -> str:
        return str(self.path)

    def __repr__(self) -> str:
        return f"ScanResult({self.path}, {self.ended.finish.value}: {self.ended.reason})"

    def _repr_html_(self) -> str:
        """Where the run is, how it ended, how to go on, and the notes, for notebooks."""
        ended = f"{self.ended.finish.value}: {self.ended.reason}"
        rows = [("run", str(self.path)), ("finish", ended)]
        if self.ended.finish is not Finish.COMPLETED:
            rows.append(("to go on", to_go_on(self.path)))
        return html.table([*rows, *(("note", note) for note in self.notes)])


def to_go_on(path: Path) -> str:
    """What to type in Python for the stations that a run lacks."""
    return f"palpate.resume({str(path)!r})"


def scan(
    rig: Rig | str | Path | None = None,
    scene: Scene | str | Path | None = None,
    out: str | Path = "runs",
    *,
    seed: int = 0,
    labels: Mapping[str, str] | None = None,
    fallback: Fallback | None = None,
    real_time: bool = False,
    control: Control | None = None,
    observers: Sequence[EventSink] = (),
    opened: Callable[[Path, tuple[str, ...]], None] = lambda _path, _notes: None,
    respond: "Respond | None" = None,
) -> ScanResult:
    """Scan with a rig, and store the run in a new file.

    Parameters
    ----------
    rig
        A `Rig` or a rig file; by default the simulated rig. A rig of simulated devices only
        runs on simulated time, as fast as it can.
    scene
        What simulated devices feel: a built-in name, a file or a `Scene`.
    out
        The folder of the new run file.
    seed
        Of the simulated noise: the same seed gives the same run.
    labels
        Operator, specimen and notes of your own, kept in the run for `palpate runs`.
    fallback
        ``virtual`` allows a simulated stand-in for every absent device.
    real_time
        Let a simulated scan take as long as a real one.
    control
        Passes pause, resume, abort and stop from another thread.
    observers
        Get every event; one that raises is noted and not called again.
    opened
        Given the run file and the devices' notes before anything moves.
    respond
        What answers for the tissue, as of `connect`.

    Returns
    -------
    ScanResult
        The file and how the scan ended: a fault after the start is in ``ended``, not
        raised. In a notebook the cell shows the station that is pressed and the time left.

    Raises
    ------
    RigError, SceneError, ConfigError
        Before anything moves: what cannot be, and what is allowed.
    DeviceAbsent, DeviceFault
        Before anything moves: a device is not there, or does not work.
    StoreError
        There is no room on the disk.
    CannotSolve
        The physics of a simulated rig has no solution.

    Examples
    --------
    >>> import palpate
    >>> rig = palpate.Rig(scan={"start_mm": 24.0, "stations": 5})
    >>> result = palpate.scan(rig, "TIHA", seed=1, labels={"operator": "A. Person"})
    >>> result.ended.reason
    'every station is complete'
    """
    try:
        seed = index(seed)  # also of numpy's integers, which a run file cannot hold
    except TypeError:
        raise ConfigError(f"seed = {seed!r}: must be an integer") from None
    if seed < 0:
        raise ConfigError(f"seed = {seed}: must not be negative")
    check_text("labels", {key: str(value) for key, value in (labels or {}).items()})
    rig, chosen = resolve_rig(rig, scene)
    plan = plan_for(rig)
    limits = limits_for(rig, plan)
    clock = clock_for(rig, real_time=real_time)
    control = control or Control()
    order = Order(rig, clock, chosen, seed, fallback)
    with opened_devices(order, respond, control) as ready:
        simulated = ready.scene
        prepared = prepare(rig, plan, limits, simulated, ready.devices, seed)
        name = ready.devices.stage.name if simulated is None else simulated.name
        need_room(Path(out), prepared.plan, ready.devices.sensors)  # before its folder is made
        path = new_run_path(Path(out), name)
        with create_store(path) as sink, listening(control, path):
            opened(path, prepared.notes)
            chooser = Chooser(planner_for(rig, prepared.plan), prepared.plan)
            return run_prepared(
                ready, prepared, clock, sink, control, observers, labels or {}, chooser
            )


def run_prepared(
    ready: OpenedRig,
    prepared: Prepared,
    clock: Clock,
    sink: Store,
    control: Control,
    observers: Sequence[EventSink],
    labels: Mapping[str, str],
    chooser: Chooser,
    completed: int = 0,
) -> ScanResult:
    """Run what was prepared, to its end; ``completed`` stations are there already."""
    notes, reason = list(prepared.notes), "the scan did not end"

    def keep(event: Event) -> None:
        """Store it; a warning, and why it ended, are for whoever called, too."""
        nonlocal reason
        if isinstance(event, RunEnded):
            reason = event.reason
        sink(event)
        if isinstance(event, Note) and event.level == "warning":
            notes.append(event.words)

    shown = in_notebook(len(prepared.plan.places), completed)
    try:
        ended = run_guarded(
            ready.guards(prepared),
            prepared.plan,
            clock,
            keep,
            prepared.limits,
            control,
            (log_event, *shown, *observers),
            prepared.config | {"labels": {k: str(v) for k, v in labels.items()}},
            chooser,
        )
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f"{reason}; {to_go_on(sink.path)} goes on") from None
    return ScanResult(sink.path, ended, tuple(notes))


def resolve_rig(
    rig: Rig | str | Path | None, scene: Scene | str | Path | None
) -> tuple[Rig, Scene | None]:
    """The rig with the scene its simulated devices shall feel, and that scene.

    Without a rig the simulated one, over `DEFAULT_SCENE` if no scene is given either. A `Scene`
    that was made in Python is named in the rig, and stored whole in the run. Raises `ConfigError`
    for a name in them that no run can hold.
    """
    whole, chosen = _resolved(rig, scene)
    check_text("rig", whole.model_dump(mode="json"))
    check_text("scene", None if chosen is None else chosen.model_dump(mode="json"))
    return whole, chosen


def _resolved(
    rig: Rig | str | Path | None, scene: Scene | str | Path | None
) -> tuple[Rig, Scene | None]:
    if rig is not None and not isinstance(rig, Rig):
        rig = load_rig(rig)
    if scene is None and rig is not None:
        return rig, None if rig.scene is None else load_scene(rig.scene.name)
    scene = DEFAULT_SCENE if scene is None else scene
    chosen = as_scene(scene)
    rig = default_rig(chosen) if rig is None else rig
    lies = None if rig.scene is None else rig.scene.surface_mm
    choice = SceneChoice(name=chosen.name if chosen is scene else str(scene), surface_mm=lies)
    return rig.model_copy(update={"scene": choice}), chosen


def clock_for(rig: Rig, *, real_time: bool, start_s: float = 0.0) -> Clock:
    """Simulated time if every device is simulated and nobody wants to wait."""
    return WallClock(start_s) if rig.real or real_time else SimulatedClock(start_s)


def new_run_path(folder: Path, name: str) -> Path:
    """A file in ``folder`` that does not exist yet; the folder is made. Raises `StoreError`."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        why = f"no folder for runs can be made there ({error.strerror})"
        raise StoreError(f"{folder}: {why}; name another with out, in the shell --out") from None
    plain = "".join(c if c.isalnum() or c in " -_." else "_" for c in name).strip(". ") or "run"
    stem = f"{plain[:100]}-{datetime.now(UTC):%Y%m%d-%H%M%S}"
    number = 1
    while (path := folder / (f"{stem}.run" if number == 1 else f"{stem}-{number}.run")).exists():
        number += 1
    return path
