"""Results in a notebook: HTML that parses, shows its numbers, and escapes what others wrote."""

import sys
from html.parser import HTMLParser
from pathlib import Path
from types import ModuleType
from xml.etree import ElementTree

import pytest

import palpate
from palpate import ScanResult
from sim_backend import html
from sim_backend.phantom.phantom import Respond


class Cells(HTMLParser):
    """The text of all table cells."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: list[str] = []
        self.inside = False
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:  # noqa: ARG002
        self.inside = tag == "td"

    def handle_data(self, data: str) -> None:
        if self.inside:
            self.found.append(data)
            self.inside = False


def svg_of(text: str) -> ElementTree.Element:
    return ElementTree.fromstring(text[text.index("<svg") : text.rindex("</svg>") + 6])


def test_a_scene_is_drawn_to_scale() -> None:
    shown = palpate.load_scene("TIHA")._repr_html_()
    block = svg_of(shown).find("{*}rect")
    circle = svg_of(shown).find("{*}circle")
    assert block is not None
    assert circle is not None
    scale = float(block.attrib["width"]) / 64
    assert float(block.attrib["height"]) == pytest.approx(16.83 * scale, rel=1e-2)
    assert (float(circle.attrib["cx"]) - float(block.attrib["x"])) / scale == pytest.approx(
        32, abs=0.1
    )


def test_a_press_shows_each_state() -> None:
    pressed = palpate.press("TIHA", 32.0, 2.5, (80.0, 120.0), accuracy_pct=5)
    cells = Cells(pressed._repr_html_()).found
    assert not any("e+" in cell for cell in cells), "numbers in words have no exponents"
    assert cells[0] == "80"
    assert f"{pressed.states[1].force_n:.5g}" in cells
    assert len(repr(pressed)) < 200


@pytest.fixture(scope="module")
def scanned(
    winkler: Respond, tmp_path_factory: pytest.TempPathFactory
) -> tuple[ScanResult, palpate.Finding]:
    result = palpate.scan(
        scene="TIHA", out=tmp_path_factory.mktemp("runs"), seed=1, respond=winkler
    )
    return result, palpate.detect(result.path)


def test_a_run_and_its_finding_show_their_stations(
    scanned: tuple[ScanResult, palpate.Finding],
) -> None:
    result, finding = scanned
    shown = palpate.open_run(result.path)._repr_html_()
    assert "15 complete" in Cells(shown).found
    assert len(svg_of(shown).findall("{*}circle")) == 15
    x_mm = [1e3 * one.x_m for one in palpate.open_run(result.path).recording().stations]
    assert {f"{x_mm[0]:g}", f"{x_mm[-1]:g}"} <= {
        text.text for text in svg_of(shown).findall("{*}text")
    }
    assert finding.finding in finding._repr_html_()
    assert str(result.path) in Cells(result._repr_html_()).found


def test_results_print_as_the_terminal_shows_them(
    scanned: tuple[ScanResult, palpate.Finding],
) -> None:
    result, finding = scanned
    first, *objects = str(finding).splitlines()
    assert first == f"Finding: {finding.finding}"
    assert f"x = {finding.objects[0].position_mm:.2f} mm" in objects[0]
    assert "confidence" in objects[0]
    recording = palpate.open_run(result.path).recording()
    assert len(repr(recording)) < 150
    assert repr(result) == f"ScanResult({result.path}, completed: every station is complete)"


def test_a_cell_that_scans_shows_how_far_it_is(
    winkler: Respond,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    rig = palpate.Rig.model_validate({"scan": {"start_mm": 28.0, "stations": 3}})
    palpate.scan(rig, "TIHA", tmp_path, respond=winkler)
    assert not capsys.readouterr().err
    monkeypatch.setitem(sys.modules, "ipykernel", ModuleType("ipykernel"))
    palpate.scan(rig, "TIHA", tmp_path, respond=winkler)
    shown = [line.rstrip() for line in capsys.readouterr().err.split("\r")]
    assert shown[1].startswith("station 1 of 3, x = 28.0 mm")
    assert shown[-1] == "3 of 3 stations: completed"


def test_what_others_wrote_is_escaped() -> None:
    assert "<script>" not in html.table([("<script>", "x")], ("<script>",))


def test_curves_without_a_number_are_no_picture() -> None:
    assert html.lines([1.0, 2.0], {"a": [float("nan")] * 2}, "x", "y") == ""
    assert svg_of(html.lines([1.0], {"a": [2.0]}, "x", "y")) is not None
