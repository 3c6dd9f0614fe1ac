"""Build objects as triangle meshes: canonical targets and the twelve catalogue objects of the study.

All dimensions are in metres and all windings are consistent. `catalogue()` lists the catalogue objects, `make(name)` builds one of them.
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
