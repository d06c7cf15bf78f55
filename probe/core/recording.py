"""What detection works on: one tactile signal per station, wherever it came from."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from drivers.core.arrays import Array, Bools
from probe.core.places import rows_of

FARTHEST_M = 3.0
"""No place of a scan is farther from its frame's origin: no person's body is, and no arm reaches
farther beyond its base than a UR20's 1.75 m."""


@dataclass(frozen=True)
class Station:
    """One press at one place. Lists and counts are taken, too, and made arrays.

    ``time_s`` (n,) and ``signal_pa`` (n, channels): mean contact stress, positive when pressed.
    ``saturated`` (n, channels) marks clipped samples. ``indent_s``, ``hold_s`` and ``retract_s``
    are when the ramp, the hold and the retraction began (NaN where unknown: the whole record is
    then one hold). ``depth_m`` (n,) is the measured indentation, NaN where unknown.
    ``reference`` (m,) at ``reference_s`` (m,) is a PPG or ECG beside it; empty without one.
    ``x_m``, ``y_m`` are NaN for a recording without positions.

    Examples
    --------
    >>> import palpate
    >>> station = palpate.open_run("TIHA.run").recording().stations[7]
    >>> station.x_m, station.signal_pa.shape[1]
    (0.032, 1)
    """

    index: int
    x_m: float
    y_m: float
    time_s: Array
    signal_pa: Array
    saturated: Bools
    indent_s: float
    hold_s: float
    retract_s: float
    depth_m: Array
    reference_s: Array = field(default_factory=lambda: np.empty(0))
    reference: Array = field(default_factory=lambda: np.empty(0))

    def __post_init__(self) -> None:
        """Raises `ValueError` for arrays that do not belong together."""
        n, columns = len(self.time_s), np.shape(self.signal_pa)[1:]
        needed = {
            "signal_pa": (n, *(columns if len(columns) == 1 else ("channels",))),
            "saturated": np.shape(self.signal_pa),
            "depth_m": (n,),
            "reference": np.shape(self.reference_s),
        }
        for name, shape in needed.items():
            if (found := np.shape(getattr(self, name))) != shape:
                words = ", ".join(str(one) for one in shape)
                raise ValueError(
                    f"station {self.index + 1}: {name} has the shape {found}; ({words}) is needed, "
                    f"with the {n} times of time_s"
                )
        for name in ("time_s", "signal_pa", "depth_m", "reference_s", "reference"):
            object.__setattr__(self, name, np.asarray(getattr(self, name), float))
        object.__setattr__(self, "saturated", np.asarray(self.saturated, bool))

    @property
    def hold_level_pa(self) -> float:
        """Mean contact stress over hold and channels; NaN without samples in the hold."""
        begin = self.hold_s if np.isfinite(self.hold_s) else -np.inf
        end = self.retract_s if np.isfinite(self.retract_s) else np.inf
        held = self.signal_pa[(self.time_s >= begin) & (self.time_s < end)]
        return float(held.mean()) if held.size else float("nan")

    @property
    def hold_depth_m(self) -> float:
        """How deep the hold was pressed; NaN where that was not recorded."""
        held = self.time_s >= self.hold_s if np.isfinite(self.hold_s) else slice(None)
        known = (depth_m := self.depth_m[held])[np.isfinite(depth_m)]
        return float(np.median(known)) if len(known) else float("nan")


@dataclass(frozen=True)
class Recording:
    """A scan's ``stations`` in the order of their index; only complete ones.

    ``channels`` are the names of the signal's columns, as ``device.channel``; ``simulated`` the
    names of all simulated channels. ``face_m2`` is the area of the probe's face (NaN = unknown),
    ``finish`` how the run ended (``completed``, ``aborted`` or ``faulted``), ``ended`` why, in
    words (empty of a run that was broken off), ``quantum_pa`` the sensor's resolution (0 =
    unknown). ``block`` is what is known of finger, block and support, as a scene file says it.
    ``unit`` is that of ``signal_pa`` and ``quantum_pa``: "Pa", or that of a sensor whose readings
    nothing turns into pascals, such as "counts". ``step_hold_s`` is how long each step of a press
    in steps was held; 0 of presses at once.

    Examples
    --------
    >>> import palpate
    >>> recording = palpate.open_run("TIHA.run").recording()
    >>> recording.channels, recording.finish, len(recording.stations)
    (('force.force',), 'completed', 15)
    """

    stations: tuple[Station, ...]
    channels: tuple[str, ...]
    simulated: tuple[str, ...]
    face_m2: float
    finish: str = "completed"
    quantum_pa: float = 0.0
    ended: str = ""
    block: Mapping[str, Any] | None = None
    unit: str = "Pa"
    step_hold_s: float = 0.0

    def __post_init__(self) -> None:
        """Raises `ValueError` for a face that none has, and places that cannot be in metres."""
        if self.face_m2 <= 0 or self.face_m2 > FARTHEST_M**2:
            raise ValueError(
                f"face_m2 = {self.face_m2:g}: the probe's face in m2 is needed, above 0 (100 mm2 "
                "are 1e-4), or NaN if it is not known"
            )
        for one in self.stations:
            for name, value in (("x_m", one.x_m), ("y_m", one.y_m)):
                if abs(value) > FARTHEST_M:
                    raise ValueError(
                        f"station {one.index + 1}: {name} = {value:g}: metres are needed, at most "
                        f"{FARTHEST_M:g} from the origin; are they millimetres?"
                    )

    def __repr__(self) -> str:
        return (
            f"Recording({len(self.stations)} complete stations of {', '.join(self.channels)}, "
            f"{self.finish})"
        )

    def rows(self) -> list[list[int]]:
        """Places in ``stations`` of those of equal y; one row where y is unknown."""
        rows: dict[int, list[int]] = {}
        for i, row in enumerate(rows_of([station.y_m for station in self.stations])):
            rows.setdefault(row or 0, []).append(i)
        return [rows[row] for row in sorted(rows)]
