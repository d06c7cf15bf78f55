"""The simulated world: one phantom behind a virtual stage and sensors (`devices`).

`phantom` has the force over time, its pulse and the tissue's relaxation; the finite elements
beneath are elastic and know no time.
"""
