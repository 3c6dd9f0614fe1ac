"""Build objects as triangle meshes: canonical targets, the twelve catalogue objects of the study, and meshes from files.

All dimensions are in metres and all windings are consistent. `catalogue()` lists the catalogue objects, `make(name)` builds one of them.
"""

from radartwin.scene.objects.catalogue import Entry, catalogue, entry, make
from radartwin.scene.objects.meshes import from_mesh
from radartwin.scene.objects.shapes import (
    SMOOTH_RAD,
    box,
    cylinder,
    dihedral,
    flat,
    joined,
    plate,
    revolution,
    sphere,
    trihedral,
)

__all__ = [
    "SMOOTH_RAD",
    "Entry",
    "box",
    "catalogue",
    "cylinder",
    "dihedral",
    "entry",
    "flat",
    "from_mesh",
    "joined",
    "make",
    "plate",
    "revolution",
    "sphere",
    "trihedral",
]
