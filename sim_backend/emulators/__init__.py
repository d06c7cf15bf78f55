"""Controllers that speak their real protocols and answer from the phantom.

A new one is a module with an ``emulate`` like `lines` (a sensor) or `zaber` (a stage), served by
`serving`; its name belongs below.
"""

STAGES = ("ur", "grbl", "zaber", "pi", "tmcl")
DEVICES = (*STAGES, "ft300", "modbus", "netft", "lines", "taxels")
