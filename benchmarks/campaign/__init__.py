"""The fault campaign: what a scan does when something happens that nobody planned.

`world` is the truth: a tip on three axes over a soft bed, written for the campaign and sharing
nothing with the phantom. `serve` runs it in a process of its own, behind a GRBL board (`board`)
and a load cell that prints lines (`cell`), on real ports; `scanning` starts the real `palpate
scan` in another, on a terminal of its own; `faults` draws what goes wrong and when, `strikes` and
`host` do it; `judge` looks at the truth, the run file (`stored`), the exit status and the words,
and at nothing that a guard said.
`simulated` runs the same world, faults and judge on simulated time in one process.

    python -m campaign --help        (in the folder `benchmarks`)
"""
