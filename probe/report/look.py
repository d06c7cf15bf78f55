"""The one look of every picture and window: colours safe for colour-blind eyes, sizes, words.

Hues are Okabe & Ito's (2008); heat maps use cividis (Nuñez, Anderton & Renslow 2018), whose
lightness rises evenly and which looks alike with and without red-green vision.
"""

from collections.abc import Mapping

INK = "#1b1f24"  # replaced by the page's own text colour in HTML
BLUE = "#0072b2"
ORANGE = "#d55e00"
GREEN = "#009e73"
PINK = "#cc79a7"
SKY = "#56b4e9"
YELLOW = "#e69f00"
HEAT = "cividis"

PHASE_COLOURS: Mapping[str, str] = {
    "travelling": "#9aa4ad",
    "taring": "#9aa4ad",
    "approaching": SKY,
    "indenting": YELLOW,
    "holding": GREEN,
    "retracting": PINK,
    "paused": "#9aa4ad",
    "stopping": ORANGE,
}
"""What shades a trace while the probe is in a phase; phases left out are not shaded."""

MAX_NAMED = 3
PAPER_WIDTH_IN = 3.5  # one column of a journal page


def simulated_words(simulated: tuple[str, ...]) -> str:
    """What a reader must know first; empty for a wholly real run.

    ``simulated`` holds ``device.channel`` names; many channels of one device are counted.
    """
    devices: dict[str, list[str]] = {}
    for name in simulated:
        devices.setdefault(name.split(".", 1)[0], []).append(name)
    parts = [
        ", ".join(names) if len(names) <= MAX_NAMED else f"{device} ({len(names)} channels)"
        for device, names in devices.items()
    ]
    return f"SIMULATED: {', '.join(parts)}" if parts else ""
