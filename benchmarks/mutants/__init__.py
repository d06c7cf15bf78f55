"""Mutation: each guard, stop, durability setting and check is broken in turn; who notices?

`catalogue` names the breakages, each with the tests and the kinds of the fault campaign that must
notice it; `python -m mutants` (in the folder `benchmarks`) breaks a copy of the tree and asks them.
"""
