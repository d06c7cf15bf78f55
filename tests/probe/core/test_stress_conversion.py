"""One conversion from channel to contact stress: detection and the window show the same."""

import math

import numpy as np
import pytest
from scipy import constants

from drivers import Block, Channel
from drivers.core.units import SI, to_si
from probe.core.contact_stress import stress_conversion
from probe.core.cut_stations import record
from probe.core.errors import RunFileError
from probe.core.events import Event, Phase, PhaseEntered, RunStarted, Samples, StationEnded
from probe.core.events import StationStarted as Started
from probe.gui.state import ViewState

FACE_MM2 = 100.0
TIME_S = 0.01 * np.arange(1, 21)


def events(channels: tuple[Channel, ...], face_mm2: float | None = FACE_MM2) -> list[Event]:
    """One hold in which every channel reads 10 of its unit."""
    values = np.full((len(TIME_S), len(channels)), 10.0)
    config = {"face_mm2": face_mm2, "plan": {"stations": [[0, 0.0, 0.0]]}}
    return [
        RunStarted(0.0, "", config, {"skin": channels}),
        Started(0.0, 0, 1, 0.0, 0.0),
        PhaseEntered(0.0, Phase.HOLDING, 0),
        Samples("skin", Block(TIME_S, values, values > 99), 0, 1),
        StationEnded(1.0, 0, 1, complete=True),
    ]


def shown_pa(reported: list[Event]) -> float:
    """What the window's map shows."""
    state = ViewState()
    for event in reported:
        state.update(event)
    return state.maps[0][0]


POUND_N, GRAM_N, MILLI = constants.lbf, constants.gram * constants.g, constants.milli
KNOWN = {
    "N": 1, "uN": 1e-6, "mN": MILLI, "cN": constants.centi, "kN": 1e3,
    "g": GRAM_N, "gf": GRAM_N, "kg": 1e3 * GRAM_N,
    "kgf": constants.kgf, "lbf": POUND_N, "klbf": 1e3 * POUND_N, "ozf": POUND_N / 16,
    "Pa": 1, "hPa": 100, "mbar": MILLI * constants.bar, "kPa": 1e3, "MPa": 1e6,
    "N/mm2": 1 / MILLI**2, "N/cm2": 1 / constants.centi**2,
    "bar": constants.bar, "psi": constants.psi, "mmHg": constants.mmHg,
    "Nmm": MILLI, "N-m": 1, "N-mm": MILLI, "kN-m": 1e3, "lbf-in": POUND_N * constants.inch,
    "lbf-ft": POUND_N * constants.foot, "kgf-cm": constants.kgf * constants.centi, "mm": MILLI,
    "Nm": 1, "m": 1, "cm": constants.centi, "um": constants.micro, "s": 1, "ms": MILLI,
    "us": constants.micro, "ns": constants.nano, "min": constants.minute,
}  # fmt: skip


def test_units_are_as_large_as_scipy_says() -> None:
    assert {unit: factor for unit, (_, factor) in SI.items()} == pytest.approx(
        KNOWN, rel=1e-6
    )  # mmHg: 1.4e-7


@pytest.mark.parametrize("unit", [u for u, (si, _) in SI.items() if si in ("N", "Pa")])
@pytest.mark.parametrize("role", ["force", "pressure", "taxel"])
def test_the_window_and_detection_see_the_same_stress(unit: str, role: str) -> None:
    count = 4 if role == "taxel" else 1
    reported = events(tuple(Channel(f"c{n}", unit, role) for n in range(count)))
    si, factor = to_si(unit)
    expected = 10.0 * factor if si == "Pa" else 10.0 * factor * count / (1e-6 * FACE_MM2)
    (station,) = record(reported).stations
    assert station.signal_pa == pytest.approx(expected)
    assert shown_pa(reported) == pytest.approx(expected)


def test_a_force_goes_before_the_taxels_beside_it() -> None:
    own = (Channel("t", "Pa", "taxel"), Channel("f", "N", "force"), Channel("p", "Pa", "pressure"))
    conversion = stress_conversion(own, 1e-4)
    assert conversion.columns == (1,)
    assert conversion.stress_pa(np.array([[1.0, 2.0, 3.0]])) == pytest.approx(2e4)
    assert shown_pa(events(own)) == pytest.approx(record(events(own)).stations[0].signal_pa[0, 0])


@pytest.mark.parametrize(
    ("unit", "face_mm2", "said"),
    [("raw", FACE_MM2, "'raw'; a tactile signal is in one of N, "), ("N", None, "face")],
)
def test_what_is_no_stress_is_not_drawn(unit: str, face_mm2: float | None, said: str) -> None:
    reported = events((Channel("f", unit, "force"),), face_mm2)
    with pytest.raises(RunFileError, match=said):
        record(reported)
    state = ViewState()
    for event in reported:
        state.update(event)
    assert state.maps == {}
    assert state.signal_device == ""
    assert said.split(";")[0] in state.notes[0].text


def test_an_unknown_face_is_known_only_where_pressures_are_read() -> None:
    assert stress_conversion((Channel("p", "mbar", "pressure"),), math.nan).pa_per_unit == 100.0
