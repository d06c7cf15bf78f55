"""Controllers that speak their real protocols and answer from the phantom."""

DEVICES = ("ur", "grbl", "ft300", "modbus", "netft", "lines", "taxels")
STAGES = ("ur", "grbl")
