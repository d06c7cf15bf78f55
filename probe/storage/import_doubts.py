"""What of a recording from elsewhere is possible, but hardly meant: each in a sentence."""

from collections.abc import Iterable, Iterator

import numpy as np

from drivers.core.arrays import Array
from drivers.core.units import to_si
from probe.core.contact_stress import PRESSED_N
from probe.core.places import SAME_PLACE_M
from probe.storage.csv_table import CsvRecording
from probe.storage.import_table import DEVICE

MANY = 3  # places: of a row or a grid; two are as soon one place that was moved by a little
SHARE = 0.1  # of the highest reading, as much as a tare may hide of a force limit
LEVEL_S, MIN_OF_LEVEL = 0.1, 4  # a level is the mean over this long, as in a scan; readings
STANDARD_ERRORS = 6.0  # of a reading, as of levels in a scan: by chance once in 500 million
TELLING = 100  # readings: noise goes up and down in turn in two of three, never in all of so many


def doubts(read: CsvRecording) -> Iterator[str]:
    """Sentences."""
    means = [np.nanmean(press.signal.values, axis=1) for press in read.presses]
    if _most(mean[np.abs(mean).argmax()] < 0 for mean in means):
        what = read.devices[DEVICE][0].role
        yield f"{what} is negative where it is largest: here pressed is positive"
    else:
        yield from _untared(read, means)
    if _never_below(read):
        yield "depth_mm is never above 0: here it is positive below the surface"
    yield from _in_another_unit(read)
    if _most(map(_alternates, means)):
        yield (
            "every other row is of another level: are two sensors in one table? Import the rows "
            "of one of them"
        )


def _most(presses: Iterable[bool]) -> bool:
    return bool(np.mean(list(presses)) > 0.5)


def _untared(read: CsvRecording, means: list[Array]) -> Iterator[str]:
    """Where most presses begin at a level far from 0, and rise from it: without a rise they may
    have been recorded in contact only."""
    far = []
    for press, mean in zip(read.presses, means, strict=True):
        step_s = np.median(np.diff(press.signal.time_s))
        size = min(max(MIN_OF_LEVEL, round(LEVEL_S / step_s)), len(mean))
        levels = mean[: len(mean) // size * size].reshape(-1, size)
        begin, highest = levels[0].min(), levels.mean(axis=1).max()  # it may rise at once
        noise = STANDARD_ERRORS * levels[0].std()
        if begin > SHARE * highest and highest - begin > max(SHARE * highest, noise):
            far.append(begin)
    if len(far) > len(read.presses) / 2:
        unit, many = read.devices[DEVICE][0].unit, len(read.presses) > 1
        yield (
            f"{f'{len(far)} of {len(read.presses)} presses begin' if many else 'the press begins'} "
            f"at {np.median(far):.3g} {unit}: if the probe was in the air then, it was not tared, "
            f"and --tare-s {LEVEL_S:g} takes the mean of the first {LEVEL_S:g} s as zero"
        )


def _alternates(mean: Array) -> bool:
    """Whether readings (n,) go up and down in turn by much."""
    steps = np.diff(mean)
    apart = abs(mean[::2].mean() - mean[1::2].mean()) > SHARE * np.abs(mean).max()
    return bool(len(mean) >= TELLING and apart and (steps[1:] * steps[:-1] < 0).all())


def _in_another_unit(read: CsvRecording) -> Iterator[str]:
    """What is possible, but hardly in the unit that is said."""
    for n, channel in enumerate(read.devices[DEVICE]):
        base, factor = to_si(channel.unit)
        force_n = factor * np.concatenate([press.signal.values[:, n] for press in read.presses])
        if base == "N" and np.nanmax(np.abs(force_n), initial=0.0) > PRESSED_N:
            yield (
                f"{channel.role} spans {np.nanmin(force_n):.3g} to {np.nanmax(force_n):.3g} N, "
                f"where no press of soft tissue has more than {PRESSED_N:g}: is it in mN?"
            )
    places_m = np.nan_to_num([(press.x_m, press.y_m) for press in read.presses])
    span_m = float(np.hypot(*np.ptp(places_m, axis=0)))
    places = len(np.unique(places_m, axis=0))
    if places >= MANY and span_m <= 2 * SAME_PLACE_M:
        yield (
            f"x_mm, y_mm: {places} places span {1e3 * span_m:.2g} mm in all, and all that lies "
            f"within {2e3 * SAME_PLACE_M:g} counts as one place: are they in metres?"
        )


def _never_below(read: CsvRecording) -> bool:
    """Whether depths are known, and none is below the surface."""
    known = [p.streams["depth"].values.ravel() for p in read.presses if "depth" in p.streams]
    return bool(sum(map(len, known))) and float(np.concatenate(known).max()) <= 0
