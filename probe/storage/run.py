"""A stored run, in one call: ``open_run(path)``.

run = open_run("runs/TIHA-20260101-120000.run")
run.stations()            # a table, one press per row
run.samples()             # labelled arrays with units
run.recording()           # what detection works on
"""

from collections.abc import Iterator, Mapping
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from drivers import Channel
from drivers.core.files import path_of
from probe.core.contact_stress import simulated_channels
from probe.core.cut_stations import record
from probe.core.errors import RunFileError
from probe.core.events import Event, Finish, RunEnded, RunStarted
from probe.core.recording import Recording, Station
from probe.storage.reader import NOTHING_YET, NotBegun, reading, rows
from probe.storage.rows import Row, from_row
from sim_backend import html

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

__all__ = ["NotBegun", "Run", "RunFileError", "follow", "open_run"]

FOLLOW_ROWS = 200


class Judged(Protocol):
    """A finding of detection, which stands above this room."""

    def as_json(self) -> dict[str, Any]: ...


class Run:
    """A run file, read anew at each call: a scan may still be writing it.

    ``started`` is the run's first event. Methods raise `RunFileError` for a damaged file.

    Examples
    --------
    >>> import palpate
    >>> run = palpate.open_run("TIHA.run")
    >>> run.config["scene"]["name"], run.finish.value, run.simulated
    ('TIHA', 'completed', ('force.force', 'force.von_mises', 'stage.x', 'stage.y', 'stage.z'))
    >>> run.stations()[["x_mm", "complete"]].shape
    (15, 2)
    """

    def __init__(self, path: Path, started: RunStarted) -> None:
        self.path = path
        self.started = started
        self.finding: Judged | None = None

    def __fspath__(self) -> str:
        """A run stands for its file wherever a path is taken."""
        return str(self.path)

    def __repr__(self) -> str:
        return f"Run({str(self.path)!r}, started {self.started.started_utc})"

    def _repr_html_(self) -> str:
        """What the run is, and the level at each station in its hold, for notebooks."""
        recording = self.recording()
        rows = [
            ("file", str(self.path)),
            ("started", self.started.started_utc),
            ("finish", self.finish or "not ended"),
            ("stations", f"{len(recording.stations)} complete"),
            ("simulated", ", ".join(self.simulated) or "nothing"),
        ]
        x_mm = [1e3 * one.x_m for one in recording.stations]
        y_mm = [1e3 * one.y_m for one in recording.stations]
        levels = {"level": [one.hold_level_pa for one in recording.stations]}
        return html.table(rows) + html.over_places(x_mm, y_mm, levels, "Pa")

    @property
    def config(self) -> Mapping[str, Any]:
        """``rig``, ``scene``, ``plan``, ``calibration``, ``versions``, ``seed``, ``face_mm2``."""
        return self.started.config

    @property
    def channels(self) -> Mapping[str, tuple[Channel, ...]]:
        """The channels of each device; those of ``stage`` are x, y, z in m."""
        return self.started.channels

    @cached_property
    def simulated(self) -> tuple[str, ...]:
        """``device.channel`` of every simulated channel."""
        return simulated_channels(self.channels)

    @property
    def finish(self) -> Finish | None:
        """How the run ended; None while it goes on and for one that was broken off."""
        with reading(self.path) as connection:
            (number,) = connection.execute(
                "SELECT max(id) FROM event WHERE kind IN ('run_started', 'run_ended')"
            ).fetchone()
            last = [_event(*found) for found in rows(connection, (number or 1) - 1, 1)]
        return last[0].finish if last and isinstance(last[0], RunEnded) else None

    def events(self) -> Iterator[Event]:
        """Every event, in order; what is committed at the first call."""
        with reading(self.path) as connection:
            for number, row in rows(connection):
                yield _event(number, row)

    def recording(
        self,
        face_mm2: float | None = None,
        *,
        samples: "xr.Dataset | pd.DataFrame | None" = None,
        any_unit: bool = False,
    ) -> Recording:
        """What detection works on; ``face_mm2`` where the run does not know the probe's face.

        With ``any_unit`` a signal that is neither force nor pressure, such as counts, stays as it
        is, and `Recording.unit` says so; else it raises `RunFileError`.

        ``samples``: what `samples` gave, as you changed it (filtered, with rows left out; that of
        `channel_samples` also as a pandas table), in place of what was stored. Places, phases and
        depths are the run's.

        Examples
        --------
        >>> import palpate
        >>> run = palpate.open_run("TIHA.run")
        >>> mine = run.samples()
        >>> mine["force"] *= 2.0
        >>> twice, once = (palpate.detect(r) for r in (run.recording(samples=mine), run))
        >>> round(twice.stations[7].baseline_pa / once.stations[7].baseline_pa, 2)
        2.0
        """
        events = self.events()
        try:
            if samples is not None:
                from probe.storage.tables import with_samples  # here: as in `samples`

                events = with_samples(self.started, events, samples)
            return record(events, face_mm2, any_unit=any_unit)
        except RunFileError as error:
            raise _at(self.path, error) from None

    def stations(self, finding: "Judged | None" = None) -> "pd.DataFrame":
        """One row per press: see `probe.storage.tables.stations`.

        With a ``finding``, what `palpate.detect` gave, also level and pulse of each press; by
        default with the run's own ``finding``, if one was set.

        Examples
        --------
        >>> import palpate
        >>> run = palpate.open_run("TIHA.run")
        >>> table = run.stations(palpate.detect(run))
        >>> bool(table["pulse_low_pa"][7] < table["pulse_pa"][7] < table["pulse_high_pa"][7])
        True
        """
        from probe.storage.tables import judged, stations  # here: reading events needs no pandas

        depths_m = {one.index: one.hold_depth_m for one in self._presses()}
        table = stations(self.started, self.events(), depths_m)
        finding = finding or self.finding
        return table if finding is None else judged(table, finding.as_json()["stations"])

    def samples(self, device: str | None = None, station: int | None = None) -> "xr.Dataset":
        """The samples of one device, by default the one that feels: see `probe.storage.tables`.

        ``depth_mm`` is how deep the tip was at each, where the stage tells its position. An array
        whose layout is known is ``taxels`` (time_s, row, column), and ``taxels_saturated``.
        """
        from probe.storage.taxel_arrays import gathered  # here: events need no xarray

        along = self.channel_samples(device, station)
        return gathered(along, self.channels[along.attrs["device"]])

    def channel_samples(
        self, device: str | None = None, station: int | None = None
    ) -> "xr.Dataset":
        """As `samples`, with a variable for each channel, taxels too: a table's columns."""
        from probe.storage.tables import samples, with_depth  # here: as in `samples`

        try:
            along = samples(self.started, self.events(), device, station)
            return with_depth(along, self._presses())
        except RunFileError as error:
            raise _at(self.path, error) from None

    def _presses(self) -> tuple[Station, ...]:
        """The presses that are judged; none where nothing feels, or the face is not known."""
        try:
            return self.recording().stations
        except RunFileError:
            return ()


