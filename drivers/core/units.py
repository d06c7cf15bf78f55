"""Units that devices print or count in, and what they are in SI."""

SI = {
    "N": ("N", 1.0),
    "uN": ("N", 1e-6),
    "mN": ("N", 1e-3),
    "cN": ("N", 1e-2),
    "kN": ("N", 1e3),
    "g": ("N", 9.80665e-3),
    "gf": ("N", 9.80665e-3),
    "kg": ("N", 9.80665),
    "kgf": ("N", 9.80665),
    "lbf": ("N", 4.4482216152605),
    "klbf": ("N", 4448.2216152605),
    "ozf": ("N", 0.27801385095378),
    "Pa": ("Pa", 1.0),
    "hPa": ("Pa", 100.0),
    "mbar": ("Pa", 100.0),
    "kPa": ("Pa", 1e3),
    "MPa": ("Pa", 1e6),
    "N/mm2": ("Pa", 1e6),
    "N/cm2": ("Pa", 1e4),
    "bar": ("Pa", 1e5),
    "psi": ("Pa", 6894.757293168),
    "mmHg": ("Pa", 133.322387415),
    "Nm": ("Nm", 1.0),
    "Nmm": ("Nm", 1e-3),
    "N-m": ("Nm", 1.0),
    "N-mm": ("Nm", 1e-3),
    "kN-m": ("Nm", 1e3),
    "lbf-in": ("Nm", 0.1129848290276167),
    "lbf-ft": ("Nm", 1.3558179483314),
    "kgf-cm": ("Nm", 0.0980665),
    "m": ("m", 1.0),
    "cm": ("m", 1e-2),
    "mm": ("m", 1e-3),
    "um": ("m", 1e-6),
    "s": ("s", 1.0),
    "ms": ("s", 1e-3),
    "us": ("s", 1e-6),
    "ns": ("s", 1e-9),
    "min": ("s", 60.0),
}


def units_of(*si: str) -> tuple[str, ...]:
    """The units that are one of these in SI."""
    return tuple(unit for unit, (base, _) in SI.items() if base in si)


def to_si(unit: str) -> tuple[str, float]:
    """The SI unit and the factor to it; a unit that is not known stays as it is."""
    return SI.get(unit, (unit, 1.0))
