"""What an object is: `classifier` names it, `population` and `single_press` hold what it learnt
from.
"""
