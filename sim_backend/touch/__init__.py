"""What a finger meets over bodies, in microseconds: `kinds` of bodies, `bodies` of scenes as those,
polynomials of a `basis`, put together in a `table`; `kept` finds one, and `touch` is for
everybody's simulator.
"""
