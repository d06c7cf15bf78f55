"""Maps and section of a window: rows, grids, taxels, and the finger over what lies beneath."""

from dataclasses import replace

import numpy as np
import pytest
from PySide6.QtCore import QPointF
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication
from run_windows import FINDING, LEFT, Make, Shoot, measured, window_on

from drivers import Channel
from drivers.core.array_layout import taxel_names
from probe.core.events import Samples, StationEnded
from probe.gui.body import BodyPanel
from probe.gui.maps import MapPanel
from probe.gui.state import ViewState
from probe.gui.style import application


@pytest.mark.parametrize("size", [(1366, 768), (3840, 2160)], ids=["1366x768", "4k"])
def test_a_finished_grid_fits_small_and_large_screens(
    size: tuple[int, int], make_run: Make, shoot: Shoot
) -> None:
    application(size[1] / 1080 if size[1] > 1080 else None)
    window = window_on(make_run(rows=6, columns=15))
    shoot(window, f"live_grid_{size[0]}", size)
    assert window.maps.currentWidget() is window.maps.area
    assert np.nanmax(window.maps.grid_pulse.image.image) > 0
    assert window.maps.grid.image.image.shape == (6, 15)
    assert np.isfinite(window.maps.grid.image.image).all()


def test_a_grid_drawn_while_it_grows_ends_as_one_drawn_at_once(make_run: Make) -> None:
    events = make_run(rows=3, columns=5)
    state, panel = ViewState(), MapPanel()
    for n, event in enumerate(events):
        state.update(event)
        if n % 7 == 0 and state.is_grid:
            panel.show_state(state)
    panel.show_state(state)
    at_once = MapPanel()
    at_once.show_state(state)
    assert np.isfinite(at_once.grid.image.image).all()
    assert np.array_equal(panel.grid.image.image, at_once.grid.image.image)


def test_a_grids_course_is_drawn_over_its_pulses(make_run: Make) -> None:
    window = window_on(make_run(rows=6, columns=15))
    state = window.state()
    stations = measured(len(state.plan))
    course = [[30.0, 0.0], [32.0, 4.0], [34.0, 8.0]]
    one = {"kind": "artery", "course_mm": course, "stenosed_mm": [4.0, 8.0]}
    state.judge({"objects": [one], "stations": stations, "heart_rate_bpm": None})
    window.maps.show_state(state, state.finding)
    vessel, stenosed = window.maps.grid_pulse.courses
    assert np.column_stack(vessel.getData()).tolist() == course
    assert np.column_stack(stenosed.getData()).tolist() == course[1:]
    state.judge({"objects": [], "stations": stations, "heart_rate_bpm": None})
    window.maps.show_state(state, state.finding)
    assert window.maps.grid_pulse.courses == []
    assert vessel not in window.maps.grid_pulse.plot.items


@pytest.mark.parametrize(("below_pa", "ends"), [(None, (0.0, 2.0)), (9.0, (0.0, 1.0))])
def test_a_grids_pulses_are_on_a_scale_from_0_also_where_none_is_seen(
    below_pa: float | None, ends: tuple[float, float], make_run: Make
) -> None:
    window = window_on(make_run(rows=2, columns=3))
    state = window.state()
    stations = [one | {"pulse_below_pa": below_pa} for one in measured(len(state.plan))]
    state.judge({"objects": [], "stations": stations, "heart_rate_bpm": None})
    window.maps.show_state(state, state.finding)
    assert window.maps.grid_pulse.bar.levels() == ends


def test_the_first_cell_of_a_map_has_a_numbered_scale(make_run: Make) -> None:
    window = window_on(make_run(rows=3, columns=5))
    window.maps.grid.show_table(np.array([[6.5]]), (0, 0, 1, 1))
    low, high = window.maps.grid.bar.levels()
    assert low < 6.5 < high and high - low == pytest.approx(1.0)


