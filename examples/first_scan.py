"""Scan the phantom with a healthy artery, store the run, and print what lies beneath.

Run: python examples/first_scan.py
"""

import palpate

result = palpate.scan(scene="TIHA", seed=1)
run = palpate.open_run(result.path)
finding = palpate.detect(run)
print(run.path)
print(finding.finding)
for one in finding.objects:
    print(f"{one.kind} at x = {one.position_mm:.2f} mm, pulse {one.pulse_pa:.0f} Pa")
