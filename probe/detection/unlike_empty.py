"""Which presses are unlike presses over nothing, by their images alone, whatever the unit.

A press is a short film: the mean of every taxel in each of `PARTS` parts of it. Presses over
nothing differ among themselves, most along a few patterns: how the probe moved and how deep it was.
The Mahalanobis distance counts a difference in the standard deviations that presses over nothing
have along it: what the motions change counts little, what none of them changes counts much.

Whole places are left out in turn, since places differ more than presses at one place do. What is
left out says how far presses over nothing lie from those at other places, and by how much to shrink
the covariance, which a handful of presses does not determine: so that it is likeliest.
"""

from dataclasses import dataclass
from os import PathLike

import numpy as np

from drivers.core.arrays import Array, Ints
from probe.core.places import rows_of
from probe.core.recording import Recording, Station
from probe.storage.run import recording_of

PARTS = 3
"""Of a press in time. On the data of `benchmarks/real_arrays.py`, with 20 presses over nothing, 2,
3 and 6 parts separate presses over a nodule alike (areas under the curve of 0.92, 0.93 and 0.93),
one part worse (0.82)."""
SHARES = tuple(10.0 ** np.arange(-4.0, 0.5, 0.5))
"""Of the mean variance that every direction is given at least, to choose from."""
FOLDS = 10
"""Groups of places that are left out in turn, of more places than that (Kohavi 1995)."""
MIN_PRESSES = 3  # of two, all differences lie along one line, and nothing says how sure that is


@dataclass(frozen=True)
class Unlike:
    """How unlike ``presses`` presses over nothing, at ``places`` places, each station is.

    ``distance`` (stations,) is the Mahalanobis distance, ``chance`` (stations,) the share of
    presses over nothing that are as far from those at other places, at least 1 / (``presses`` + 1);
    NaN of a press without samples. With one place only, the chance is for presses at that place.

    Examples
    --------
    >>> import palpate
    >>> unlike = palpate.unlike_empty("TIHA.run", "TIHA.run")  # each beside itself and all others
    >>> unlike.presses, unlike.places, unlike.distance.shape
    (15, 15, (15,))
    """

    distance: Array
    chance: Array
    presses: int
    places: int


def unlike_empty(
    source: Recording | str | PathLike[str], empty: Recording | str | PathLike[str]
) -> Unlike:
    """How unlike presses over nothing each press of a scan is; nothing else has to be known.

    Parameters
    ----------
    source
        A recording, a run, or a run file; of an array or a single sensor, in pascals or counts.
    empty
        Presses over nothing by the same sensor and with the same motions, at several places.

    Returns
    -------
    Unlike
        Distance and chance of each station.

    Raises
    ------
    ValueError
        ``empty`` has other channels, too few presses, or reads the same in all of them.
    RunFileError
        A file cannot be read, or is no run.

    References
    ----------
    Friedman (1989), J. Am. Statistical Association 84, 165: shrinking by what is left out. Vovk,
    Gammerman & Shafer (2005), Algorithmic Learning in a Random World: ranks as chances.

    Examples
    --------
    >>> import palpate
    >>> recording = palpate.open_run("TIHA.run").recording()
    >>> bool(palpate.unlike_empty(recording, recording).chance.min() >= 1 / 16)
    True
    """
    recording, nothing = recording_of(source), recording_of(empty)
    kinds = [(len(run.channels), run.unit) for run in (recording, nothing)]
    if kinds[0] != kinds[1]:
        read, wanted = (f"{count} channels in {unit}" for count, unit in kinds)
        raise ValueError(f"presses over nothing have {wanted}, these {read}: take one sensor")
    films, at = films_of(nothing), places_of(nothing)
    seen = np.isfinite(films).any(axis=1)
    alive = np.isfinite(films[seen]).all(axis=0)  # a dead taxel says nothing
    films, at = films[seen][:, alive], at[seen]
    distance, chance = unlike(films_of(recording)[:, alive], films, at)
    return Unlike(distance, chance, len(films), len(np.unique(at)))


