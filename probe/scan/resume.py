"""``palpate resume RUN``: go on with a scan that was killed, aborted or broke off.

Stations that were complete stay as they are, byte for byte. The one that was interrupted is
pressed again as a new attempt; nothing is renumbered. The scan's clock goes on after the last
stored time, so that times stay unique within a run.
"""

from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import ValidationError

from drivers.core.files import path_of
from probe.checks.run_size import need_room
from probe.config.changed_rig import changed
from probe.config.rig import RASTER, Fallback, Rig
from probe.config.scan_limits import limits_for
from probe.config.scan_plan import plan_for
from probe.config.scan_planner import planner_for
from probe.config.snapshot import run_config, this_computer
from probe.core.errors import RunFileError
from probe.core.events import Finish, RunStarted, Samples, StationEnded, StationStarted
from probe.guards.commands import Control
from probe.guards.guard_process import Order
from probe.guards.opening import opened_devices
from probe.guards.prepare import prepare
from probe.planning.plan import Plan
from probe.planning.planner import Told
from probe.scan.choosing import Chooser
from probe.scan.event_bus import EventSink
from probe.scan.remote import listening
from probe.scan.session import ScanResult, clock_for, run_prepared
from probe.storage.run import open_run
from probe.storage.writer import reopen_store
from sim_backend.scene.explain import explain
from sim_backend.scene.scene_file import Scene

if TYPE_CHECKING:  # a rig that only scans needs no phantom
    from sim_backend.phantom.phantom import Respond

PAUSE_S = 1.0  # between the last stored time and the resumed scan's first
NOISE_STEP = 7919  # a resumed scan's simulated noise must not repeat that of the first


@dataclass(frozen=True)
class Unfinished:
    """What a run still needs: all as stored in it.

    ``attempts`` counts the presses begun at each station; ``start_s`` is where its clock goes on;
    ``files`` are the calibrations and the wave that it was scanned with;
    ``computer`` where it was begun; ``rehearsal_mm`` how far it was lifted off the tissue, if so.
    """

    path: Path
    rig: Rig
    plan: Plan
    scene: Scene | None
    seed: int
    completed: frozenset[int]
    redo: frozenset[int]
    attempts: dict[int, int]
    start_s: float
    files: tuple[Any, Any]
    rehearsal_mm: float | None
    computer: str | None

    @property
    def missing(self) -> tuple[int, ...]:
        """The stations that are not complete, in scanning order."""
        return tuple(p.index for p in self.plan.places if p.index not in self.completed)


def unfinished(
    path: str | PathLike[str], redo: Collection[int] = (), settings: Mapping[str, str] | None = None
) -> Unfinished:
    """Read what is left to do, stations to ``redo`` (from 1) among it, with the rig as
    ``settings`` change it. Raises `RunFileError` for a damaged file or one without a rig."""
    path = path_of(path, "a run or the name of its file")
    run = open_run(path)
    if "imported" in run.config:
        raise RunFileError(
            f"{path}: was imported, not scanned here: no stage moved for it, so there is nothing "
            "to go on with; `palpate detect` says what is in it, `palpate scan` makes a new run"
        )
    try:
        rig = Rig.model_validate(run.config["rig"])
        scene = run.config.get("scene")
        scene_of_run = None if scene is None else Scene.model_validate(scene)
        seed = int(run.config["seed"])
    except ValidationError as error:
        raise RunFileError(f"{path}: " + "; ".join(explain(error))) from None
    except (KeyError, TypeError, ValueError):
        raise RunFileError(f"{path}: holds no rig to scan with; it was not scanned here") from None
    completed: set[int] = set()
    attempts: Counter[int] = Counter()
    last_s, sessions = run.started.time_s, 0
    for event in run.events():
        match event:
            case StationStarted(_, station):
                attempts[station] += 1
            case StationEnded(_, station, _, True):
                completed.add(station)
            case RunStarted():
                sessions += 1
        if not isinstance(event, Samples):
            last_s = max(last_s, event.time_s)
        elif len(event.block.time_s):
            last_s = max(last_s, float(event.block.time_s[-1]))
    plan = plan_for(rig := changed(rig, settings or {}))
    again = {n - 1 for n in redo}
    if missing := sorted(again - {place.index for place in plan.places}):
        numbers = ", ".join(str(place.index + 1) for place in plan.places)
        raise RunFileError(f"{path}: has no station {missing[0] + 1}; it has {numbers}")
    return Unfinished(
        path,
        rig,
        plan,
        scene_of_run,
        seed + NOISE_STEP * sessions,
        frozenset(completed - again),
        frozenset(again),
        dict(attempts),
        last_s + PAUSE_S,
        _files(run.config),
        run.config.get("rehearsal_mm"),
        run.config.get("computer"),
    )