def recording_of(source: Recording | str | PathLike[str]) -> Recording:
    """What detection works on, of a run or its file, in any unit; a recording as it is."""
    return source if isinstance(source, Recording) else open_run(source).recording(any_unit=True)


def open_run(path: str | PathLike[str]) -> Run:
    """Open a run file: finished, growing, or left by a scan that was killed.

    Parameters
    ----------
    path
        The run file; nothing is written to it.

    Returns
    -------
    Run
        Its events, samples, stations and recording.

    Raises
    ------
    RunFileError
        The file is no run, is damaged, or was written by a newer version.

    Examples
    --------
    >>> import palpate
    >>> len(palpate.open_run("TIHA.run").recording().stations)
    15
    """
    path = path_of(path, "a run or the name of its file")
    with reading(path) as connection:
        first = next(rows(connection, limit=1), None)
        if first is None:
            raise NotBegun(NOTHING_YET)
        started = _event(*first)
        if not isinstance(started, RunStarted):
            raise RunFileError("the run has no beginning")
    return Run(path, started)


def follow(path: str | Path) -> Iterator[Event | None]:
    """The events of a run as they are committed.

    Parameters
    ----------
    path
        The run file; if it is not there yet, it is waited for.

    Returns
    -------
    Iterator[Event | None]
        Each event in its order, None whenever there is nothing new. It never ends by
        itself.

    Raises
    ------
    RunFileError
        The file is no run, or damaged.

    Examples
    --------
    >>> import palpate
    >>> for event in palpate.follow("TIHA.run"):  # here of a scan that has ended
    ...     if event is None:
    ...         break  # of one that goes on: time.sleep(0.1)
    ...     last = event
    >>> last.reason
    'every station is complete'
    """
    path, last = Path(path), 0
    while True:
        found: list[tuple[int, Row]] = []
        if path.exists():
            try:
                with reading(path) as connection:
                    found = list(rows(connection, last, FOLLOW_ROWS))
            except NotBegun:
                pass
        if not found:
            yield None
        for number, row in found:
            last = number
            yield _event(number, row)


def _event(number: int, row: Row) -> Event:
    try:
        return from_row(row)
    except RunFileError as error:
        raise RunFileError(f"event {number}: {error}") from None


def _at(path: Path, error: RunFileError) -> RunFileError:
    return error if str(error).startswith(str(path)) else RunFileError(f"{path}: {error}")
