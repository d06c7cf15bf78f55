"""Controllers that speak their real protocols and answer from the phantom."""

STAGES = ("ur", "grbl", "zaber", "pi", "tmcl")
DEVICES = (*STAGES, "ft300", "modbus", "netft", "lines", "taxels")