def test_an_array_shows_its_taxels(make_run: Make, shoot: Shoot) -> None:
    """In the rows and columns of their names (4 x 7 were drawn as 7 x 4), in a line without."""
    events = make_run(columns=1, taxels=28)
    window = window_on(events)
    window.frame()
    assert window.maps.currentWidget() is window.maps.row
    assert not window.maps.line.isVisible()
    assert window.maps.taxels.level.image.image.shape == (1, 28)
    begun = events[0]
    named = [Channel(f"r{n // 7}c{n % 7}", "N", "taxel", True) for n in range(28)]
    begun = replace(begun, channels={**begun.channels, "virtual": tuple(named)})
    window = window_on([begun, *events[1:]])
    shoot(window, "live_taxels")
    shown = window.maps.taxels.level.image.image
    assert shown.shape == (4, 7)
    assert shown[3, 6] == pytest.approx(1.5 * shown[0, 0], rel=1e-6)  # as the finger presses them
    assert shown.mean() > 1.0, "the hold is shown, and not the air after it"
    pulse = window.maps.taxels.pulse.image.image
    assert pulse.shape == (4, 7)
    assert pulse[3, 6] == pytest.approx(1.5 * pulse[0, 0], rel=1e-6)


def test_each_press_of_a_row_has_its_image_with_a_dead_taxel_as_not_seen(
    make_run: Make, shoot: Shoot
) -> None:
    begun, *events = make_run(columns=3, taxels=6)
    named = [Channel(name, "N", "taxel", True) for name in taxel_names(2, 3)]
    named[4] = replace(named[4], role="other")
    window = window_on(
        [replace(begun, channels={**begun.channels, "virtual": tuple(named)}), *events]
    )
    window.frame()
    shoot(window, "live_row_of_an_array")
    panel = window.maps.taxels
    assert window.maps.line.isVisible()
    assert panel.isVisible()
    last = panel.level.image.image.copy()
    np.testing.assert_equal(np.isnan(last), [[False] * 3, [False, True, False]])
    assert np.column_stack(panel.level.unseen.getData()).tolist() == [[1.5, 1.5]]
    held = window.state().images
    assert sorted(held) == [0, 1, 2]
    window.maps.chosen = 0
    window.maps.show_state(window.state())
    np.testing.assert_allclose(panel.level.image.image[0, 0], held[0][0] / 1e3)
    assert not np.array_equal(panel.level.image.image, last, equal_nan=True)
    assert not panel.pulse.isVisible()  # it is known of the latest only


@pytest.mark.parametrize(("rows", "columns"), [(1, 8), (4, 7), (8, 8), (16, 16)])
def test_each_taxel_is_drawn_in_its_row_and_column(rows: int, columns: int, make_run: Make) -> None:
    """Row 0 at the bottom, as y grows upwards: the pixel over (column, row) is that taxel's."""
    count = rows * columns
    begun, *events = make_run(columns=1, taxels=count)
    named = tuple(Channel(name, "N", "taxel", True) for name in taxel_names(rows, columns))
    window = window_on([replace(begun, channels={**begun.channels, "virtual": named}), *events])
    window.frame()
    image = window.maps.taxels.level.image
    wanted = np.linspace(0.8, 1.2, count).reshape(rows, columns)  # as the finger presses them
    np.testing.assert_allclose(image.image / image.image[0, 0], wanted / wanted[0, 0], rtol=1e-6)
    middle = image.mapFromParent(QPointF(columns - 0.5, 0.5))  # the last column of row 0
    assert image.image[int(middle.y()), int(middle.x())] == image.image[0, -1]


