"""Data that leave something open are refused: why, and what to add."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calibration import (
    HeartCalibration,
    fit_axes,
    fit_compliance,
    fit_force,
    fit_gravity,
    fit_heart,
    fit_latency,
    fit_surface,
    fit_tare,
    fit_taxels,
    fit_tissue,
    fit_tool,
)
from calibration.errors import CalibrationError
from calibration.heart import check_cuff
from calibration.touch import find_contact
from probe.calibrate.doubts import doubts

RNG = np.random.default_rng(1)
NOISE = RNG.standard_normal((40, 6))
LOADS = np.linspace(-20, 20, 40)
TURNS = Rotation.random(12, random_state=1).as_matrix()
ABOUT_Z = Rotation.from_rotvec(np.outer(np.linspace(0, 5, 12), [0, 0, 1])).as_matrix()
ABOUT_Y = Rotation.from_rotvec(np.outer(np.linspace(-0.7, 0.7, 12), [0, 1, 0])).as_matrix()
PLACES = RNG.uniform(0, 0.06, (12, 3))
TIME = np.arange(0, 10, 0.01)
CHIRP = np.sin(2 * np.pi * (TIME + 0.4 * TIME**2))
RAMP = np.linspace(0, 2e-3, 40)
BEATS = np.arange(150.0)


def spring(moduli: np.ndarray, depth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    unit = 1e-2 * np.maximum(depth, 0)[:, None]
    return moduli[0] * unit[:, 0], np.tile(unit, len(moduli))


def weighed(turns: np.ndarray, mass_kg: float) -> np.ndarray:
    pull = np.swapaxes(turns, 1, 2) @ np.array([0, 0, -9.8]) * mass_kg
    return np.hstack([pull, np.cross([0, 0, 0.05], pull)]) + 1e-3 * NOISE[:12]


def beating(rate_bpm: float) -> HeartCalibration:
    rng, time_s = np.random.default_rng(2), np.arange(0, 20, 0.01)
    beats_s = np.cumsum(rng.normal(60 / rate_bpm, 1.2 / rate_bpm, 200)) - 3
    since_s = time_s[:, None] - beats_s
    waves = np.exp(-(((since_s - 0.12) / 0.07) ** 2)) + 0.4 * np.exp(
        -(((since_s - 0.38) / 0.11) ** 2)
    )
    reference = waves.sum(axis=1) + 0.02 * rng.standard_normal(len(time_s))
    return fit_heart(time_s, reference, (120, 80), is_pressure=False)


REFUSED: dict[str, tuple[Callable[[], Any], str]] = {
    "force: one load only": (
        lambda: fit_force(NOISE[:, 0], np.full(40, 5.0)),
        "offset, sensitivity.*add readings at other loads",
    ),
    "force: two axes always together": (
        lambda: fit_force(NOISE[:, :2], np.outer(LOADS, [1, 2])),
        r"do not determine.*sensitivity\[0\], sensitivity\[1\]; add.*each axis alone",
    ),
    "force: it warms up as it is loaded": (
        lambda: fit_force(LOADS + NOISE[:, 0], LOADS, 20 + LOADS / 10),
        "temperature.*vary independently of the load",
    ),
    "force: three readings for three unknowns": (
        lambda: fit_force(NOISE[:3, :2], NOISE[:3, 2:4]),
        "3 readings for 3 unknowns.*at least 4 are needed",
    ),
    "force: more axes than channels": (
        lambda: fit_force(NOISE[:, :1], NOISE[:, 1:3]),
        "1 channels cannot tell 2 axes apart; leave axes out",
    ),
    "force: a sensor that was not loaded": (
        lambda: fit_force(NOISE[:, 0], LOADS),
        "no reading changes with load 0 by more than its noise: check that the loads were on this",
    ),
    "force: one reading a thousand times too large": (
        lambda: fit_force(np.where(LOADS[30] == LOADS, 1e3, 1.0) * (LOADS + NOISE[:, 0]), LOADS),
        "reading 31 is far from all others; look at it first",
    ),
    "force: one axis of two that no channel answers": (
        lambda: fit_force(np.outer(LOADS, [1, 2]) + NOISE[:, :2], np.c_[LOADS, NOISE[:, 2]]),
        "no reading changes with load 1 by more than its noise",
    ),
    "force: channels that are copies": (
        lambda: fit_force(np.outer(NOISE[:, 0] + NOISE[:, 1], [1, 2]), NOISE[:, :2]),
        "same proportion: check the wiring",
    ),
    "force: a reading that is none": (
        lambda: fit_force(np.where(LOADS > 15, np.nan, LOADS), LOADS),
        "raw: row 35 is not finite; remove",
    ),
    "force: columns of two lengths": (
        lambda: fit_force(LOADS, LOADS[:-1]),
        "same number of rows: raw has 40, load_n has 39",
    ),
    "taxels: one pressure": (
        lambda: fit_taxels(NOISE, np.full(40, 1e3)),
        "three different known pressures",
    ),
    "taxels: none answers": (
        lambda: fit_taxels(np.full((40, 6), 7.0), np.linspace(0, 1e4, 40)),
        "no taxel answers.*check the wiring",
    ),
    "gravity: all orientations equal": (
        lambda: fit_gravity(weighed(TURNS[:1].repeat(12, 0), 0.4), TURNS[:1].repeat(12, 0)),
        "do not determine.*add orientations whose down direction differs by at least 30",
    ),
    "gravity: turned about the vertical only": (
        lambda: fit_gravity(weighed(ABOUT_Z, 0.4), ABOUT_Z),
        "not all in one plane",
    ),
    "gravity: no tool": (
        lambda: fit_gravity(weighed(TURNS, 0.0), TURNS),
        "not distinguishable from 0; check the frame.*or mount a heavier tool",
    ),
    "gravity: moments in N mm of a light tool": (
        lambda: fit_gravity(weighed(TURNS, 0.05) * ([1] * 3 + [1e3] * 3), TURNS),
        r"would be 49\.\d m from the sensor, and 1 m is the most.*must be in N m \(not N mm\)",
    ),
    "tare: three readings": (lambda: fit_tare(TIME[:3], TIME[:3]), "record a second or more"),
    "tare: not in order": (
        lambda: fit_tare(np.delete(np.insert(TIME, 5, 0.03), 0), TIME),
        "time_s, row 5: 0.03 does not come after 0.04; times must increase: sort the rows by time",
    ),
    "tool: all poses equal": (
        lambda: fit_tool(PLACES, TURNS[:1].repeat(12, 0)),
        "do not determine tip.*tilted by 20 degrees or more about two",
    ),
    "tool: tilted about one axis only": (
        lambda: fit_tool(PLACES, ABOUT_Y),
        "do not determine tip y, pivot y; add poses.*two different axes",
    ),
    "axes: points of one plane": (
        lambda: fit_axes(PLACES * [1, 1, 0], PLACES),
        "nearly in one plane.*add points away",
    ),
    "axes: a mirrored frame": (
        lambda: fit_axes(PLACES, PLACES * [1, 1, -1] + 1e-6 * NOISE[:12, :3]),
        "mirrored.*swap two axes",
    ),
    "surface: collinear touches": (
        lambda: fit_surface(np.outer(RAMP[:12], [20, 10, 0.1])),
        "do not determine.*touch at more places, spread.*not along one line",
    ),
    "surface: three touches": (lambda: fit_surface(PLACES[:3]), "at least 4 are needed.*touch at"),
    "surface: five touches of a quadric": (
        lambda: fit_surface(PLACES[:5], "quadric"),
        "at least 7 are needed",
    ),
    "surface: a map of collinear touches": (
        lambda: fit_surface(np.outer(RAMP[:12], [20, 10, 0.1]), "map"),
        "not along one line",
    ),
    "surface: no such model": (
        lambda: fit_surface(PLACES, "cubic"),  # type: ignore[arg-type]
        "model = 'cubic': allowed are plane, quadric, map",
    ),
    "latency: nothing moves": (
        lambda: fit_latency(TIME, 0 * TIME, TIME, CHIRP),
        "shows no movement; record a chirp",
    ),
    "latency: a movement that repeats itself": (
        lambda: fit_latency(TIME, np.sin(60 * TIME), TIME, np.sin(60 * TIME - 0.5)),
        "several delays explain the data equally well; record a chirp",
    ),
    "latency: nothing in common": (
        lambda: fit_latency(TIME, CHIRP, TIME, RNG.standard_normal(len(TIME))),
        "correlate by only 0.*check the columns",
    ),
    "latency: at different times": (
        lambda: fit_latency(TIME, CHIRP, TIME + 20, CHIRP),
        "overlap for 0.00 s",
    ),
    "compliance: no load": (
        lambda: fit_compliance(RAMP, 0.2 * NOISE[:, 0]),
        "no more than noise; press the rigid block further",
    ),
    "compliance: one depth": (
        lambda: fit_compliance(np.full(40, 1e-3), NOISE[:, 0]),
        "too few depths; press the rigid block",
    ),
    "compliance: the wrong sign of depth": (
        lambda: fit_compliance(-RAMP, 1e4 * RAMP + 1e-3 * NOISE[:, 0]),
        "depths must grow downwards",
    ),
    "tissue: one depth": (
        lambda: fit_tissue(np.full(40, 1e-3), LOADS, spring, [5e4]),
        "depth hardly varies; indent deeper",
    ),
    "tissue: a force that pulls": (
        lambda: fit_tissue(RAMP, -RAMP, spring, [5e4]),
        "force does not rise with depth; check its sign and the tare",
    ),
    "tissue: two moduli from one curve": (
        lambda: fit_tissue(RAMP, 500 * RAMP + 1e-4 * NOISE[:, 0], spring, [5e4, 5e4]),
        "do not determine log modulus 0, log modulus 1.*or fit fewer parameters",
    ),
    "tissue: relaxation without time": (
        lambda: fit_tissue(RAMP, 500 * RAMP, spring, [5e4], relaxation_start_s=[1.0]),
        "relaxation needs time_s",
    ),
    "heart: three seconds": (
        lambda: fit_heart(TIME[:300], CHIRP[:300], (120, 80), is_pressure=True),
        "less than 5 s.*record at least ten quiet beats",
    ),
    "heart: five samples a second": (
        lambda: fit_heart(0.2 * BEATS, np.sin(1.4 * BEATS), (120, 80), is_pressure=True),
        "5 samples/s are too few for a wave; use 20",
    ),
    "heart: nothing pulses": (
        lambda: fit_heart(TIME, np.ones(len(TIME)), (120, 80), is_pressure=True),
        "does not pulse; record",
    ),
    "heart: no steady beat": (
        lambda: fit_heart(TIME, RNG.standard_normal(len(TIME)), (120, 80), is_pressure=False),
        "no steady beat; record|steady beats found; record",
    ),
    "heart: 240 beats a minute": (lambda: beating(240), "24[01] beats per minute; 30 to 210 are"),
    "heart: 280 beats a minute": (lambda: beating(280), "28[01] beats per minute; 30 to 210 are"),
    "heart: a cuff upside down": (lambda: check_cuff(80, 120), "systolic must be above diastolic"),
    "touch: nothing touched": (
        lambda: find_contact(RAMP, 0.1 * NOISE[:, 0]),
        "begin above the surface, and press until the force",
    ),
    "touch: never in the air": (
        lambda: find_contact(RAMP + 1e-3, 500 * (RAMP + 1e-3) + 1e-4 * NOISE[:, 0]),
        "in contact from the beginning; begin above",
    ),
    "touch: a step without a way in": (
        lambda: find_contact(np.repeat([-5e-4, 2e-3], 50), np.repeat([0.0, 0.577], 50)),
        "rises between two readings; begin above",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_it_is_refused_with_the_reason_and_what_to_add(case: str) -> None:
    fit, reported = REFUSED[case]
    with pytest.raises(CalibrationError, match=reported):
        fit()


@pytest.mark.parametrize("rate_bpm", [190, 205])
def test_a_fast_heart_is_not_taken_for_half_as_fast(rate_bpm: float) -> None:
    """205 beats a minute were 109 to 122 in half of the draws."""
    assert beating(rate_bpm).rate_bpm == pytest.approx(rate_bpm, rel=0.01)


@pytest.mark.parametrize("times", [1.02, 1.5, 1000.0])
def test_a_mistyped_reading_is_named(times: float) -> None:
    """As a warning where a gain can still be fitted, with the refusal where it cannot."""
    loads = np.repeat(np.arange(11.0), 3)
    raw = 100 + 20 * loads + 0.5 * NOISE[: len(loads), 0]
    assert doubts(fit_force(raw, loads)) == ()
    raw[7] *= times
    try:
        (said,) = doubts(fit_force(raw, loads))
    except CalibrationError as error:
        said = str(error)
        clipped = np.arange(len(raw))[:, None] == 2
        with pytest.raises(CalibrationError, match="reading 8 is far"):  # of the table's
            fit_force(raw, loads, saturated=clipped)
    assert "reading 8 " in said


@pytest.mark.parametrize("row", range(7))
def test_a_mistyped_reading_is_named_in_a_small_table_too(row: int) -> None:
    """Of seven readings each pulls the line to itself: none was named, however far off."""
    loads = np.array([0.0, 1.0, 2.0, 3.0, 2.0, 1.0, 0.0])
    raw = 0.2 + 1.3 * loads + 0.001 * NOISE[:7, 0]
    assert doubts(fit_force(raw, loads)) == ()
    raw[row] += 0.5
    (said,) = doubts(fit_force(raw, loads))
    assert said.startswith(f"reading {row + 1} of raw_0 is far")
