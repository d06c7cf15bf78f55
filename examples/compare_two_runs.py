"""Two scans beside each other: which vessel is diseased.

Run: python examples/compare_two_runs.py
"""

import palpate

runs = [palpate.scan(scene=name, seed=1).path for name in ("TIHA", "TISA")]
healthy, stenotic = (palpate.open_run(path).recording() for path in runs)
compared = palpate.compare(healthy, stenotic)
print(f"diseased: {compared.diseased}, pulse ratio {compared.pulse_ratio:.2f}")
