"""Unique names for devices and channels whose own names may contain any character, or be equal."""

from collections.abc import Collection, Mapping, Sequence

from drivers import Channel

LABELS = ("time_s", "station", "attempt", "phase")
"""What every table of samples has beside the channels."""
ENDINGS = ("", "_saturated")
"""What each channel's name is written with."""


def distinct(
    names: Mapping[str, str], taken: Collection[str] = (), *, endings: Sequence[str] = ("",)
) -> dict[str, str]:
    """``names`` by device, none twice nor in ``taken``, also where capitals do not count.

    A number is added to all that are alike but one, if possible the device of just that name.
    ``endings``: what each name is written with, all of which must be free.
    """
    used = {name.lower() for name in taken}
    found = {}
    for device in sorted(names, key=lambda one: names[one] != one):
        number, name = 1, names[device]
        while any((name + ending).lower() in used for ending in endings):
            number += 1
            name = f"{names[device]}_{number}"
        used |= {(name + ending).lower() for ending in endings}
        found[device] = name
    return {device: found[device] for device in names}


def channel_names(channels: Sequence[Channel]) -> list[str]:
    """The channels as variables of one table, where capitals do count.

    The libraries of netCDF and HDF5 take no empty name and none with a slash.
    """
    used, found = set(LABELS), []
    for channel in channels:
        plain = channel.name.replace("/", "_") or "channel"
        number, name = 1, plain
        while any(name + ending in used for ending in ENDINGS):
            number += 1
            name = f"{plain}_{number}"
        used |= {name + ending for ending in ENDINGS}
        found.append(name)
    return found
