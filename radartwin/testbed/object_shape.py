"""Deform a catalogue object into the object as it was made and handled, which differs from the drawing.

The function `as_made` moves every point of an object along its radius by d(azimuth, height), and scales its height. All parts of an object
follow the same function, so that parts neither touch nor separate. The corner reflector keeps flat plates; the tips of its legs move.

The class `Form` lists the deviations of a kind of object. A tolerance of
a drawing is taken as two standard deviations:
- cans, radius and height: the Can Manufacturers Institute's sheet of the 202 drink can has a body of 2.602 +- .007 inches and a can height
  of 4.812 +- .015 inches, which are +-0.09 mm of radius and +-0.38 mm of height.
- cans, out of roundness: +-.015 inches for round drawn cans of 2 to 3.5 inches (Hudson Technologies, standards and tolerances), which is
  +-0.19 mm of radius.
- food cans, side seam: two sheets of 0.2 mm overlap, so a ridge of 0.2 mm. The width of the ridge, 3 mm, and its rounded flanks are
  order-of-magnitude estimates.
- food cans, body beads: the inspection manual of the Canadian Food Inspection Agency says that a body may have beads. Half of the cans have
  beads, 0.5 mm deep and 6 mm apart; both numbers are order-of-magnitude estimates.
- dents, ribs and label panels of bottles, bulges of flat panels, and the tolerances of bottles, mug and reflector have no source. The sizes
  of these deviations are order-of-magnitude estimates of the values that a calliper shows on ordinary goods.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import trimesh

from radartwin.scene.objects import shapes, vessels
from radartwin.scene.objects.catalogue import Entry
from radartwin.scene.surface import Surface

RING_M = 0.001  # largest vertical distance between vertices of a deformed can, a sixth of the distance between beads
TIP_M = 0.00025  # standard deviation of a tip of the corner reflector along each axis; 0.14 degrees at the end of a leg of 10 cm
SEAM_WIDTH_M = 0.003
BEAD_PITCH_M = 0.006
BEADED = 0.5  # share of the food cans with beads
RIB_PITCH_M = 0.008
DENT_WIDTH_M = 0.008  # standard deviation of a dent's Gaussian profile


@dataclass(frozen=True)
class Form:
    """Deviations of one kind of object at strength 1, in metres. Random deviations have a mean of zero, and the size is their standard
    deviation.

    Attributes:
        radius_m: deviation of the radius.
        oval_m: deviation of the radius with two maxima around the object.
        height_m: deviation of the height.
        dents: number of dents.
        dent_m: depth of a dent; depths are half-normal.
        seam_m: height of the side seam's ridge.
        bead_m: depth of the beads of a food can.
        bulge_m: deviation of the radius with two maxima around the object, largest at half height.
        label_m: depth of the label's panel, which extends from 0.2 to 0.6 of the height.
        rib_m: depth of the ribs of a bottle, which extend from 0.05 to 0.18 of the height.
    """

    radius_m: float = 0.0
    oval_m: float = 0.0
    height_m: float = 0.0
    dents: int = 0
    dent_m: float = 0.0
    seam_m: float = 0.0
    bead_m: float = 0.0
    bulge_m: float = 0.0
    label_m: float = 0.0
    rib_m: float = 0.0


_CAN = {"radius_m": 0.045e-3, "oval_m": 0.095e-3, "height_m": 0.19e-3, "dents": 2, "dent_m": 0.4e-3}
DRINK_CAN = Form(**_CAN)
FOOD_CAN = Form(**_CAN, seam_m=0.2e-3, bead_m=0.5e-3)
MUG = Form(radius_m=0.4e-3, oval_m=0.2e-3, height_m=0.5e-3)
BOTTLE = Form(radius_m=0.3e-3, oval_m=0.3e-3, height_m=0.5e-3, dents=1, dent_m=0.5e-3, bulge_m=0.5e-3, label_m=0.5e-3, rib_m=0.3e-3)


def as_made(entry: Entry, strength: float, rng: np.random.Generator) -> list[Surface]:
    """Return the surfaces of a catalogue object with its shape as made, in the object's own frame.

    Args:
        strength: 0 returns the catalogue's surfaces, 1 gives the sizes of this module. The random numbers do not depend on the strength.
    """
    surfaces = list(entry.surfaces())
    if strength == 0:
        return surfaces
    if entry.shape == "faceted":
        return [s.replaced(mesh=_moved_tips(s.mesh, strength, rng)) for s in surfaces]
    form = _form(entry)
    if entry.outline_m is not None:
        surfaces = [surfaces[0].replaced(mesh=shapes.revolution(vessels.divided(entry.outline_m, RING_M), vessels.AROUND))]
    deform = _field(form, surfaces, strength, rng)
    return [s.replaced(mesh=vessels.deformed(s.mesh, deform)) for s in surfaces]


def _form(entry: Entry) -> Form:
    if entry.material_class == "metal":
        return DRINK_CAN if entry.name.startswith("drink_can") else FOOD_CAN
    return MUG if entry.material_class == "ceramic" else BOTTLE


def _field(form: Form, surfaces: Sequence[Surface], strength: float, rng: np.random.Generator) -> Callable[[np.ndarray], np.ndarray]:
    """Return a function that moves points (N, 3) of an object, in metres."""
    points = np.concatenate([s.mesh.vertices for s in surfaces])
    top, reach = float(points[:, 2].max()), float(np.hypot(points[:, 0], points[:, 1]).max())
    radius, oval, higher, bulge = strength * np.array([form.radius_m, form.oval_m, form.height_m, form.bulge_m]) * rng.standard_normal(4)
    oval_at, bulge_at, seam_at, phase = rng.uniform(0, 2 * np.pi, 4)
    beaded = rng.random() < BEADED
    depths = strength * form.dent_m * np.abs(rng.standard_normal(form.dents))
    dents = list(zip(depths, rng.uniform(0, 2 * np.pi, form.dents), top * rng.uniform(0.15, 0.85, form.dents), strict=True))

    def deviation(azimuth: np.ndarray, z: np.ndarray) -> np.ndarray:
        share = z / top
        d = radius + oval * np.cos(2 * (azimuth - oval_at))
        d += bulge * np.cos(2 * (azimuth - bulge_at)) * np.sin(np.pi * np.clip(share, 0, 1))
        for depth, at, height in dents:
            d -= depth * np.exp(-((reach * _wrapped(azimuth - at)) ** 2 + (z - height) ** 2) / (2 * DENT_WIDTH_M**2))
        d += strength * form.seam_m * np.exp(-((reach * _wrapped(azimuth - seam_at)) ** 2) / (2 * (SEAM_WIDTH_M / 2) ** 2))
        if beaded:
            d -= strength * form.bead_m * np.sin(np.pi * z / BEAD_PITCH_M + phase) ** 2 * _between(share, 0.25, 0.75)
        d -= strength * form.label_m * _between(share, 0.2, 0.6)
        d -= strength * form.rib_m * np.sin(np.pi * z / RIB_PITCH_M + phase) ** 2 * _between(share, 0.05, 0.18)
        return d

    def moved(xyz: np.ndarray) -> np.ndarray:
        x, y, z = xyz.T
        r, azimuth = np.hypot(x, y), np.arctan2(y, x)
        scale = 1 + deviation(azimuth, z) / np.maximum(r, reach / 2)
        return np.stack([x * scale, y * scale, z * (1 + higher / top)], axis=1)

    return moved


def _wrapped(angle: np.ndarray) -> np.ndarray:
    """Return an angle in radians from -pi to pi."""
    return (angle + np.pi) % (2 * np.pi) - np.pi


def _between(share: np.ndarray, low: float, high: float) -> np.ndarray:
    """Return 1 where `share`, the relative height, is between `low` and `high`, and 0 elsewhere, with transitions of the width 0.04."""
    return np.clip((share - low) / 0.04 + 0.5, 0, 1) * np.clip((high - share) / 0.04 + 0.5, 0, 1)


def _moved_tips(mesh: trimesh.Trimesh, strength: float, rng: np.random.Generator) -> trimesh.Trimesh:
    """Move every corner of flat plates except the one at which most plates meet. Plates with a common corner stay together."""
    places, which, counts = np.unique(np.round(mesh.vertices, 9), axis=0, return_inverse=True, return_counts=True)
    steps = strength * TIP_M * rng.standard_normal(places.shape)
    steps[counts == counts.max()] = 0.0
    return trimesh.Trimesh(mesh.vertices + steps[which.ravel()], mesh.faces, process=False)
