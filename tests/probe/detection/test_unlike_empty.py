"""Presses unlike presses over nothing: a lump under a skin, unknown units, and false alarms."""

import gzip
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import skin
from paths import SHARED
from scipy.stats import binom, mannwhitneyu

from drivers.core.arrays import Array
from probe.core.recording import Recording
from probe.detection import detect, unlike_empty
from probe.storage.csv_import import import_csv
from probe.storage.run import open_run

REAL = SHARED / "real" / "taxel_presses.csv.gz"
TWENTY = np.repeat(np.arange(5), 4)  # presses over nothing, at five places


def over_nothing(rng: np.random.Generator, place: float = 0.0) -> Array:
    """Twenty presses."""
    return np.concatenate([skin.films(rng, 4, place=place) for _ in range(5)])


def chances(seed: int, lump: float, place: float = 0.0) -> Array:
    """Of ten presses at places of their own."""
    rng = np.random.default_rng(seed)
    empty = skin.recording(over_nothing(rng, place), TWENTY)
    asked = np.concatenate([skin.films(rng, 1, lump, place) for _ in range(10)])
    return unlike_empty(skin.recording(asked, np.arange(10.0)), empty).chance


@pytest.mark.parametrize("place", [0.0, 20.0])
def test_over_nothing_as_many_presses_are_unlike_as_stated(place: float) -> None:
    alarms = [int((chances(seed, 0.0, place) <= 0.1).sum()) for seed in range(60)]
    assert sum(alarms) <= binom.ppf(0.999, 600, 0.1)


def test_a_lump_is_seen_that_is_less_than_what_the_motions_change() -> None:
    """It adds 100 counts where motions change hundreds: the mean image does not tell it."""
    seen = np.concatenate([chances(seed, 100.0) for seed in range(10)])
    assert (seen <= 0.1).mean() > 0.9


def test_units_gains_and_offsets_of_taxels_do_not_matter() -> None:
    rng = np.random.default_rng(3)
    empty, asked = over_nothing(rng), skin.films(rng, 6, 60.0)
    gains, offsets = rng.uniform(0.01, 10.0, skin.TAXELS), 1e4 * rng.standard_normal(skin.TAXELS)
    one, other = (
        unlike_empty(
            skin.recording(change(asked), np.zeros(6), unit),
            skin.recording(change(empty), TWENTY, unit),
        )
        for change, unit in (
            (lambda read: read, "counts"),
            (lambda read: gains * read + offsets, "Pa"),
        )
    )
    assert other.distance == pytest.approx(one.distance, rel=1e-6)
    assert (one.presses, one.places) == (20, 5)


def test_a_dead_taxel_and_a_press_without_samples_say_nothing() -> None:
    rng = np.random.default_rng(4)
    empty, asked = over_nothing(rng), skin.films(rng, 3, 200.0)
    empty[5:, :, 0] = np.nan  # it dies
    empty[3] = asked[1] = np.nan
    found = unlike_empty(skin.recording(asked, np.zeros(3)), skin.recording(empty, TWENTY))
    assert found.presses == 19
    assert np.isnan(found.chance).tolist() == [False, True, False]


def test_counts_say_no_level_pulse_or_kind() -> None:
    found = detect(skin.recording(over_nothing(np.random.default_rng(1)), TWENTY))
    assert found.finding == "undecided"
    assert found.reason.startswith("the sensor reads counts")
    assert all(np.isnan(station.baseline_pa) for station in found.stations)


def few(count: int, unit: str = "counts", factor: float = 1.0) -> Recording:
    presses = factor * skin.films(np.random.default_rng(1), count)
    return skin.recording(presses, np.arange(count), unit)


@pytest.mark.parametrize(("empty", "said"), [
    (few(20, "Pa"), "over nothing have 8 channels in Pa, these 8 channels in counts"),
    (few(3), "too few presses over nothing: 2 where a place is left out, at least 3"),
    (few(20, factor=0.0), "all read the same"),
])  # fmt: skip
def test_what_cannot_be_compared_is_said(empty: Recording, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        unlike_empty(few(4), empty)


@pytest.mark.skipif(not REAL.exists(), reason="needs ../shared/real/taxel_presses.csv.gz")
def test_real_presses_over_a_nodule_are_unlike_those_over_nothing(tmp_path: Path) -> None:
    """A dozen presses at each of eight places; each of four over nothing is left out in turn."""
    with gzip.open(REAL, "rt") as file:
        head, *lines = file.read().splitlines()
    kept = [line for line in lines if int(line.split(",")[0]) % 20 == 0]
    (tmp_path / "presses.csv").write_text("\n".join([head, *kept]))
    mapping: dict[str, str | list[str]] = {
        "station": "press", "x_mm": "x_m [m]", "y_mm": "y_m [m]", "taxels_counts": "taxel*"
    }  # fmt: skip
    imported = import_csv(
        tmp_path / "presses.csv", tmp_path / "a.run", mapping=mapping, rate_hz=1.2
    )
    assert sum("the readings are counts" in note for note in imported.notes) == 1
    whole = open_run(imported.path).recording(any_unit=True)
    nodule = {int(line.split(",")[0]) for line in kept if "15mil" in line}
    over = tuple(s for s in whole.stations if s.index in nodule)
    empty = tuple(s for s in whole.stations if s.index not in nodule)
    areas = []
    for place in {station.x_m for station in empty}:
        held_out = tuple(s for s in empty if s.x_m == place)
        others = replace(whole, stations=tuple(s for s in empty if s.x_m != place))
        asked = replace(whole, stations=held_out + over)
        distance = unlike_empty(asked, others).distance
        areas.append(mannwhitneyu(distance[len(held_out) :], distance[: len(held_out)]).statistic)
        areas[-1] /= len(over) * len(held_out)
    assert len(areas) == 4
    assert np.mean(areas) > 0.9