def films_of(recording: Recording) -> Array:
    """Every press as `PARTS` images, (stations, parts x channels), from where the ramp begins to
    the lift, if these are known; NaN of a press with fewer samples."""
    films = np.full((len(recording.stations), PARTS, len(recording.channels)), np.nan)
    for film, station in zip(films, recording.stations, strict=True):
        pressed = _pressed(station)
        if len(pressed) >= PARTS:
            film[:] = [part.mean(axis=0) for part in np.array_split(pressed, PARTS)]
    return films.reshape(len(films), -1)


def _pressed(station: Station) -> Array:
    before = station.time_s < station.indent_s  # False where it is not known
    return station.signal_pa[~(before | (station.time_s >= station.retract_s))]


def places_of(recording: Recording) -> Ints:
    """A number for the place of each station (stations,); where places are unknown all are one."""
    stations = recording.stations
    at = np.array([rows_of([s.x_m for s in stations]), rows_of([s.y_m for s in stations])], float)
    return np.unique(np.nan_to_num(at, nan=-1.0), axis=1, return_inverse=True)[1].ravel()


def unlike(films: Array, empty: Array, place: Ints) -> tuple[Array, Array]:
    """Distance and chance (n,) of ``films`` (n, k) beside those over nothing ``empty`` (m, k) at
    ``place`` (m,), numbers of places: whole places are left out in turn, of one place presses.

    Raises `ValueError` for too few presses.
    """
    one_place = len(np.unique(place)) < 2
    _, order = np.unique(np.arange(len(empty)) if one_place else place, return_inverse=True)
    folds = [order % FOLDS == n for n in range(min(order.max(initial=0) + 1, FOLDS))]
    left_out, surprise = np.empty((len(SHARES), len(empty))), np.zeros(len(SHARES))
    for own in folds:
        rest = _Spread(empty[~own])
        for n, share in enumerate(SHARES):
            squared = rest.squared(empty[own], share)
            left_out[n, own] = np.sqrt(squared)
            surprise[n] += squared.sum() + own.sum() * rest.log_volume(share)
    best = int(np.argmin(surprise))
    distance = np.sqrt(_Spread(empty).squared(films, SHARES[best]))
    farther = len(empty) - np.searchsorted(np.sort(left_out[best]), distance)
    chance = np.where(np.isfinite(distance), (1 + farther) / (len(empty) + 1), np.nan)
    return distance, chance


class _Spread:
    """How presses over nothing ``empty`` (m, k) differ: their mean, and their covariance by its
    eigenvectors, of columns in their own standard deviations. Raises `ValueError`."""

    def __init__(self, empty: Array) -> None:
        if len(empty) < MIN_PRESSES:
            raise ValueError(
                f"too few presses over nothing: {len(empty)} where a place is left out, at least "
                f"{MIN_PRESSES} are needed; press more, at more places"
            )
        self.middle, own = empty.mean(axis=0), empty.std(axis=0)
        if not own.any():
            raise ValueError("presses over nothing all read the same, so nothing can be compared")
        self.scale = np.where(own > 0, own, own.mean())
        _, singular, self.axes = np.linalg.svd((empty - self.middle) / self.scale, False)
        self.variances = singular**2 / len(empty)
        self.mean = float(self.variances.sum()) / empty.shape[1]

    def squared(self, films: Array, share: float) -> Array:
        """Squared Mahalanobis distance (n,) of ``films`` (n, k), where every direction gets
        ``share`` of the mean variance and 1 - ``share`` of its own."""
        scaled = (films - self.middle) / self.scale
        along = scaled @ self.axes.T
        across = np.maximum((scaled**2).sum(axis=1) - (along**2).sum(axis=1), 0.0)
        each = along**2 / (share * self.mean + (1 - share) * self.variances)
        return np.asarray(each.sum(axis=1) + across / (share * self.mean))

    def log_volume(self, share: float) -> float:
        """Logarithm of the determinant of that covariance."""
        floor, k = share * self.mean, len(self.scale)
        along = np.log(floor + (1 - share) * self.variances).sum() + 2 * np.log(self.scale).sum()
        return float(along + (k - len(self.variances)) * np.log(floor))
