"""Bays: the wall between arches; with the arches they tile the unsprayed part (thesis figure 3-20)."""

from ascrcp.core.flow import Arch, Bay


def find_bays(arches: tuple[Arch, ...], unsprayed: tuple[float, float]) -> tuple[Bay, ...]:
    """Part the unsprayed length at the arches' edges at the crown.

    Args:
        arches: By rising station.
        unsprayed: First and last station [m].

    Returns:
        Bays by rising station; an end without length is left out.
    """
    first, last = unsprayed
    edges: list[tuple[float, int | None]] = [(first, None)]
    bays: list[Bay] = []
    for number, arch in enumerate(arches):
        start, before = edges[-1]
        end = min(max(arch.station - arch.width / 2, first), last)
        if end > start:
            bays.append(Bay((start, end), before, number))
        edges.append((max(start, min(arch.station + arch.width / 2, last)), number))
    start, before = edges[-1]
    if last > start:
        bays.append(Bay((start, last), before, None))
    return tuple(bays)
