"""What is asked before a scan, without moving: `doctor` and `preflight` of the devices, `dry_run`
of the plan, `expected_press` of what a press will give.
"""
