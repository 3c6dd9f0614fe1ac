"""Objects as triangle meshes: canonical targets, and what a catalogue is built of.

All dimensions in metres, all windings consistent.
"""

from radartwin.scene.objects.shapes import (
    SMOOTH_RAD,
    box,
    cylinder,
    dihedral,
    joined,
    plate,
    revolution,
    sphere,
    trihedral,
)

__all__ = ["SMOOTH_RAD", "box", "cylinder", "dihedral", "joined", "plate", "revolution", "sphere", "trihedral"]
