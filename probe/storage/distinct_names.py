"""Names of files, groups and topics for devices whose own names may hold any character."""

from collections.abc import Collection, Mapping


def distinct(names: Mapping[str, str], taken: Collection[str] = ()) -> dict[str, str]:
    """``names`` by device, none twice nor in ``taken``, also where capitals do not count.

    A number is added to all that are alike but one, if possible the device of just that name.
    """
    used = {name.lower() for name in taken}
    found = {}
    for device in sorted(names, key=lambda one: names[one] != one):
        number, name = 1, names[device]
        while name.lower() in used:
            number += 1
            name = f"{names[device]}_{number}"
        used.add(name.lower())
        found[device] = name
    return {device: found[device] for device in names}
