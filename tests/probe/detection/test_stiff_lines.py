"""What is stiff beside a vessel, along a row, or along a line that crosses rows: never silent."""

import numpy as np
import pytest
from known_presses import recording, row, station

from drivers.core.arrays import Array
from probe.core.recording import Recording
from probe.detection import detect

GRID = np.stack(np.meshgrid(4.0 * np.arange(-5, 6), 4.0 * np.arange(-1.5, 2.0)), axis=-1)


def scanned(stiffer: Array, pulse_pa: Array | float = 0.0, turned_deg: float = 0.0) -> Recording:
    """A grid of 4 rows of 11 stations over a level of 7 kPa that is ``stiffer`` (4, 11)."""
    rng = np.random.default_rng(1)
    turn = np.radians(turned_deg)
    x, y = np.reshape(GRID @ [[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]],
                      (-1, 2)).T  # fmt: skip
    level = 7000 * (1 + stiffer.ravel()) * (1 + 0.002 * rng.standard_normal(len(x)))
    pulse = np.broadcast_to(pulse_pa, stiffer.shape).ravel()
    return recording([
        station(rng, index=i, x_mm=x[i], y_mm=y[i], level_pa=level[i], pulse_pa=pulse[i],
                hold_s=2.5, sample_hz=50.0, noise_pa=4.0)
        for i in range(len(x))
    ])  # fmt: skip


def ridge(height: float, towards_deg: float, at_mm: tuple[float, float] = (0.0, 0.0)) -> Array:
    """What a straight thing 4 mm wide makes of the stations: (4, 11)."""
    along = np.radians(towards_deg)
    aside_mm = (GRID - at_mm) @ [-np.sin(along), np.cos(along)]
    return np.asarray(height * np.exp(-(aside_mm**2) / 32))


def ball(height: float, at_mm: tuple[float, float]) -> Array:
    return np.asarray(height * np.exp(-((GRID - at_mm) ** 2).sum(axis=-1) / 32))


@pytest.mark.parametrize("height", [0.25, 1.0])
def test_a_lump_beside_a_vessel_is_not_passed_over(height: float) -> None:
    """Eleven stations with two bumps leave neither clear: it was an artery and nothing else."""
    vessel = ridge(0.12, 90.0, (-10.0, 0.0))
    found = detect(scanned(vessel + ball(height, (12.0, 2.0)), 1600 * vessel))
    assert found.finding == "artery"
    (lump,) = [one for one in found.objects if one.kind == "undecided"]
    assert 1e3 * lump.position_m == pytest.approx(12.0, abs=4.0)
    assert "a longer row can" in lump.reason


def test_a_vessel_alone_has_nothing_beside_it() -> None:
    for at_mm in (-10.0, 2.0):
        vessel = ridge(0.12, 90.0, (at_mm, 0.0))
        (one,) = detect(scanned(vessel, 1600 * vessel)).objects
        assert one.kind == "artery"


@pytest.mark.parametrize("y_mm", [2.0, 6.0])
def test_a_row_that_differs_from_the_others_is_not_nothing(y_mm: float) -> None:
    """In no row it is a bump: three times as stiff, it was "nothing". An outer one tilts a surface
    that is fitted to all, below which its neighbour then lies."""
    one_row = np.broadcast_to(2.0 * (GRID[..., 1] == y_mm), (4, 11))
    found = detect(scanned(one_row))
    assert found.finding == "undecided"
    assert f"the row at y = {y_mm} mm" in found.reason
    assert "stiffer" in found.reason
    usual_pa = float(np.median([one.baseline_pa for one in found.stations]))
    assert found.objects[0].peak_pa == pytest.approx(2 * usual_pa, rel=0.05)


def test_of_rows_that_differ_on_a_curved_surface_none_is_named() -> None:
    bent = np.broadcast_to(-0.006 * GRID[..., 1] ** 2, (4, 11))
    found = detect(scanned(bent))
    assert found.finding == "undecided"
    assert "the rows differ" in found.reason


def test_a_tilted_grid_is_nothing() -> None:
    tilted = np.broadcast_to(0.1 * np.arange(4.0)[:, None], (4, 11))
    assert detect(scanned(tilted)).finding == "nothing"


@pytest.mark.parametrize("towards_deg", [0.0, 20.0, 90.0])
def test_a_line_in_a_map_without_rows_is_not_nothing(towards_deg: float) -> None:
    found = detect(scanned(ridge(0.4, towards_deg), turned_deg=45.0))
    assert found.finding == "undecided"
    assert detect(scanned(0 * GRID[..., 0], turned_deg=45.0)).finding == "nothing"


@pytest.mark.parametrize("towards_deg", [30.0, 60.0, 90.0])
def test_a_line_right_across_a_grid_is_one_and_no_tumour(towards_deg: float) -> None:
    """One at 30 degrees was four tumours of 96 to 99 %: a tendon or a bone looks the same."""
    (one,) = detect(scanned(ridge(0.3, towards_deg))).objects
    assert one.kind == "undecided"
    assert one.confidence < 0.8
    assert "a tendon" in one.reason
    assert len(one.course) == 4


def test_each_line_of_a_grid_is_judged_by_itself() -> None:
    """Beside a second one each was a tumour of 96 to 98 %."""
    two = ridge(0.3, 90.0, (-12.0, 0.0)) + ridge(0.3, 90.0, (12.0, 0.0))
    found = detect(scanned(two))
    assert {one.kind for one in found.objects} == {"undecided"}


@pytest.mark.parametrize("bump", [0.0, 0.3])
def test_a_row_whose_y_is_not_known_is_judged(bump: float) -> None:
    """It ended in an error where it showed a lump."""
    rng = np.random.default_rng(1)
    found = detect(recording(row(rng, bump=bump, y_mm=np.nan, hold_s=2.5, sample_hz=50.0)))
    assert found.finding == ("undecided" if bump else "nothing")


def test_a_ball_in_a_grid_is_still_a_tumour() -> None:
    for at_mm in ((0.0, 0.0), (5.0, 2.0)):
        (one,) = detect(scanned(ball(0.4, at_mm))).objects
        assert one.kind == "tumour"
        assert one.confidence > 0.9