def test_a_pulse_that_was_not_seen_is_not_drawn_as_0(make_run: Make, shoot: Shoot) -> None:
    for rows in (1, 2):
        window = window_on(make_run(rows=rows, columns=3))
        state = window.state()
        stations = measured(len(state.plan))
        stations[1]["pulse_below_pa"] = 8.0
        state.judge(FINDING | {"stations": stations})
        window.maps.show_state(state)
        if rows == 1:
            shoot(window, "live_not_seen")
            assert window.maps.line.beat_curve.getData()[0].tolist() == [4.0, 12.0]
            assert np.column_stack(window.maps.line.unseen.getData()).tolist() == [[8.0, 8.0]]
            assert window.maps.line.meaning.isVisible()
        else:
            shoot(window, "live_not_seen_grid")
            assert np.isnan(window.maps.grid_pulse.image.image[0, 1])
            assert np.column_stack(window.maps.grid_pulse.unseen.getData()).tolist() == [[8.0, 0.0]]


def test_a_click_on_a_place_shows_its_signal(make_run: Make, shoot: Shoot) -> None:
    window = window_on(make_run())
    shoot(window, "live_not_chosen")
    area = window.maps.line.beat
    spot = area.getPlotItem().vb.mapViewToScene(QPointF(32.4, 1.0))
    title = window.traces.trace.getPlotItem().titleLabel

    def click() -> None:
        QTest.mouseClick(area.viewport(), LEFT, pos=area.mapFromScene(spot))
        QTest.qWait(QApplication.doubleClickInterval() + 50)
        window.frame()

    click()
    shoot(window, "live_chosen")
    assert title.text == "Signal of station 8 at x = 32 mm; click it again for the latest"
    assert "at station 8" in window.traces.beat.getPlotItem().titleLabel.text
    stress_kpa = window.traces.curves[0].getData()[1]
    assert stress_kpa.max() == pytest.approx(7.71, abs=0.01)
    click()
    assert title.text.startswith("Signal of virtual")


@pytest.mark.parametrize("surface_mm", [None, 12.0])
def test_the_finger_is_drawn_over_the_surface_that_the_scan_has(
    surface_mm: float | None, make_run: Make
) -> None:
    """Held 2.5 mm deep, however high the surface lies in the scan's frame."""
    events, state, panel = make_run(columns=1), ViewState(), BodyPanel()
    started = events[0]
    if surface_mm is not None:
        started.config["plan"]["surface_mm"] = [surface_mm]
    for event in events:
        if isinstance(event, Samples) and event.device == "stage":
            event.block.values[:, 2] += 1e-3 * (surface_mm or 0.0)
        state.update(event)
        if len(state.hold()[0]) > 50:
            break
    panel.show_state(state)
    assert np.min(panel.finger.getData()[1]) == pytest.approx(16.83 - 2.5)


def test_a_grid_shows_the_section_of_the_row_that_is_pressed(make_run: Make) -> None:
    events = make_run(rows=2, columns=2)  # 4 mm apart
    started = events[0]
    started.config["scene"]["inclusion"][0]["path"] = [[0.0, 20.0, 12.66], [4.0, 40.0, 12.66]]
    state, panel, middles = ViewState(), BodyPanel(), []
    for event in events:
        state.update(event)
        if isinstance(event, StationEnded):
            panel.show_state(state)
            vessel = panel.area.getPlotItem().listDataItems()[-1]
            middles.append(float(np.mean([vessel.xData.min(), vessel.xData.max()])))
    assert middles == pytest.approx([20.0, 20.0, 40.0, 40.0], abs=0.01)


def test_where_the_section_is_unknown_the_surface_reaches_under_the_whole_finger(
    make_run: Make,
) -> None:
    events, state, panel = make_run(), ViewState(), BodyPanel()
    started = events[0]
    started.config["scene"] = None
    for event in events:
        state.update(event)
        if isinstance(event, StationEnded):
            panel.show_state(state)
            (surface,) = (
                c for c in panel.area.getPlotItem().listDataItems() if c is not panel.finger
            )
            finger_mm = panel.finger.getData()[0]
            assert surface.xData.min() <= finger_mm.min() + 1e-6
            assert surface.xData.max() >= finger_mm.max() - 1e-6
