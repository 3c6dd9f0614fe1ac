"""List the sheets of a room and their usual layers in the table `SHEETS`, with a source for each row.

A plain material name of this table means a sheet of the stated thickness with air on both sides, because rooms contain these materials as
panes, boards and housings. All other plain names (concrete, brick, metal, floors, ground, liquids) mean a half-space, which is opaque. A
`Layered` stack states other thicknesses, and `Layered([], backing="glass")` is a half-space of glass.

The last number of each source text is the two-way loss in dB of a wave at normal incidence, averaged over 77 to 80.44 GHz.
"""

from typing import NamedTuple


class Sheet(NamedTuple):
    """Hold the layers of a sheet, as pairs (material name, thickness in metres) from one face to the other, and the source."""

    layers: tuple[tuple[str, float], ...]
    source: str


_BOARD = ("plasterboard", 0.0125)
_PANE = ("glass", 0.004)

SHEETS = {
    "glass": Sheet((("glass", 0.006),), "EN 572-2 lists 2 to 25 mm, doors and partitions have 6 to 12 mm; 12.6 dB"),
    "plasterboard": Sheet((_BOARD,), "EN 520, the standard board of 12.5 mm; 13.7 dB"),
    "ceiling_board": Sheet((("ceiling_board", 0.015),), "EN 13964, mineral tiles of 15 to 19 mm; 5.1 dB"),
    "wood": Sheet((("wood", 0.020),), "furniture and shelf boards of 18 to 22 mm; 24.0 dB"),
    "chipboard": Sheet((("chipboard", 0.018),), "EN 312, furniture boards of 16 to 19 mm; 24.9 dB"),
    "plywood": Sheet((("plywood", 0.015),), "EN 636, interior boards of 12 to 18 mm; 21.0 dB"),
    "clear_acrylic": Sheet((("clear_acrylic", 0.004),), "ISO 7823-1, sheets of 2 to 10 mm; 6.7 dB"),
    "hdpe": Sheet((("hdpe", 0.002),), "housings, crates and bins of 1.5 to 3 mm; 1.4 dB"),
    "pet": Sheet((("pet", 0.0005),), "blown bottles and packages of 0.3 to 0.5 mm; 2.4 dB"),
    "door": Sheet((("wood", 0.040),), "interior door leaf of 40 mm (DIN 68706-1) in solid wood; 47.4 dB"),
    "fabric": Sheet((("wood", 0.0005),), "curtains and upholstery of 0.3 to 1 mm, permittivity 2.0 as wood (materials.minc); 1.5 dB"),
    "cardboard": Sheet(
        (("chipboard", 0.0003), ("air", 0.002), ("chipboard", 0.0003)),
        "two liners of 0.3 mm, 2.6 mm in all (flute B of ISO 4046-4); cellulose has the permittivity of chipboard; 2.0 dB",
    ),
    "double glazing": Sheet((_PANE, ("air", 0.016), _PANE), "EN 1279, two panes of 4 mm and a gap of 16 mm; 21.5 dB"),
    "stud wall": Sheet((_BOARD, ("air", 0.075), _BOARD), "boards of 12.5 mm (EN 520) on studs of 75 mm; 27.3 dB"),
}

MATERIAL_THICKNESS: dict[str, float] = {
    name: sheet.layers[0][1] for name, sheet in SHEETS.items() if len(sheet.layers) == 1 and sheet.layers[0][0] == name
}
"""Thickness in metres of each material whose plain name means a sheet in air."""
