"""Calibrations from runs and by weights; what is fitted on arrays is in the package
`calibration`.
"""
