"""One press of the phantom at two lumen pressures, then the same press over stiffer walls.

Run: python examples/press_and_sweep.py
"""

import palpate

pressed = palpate.press(
    "TIHA", x_mm=32.0, depth_mm=1.0, pressures_mmhg=[80.0, 120.0], accuracy_pct=5
)
low, high = pressed.states
print(f"{pressed.model}, error about {pressed.error_estimate_pct:.2g} %")
print(f"force {low.force_n_per_mm:.4g} to {high.force_n_per_mm:.4g} N per mm of finger")

table = palpate.sweep(
    "TIHA",
    {"inclusion.0.modulus_kpa": [200.0, 400.0, 800.0]},
    indentation_mm=1.0,
    accuracy_pct=5,
    out="walls.csv",
    workers=1,
)
print(table[["inclusion.0.modulus_kpa", "force_n", "pulse_n"]].to_string(index=False))
