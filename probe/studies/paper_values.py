"""What *Analysis of Tactile Detection and Examination of Simulated Arteries Using a Computational
Approach* gives: times of its wave, one pulse in numbers, and what each figure varies."""

TIMES_S = (1.1, 1.3, 1.4)
LEVELS_MMHG = (120.0, 90.0, 80.0)
"""Our wave's values at those times, of which the paper gives no pressures (1.1 s: systole, 1.3 s:
arbitrary, 1.4 s: diastole); the beat starts at 1 s."""
PAPER_PULSE_PA = 22.6
"""TISA at 32 mm: greatest less least von Mises stress of the three times (text on Fig. 4b)."""
FIGURES: dict[str, tuple[str, tuple[float, ...], str]] = {
    "6": ("inclusion.0.depth_mm", (4.5, 6.5, 8.5, 10.5, 12.66), "falls"),
    "7": ("indentation_mm", (0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.5, 7.0, 8.5), "rises"),
    "8": ("inclusion.0.inner_diameter_mm", (2.0, 3.0, 4.0, 4.5, 5.0), "rises"),
    "9": ("inclusion.0.modulus_kpa", (100.0, 200.0, 400.0, 800.0, 1600.0), "falls"),
}
"""By figure: the key that is varied, its values, and how the pulse answers."""
