"""What a finger meets over a body, in microseconds: `kinds` of bodies, polynomials of a `basis`,
put together in a `table`; `kept` finds one.
"""
