"""Results in a notebook: HTML that parses, shows its numbers, and escapes what others wrote."""

from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree

import pytest

import palpate
from sim_backend import html


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
    pressed = palpate.press("TIHA", 32.0, 1.0, (80.0, 120.0), model="small", accuracy_pct=10)
    cells = Cells(pressed._repr_html_()).found
    assert cells[0] == "80"
    assert f"{pressed.states[1].force_n:.5g}" in cells
    assert len(repr(pressed)) < 200


def test_a_run_and_its_finding_show_their_stations(winkler: object, tmp_path: Path) -> None:
    result = palpate.scan(scene="TIHA", out=tmp_path, seed=1, respond=winkler)  # type: ignore[arg-type]
    run = palpate.open_run(result.path)
    assert "15 complete" in Cells(run._repr_html_()).found
    assert len(svg_of(run._repr_html_()).findall("{*}circle")) == 15
    finding = palpate.detect(run.recording())
    assert finding.finding in finding._repr_html_()


def test_what_others_wrote_is_escaped() -> None:
    assert "<script>" not in html.table([("<script>", "x")], ("<script>",))


def test_curves_without_a_number_are_no_picture() -> None:
    assert html.lines([1.0, 2.0], {"a": [float("nan")] * 2}, "x", "y") == ""
    assert svg_of(html.lines([1.0], {"a": [2.0]}, "x", "y")) is not None
