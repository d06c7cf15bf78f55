"""The style of every picture and window: colour-blind-safe colours, sizes, words.

Hues and their names are Okabe & Ito's (2008); heat maps use cividis (Nuñez, Anderton & Renslow
2018), whose lightness rises evenly and which looks alike with and without red-green vision.
"""

from collections.abc import Mapping

INK = "#1b1f24"  # replaced by the page's own text colour in HTML
BLUE = "#0072b2"
VERMILLION = "#d55e00"
GREEN = "#009e73"
PURPLE = "#cc79a7"  # theirs is called reddish purple
SKY = "#56b4e9"
ORANGE = "#e69f00"
HEAT = "cividis"

PHASE_COLOURS: Mapping[str, str] = {
    "travelling": "#9aa4ad",
    "taring": "#9aa4ad",
    "approaching": SKY,
    "indenting": ORANGE,
    "holding": GREEN,
    "retracting": PURPLE,
    "paused": "#9aa4ad",
    "stopping": VERMILLION,
}
"""What shades a trace while the probe is in a phase; phases left out are not shaded."""

ON_HEAT = ("#000000", "#ffffff")
"""What lies on a heat map is a black line within a wider white one: seen on all its colours."""

PAPER_WIDTH_IN = 3.5  # one column of an IEEE journal (21 picas)