def resume(
    path: str | PathLike[str],
    *,
    fallback: Fallback | None = None,
    real_time: bool = False,
    control: Control | None = None,
    observers: Sequence[EventSink] = (),
    opened: Callable[[Path, tuple[str, ...]], None] = lambda _path, _notes: None,
    respond: "Respond | None" = None,
    trust: bool = False,
    redo: Collection[int] = (),
    settings: Mapping[str, str] | None = None,
) -> ScanResult:
    """Scan the stations that a run lacks, with the rig, scene and plan stored in it.

    Parameters
    ----------
    path
        The run file.
    fallback
        As of `scan`.
    real_time
        As of `scan`.
    control
        As of `scan`.
    observers
        As of `scan`.
    opened
        As of `scan`.
    respond
        As of `connect`.
    trust
        Open real devices though the run is from another computer.
    redo
        Stations to press again though they are complete, by their numbers from 1; of each
        station the latest complete press counts.
    settings
        Keys of the rig changed from now on, as ``{"scan.indentation_mm": "3"}``.

    Returns
    -------
    ScanResult
        As of `scan`.

    Raises
    ------
    RunFileError
        There is nothing to do, the run's last events are lost, a file it depends on has
        changed, or it is from another computer and not trusted.

    Examples
    --------
    >>> import palpate
    >>> control = palpate.Control()
    >>> control.abort()
    >>> begun = palpate.scan(palpate.Rig(scan={"stations": 3}), "TIHA", control=control)
    >>> palpate.resume(begun.path).ended.finish.value
    'completed'
    """
    left = unfinished(path, redo, settings)
    run, all_asked = open_run(path), left.rig.scan.planner == RASTER
    if run.finish is Finish.COMPLETED and not left.redo and not (left.missing and all_asked):
        raise RunFileError(
            f"{left.path}: all {len(left.completed)} stations are complete"
            if not left.missing
            else f"{left.path}: its planner is done; to press all stations that it left out, say "
            "--set scan.planner=raster"
        )
    if not trust:
        _check_origin(left)
    config = run_config(left.rig, left.scene, left.plan, left.seed)
    if _files(config) != left.files:
        raise RunFileError(
            f"{left.path}: a calibration or wave file has changed since the scan began; restore "
            "it, or begin a new run"
        )
    limits = limits_for(left.rig, left.plan)
    clock = clock_for(left.rig, real_time=real_time, start_s=left.start_s)
    control = control or Control()
    order = Order(left.rig, clock, left.scene, left.seed, fallback)
    with (  # the run's lock first: no device is touched while another scan writes it
        reopen_store(left.path) as sink,
        opened_devices(order, respond, control) as ready,
        listening(control, left.path),
    ):
        prepared = prepare(left.rig, left.plan, limits, left.scene, ready.devices, left.seed)
        if prepared.config.get("rehearsal_mm") != left.rehearsal_mm:
            raise RunFileError(
                f"{left.path}: was {'a' if left.rehearsal_mm else 'no'} rehearsal in the air, and "
                "the devices found now would change that; begin a new run"
            )
        missing = tuple(p for p in prepared.plan.places if p.index in left.missing)
        need_room(left.path.parent, replace(prepared.plan, places=missing), ready.devices.sensors)
        opened(left.path, prepared.notes)
        planner = planner_for(left.rig, prepared.plan)
        chooser = Chooser(planner, prepared.plan, left.completed, left.attempts, left.redo)
        if isinstance(planner, Told):
            chooser.catch_up(run.events())
        return run_prepared(
            ready, prepared, clock, sink, control, observers, run.config.get("labels", {}),
            chooser, len(left.completed),
        )  # fmt: skip


def _check_origin(left: Unfinished) -> None:
    """A file from elsewhere names ports and addresses here: nothing of it is opened unasked."""
    if not left.rig.real or left.computer == this_computer():
        return
    said = "; ".join(
        f"{one.driver} " + ", ".join(f"{key} = {value!r}" for key, value in one.settings.items())
        for one in left.rig.real
    )
    raise RunFileError(
        f"{left.path}: was not scanned on this computer, and to go on would open and move its "
        f"devices here: {said}; if these are yours, say --trust"
    )


def _files(config: Mapping[str, Any]) -> tuple[Any, Any]:
    return config.get("calibration"), config.get("wave")
