"""Build objects as triangle meshes: canonical radar targets, and the twelve catalogue objects of the recognition study.

All dimensions are in metres, and the faces of each mesh have a consistent winding direction. `catalogue()` lists the catalogue objects, and
`make(name)` builds a catalogue object.
"""

from radartwin.scene.objects.catalogue import Entry, catalogue, entry, make
from radartwin.scene.objects.shapes import box, cylinder, dihedral, flat, joined, plate, revolution, sphere, trihedral

__all__ = [
    "Entry",
    "box",
    "catalogue",
    "cylinder",
    "dihedral",
    "entry",
    "flat",
    "joined",
    "make",
    "plate",
    "revolution",
    "sphere",
    "trihedral",
]
