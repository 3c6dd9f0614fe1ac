"""Draw deviations of a surface from its nominal thickness, permittivity, roughness and contents.

Each function takes one surface, a strength (0 leaves the surface unchanged) and the surface's own random generator, and draws the same
random numbers at every strength. The default sizes of the deviations and their sources:
- thickness: a standard deviation of 5 %. EN 520 allows +-0.5 mm for plasterboard of 12.5 mm, which is 4 %.
- permittivity: standard deviations of 10 % for the real part, and of a factor exp(0.5) for the dielectric loss. ITU-R P.2040-4 has several
  rows for each of ten materials (concrete to floorboard). At 100 GHz, the rows of one material differ by 11 % in the real part, and by 0.51
  in the logarithm of the loss. The permittivities of metal and air do not deviate.
- roughness: a factor exp(0.7) of the roughness height. Values in the literature differ by this factor of two
  (radartwin/materials/roughness.py). A nominally smooth metal surface gets a roughness height of 0.1 mm. Glass and glazed ceramic are
  smooth to micrometres (EN 572-2, EN 14411) and get 2 micrometres. Any other nominally smooth surface gets 0.3 mm, the lower end of the
  range of 0.3 to 3 mm in the paper's own calibration (implementation section).
- contents: 10 % of a liquid's permittivity, which is the uncertainty of its recipe (radartwin/materials/containers.py). A vessel also gets
  an empty space of 5 to 15 % of its height at the top, for neck and shoulder; the range of 5 to 15 % is an order-of-magnitude estimate.
"""

from __future__ import annotations

import numpy as np

from radartwin.materials import Layered, half_space, layered, varied
from radartwin.materials.containers import LIQUIDS
from radartwin.materials.permittivity_by_name import split
from radartwin.scene.scene import Surface

THICKNESS_SIGMA = 0.05
PERMITTIVITY_SIGMA = 0.10
LOSS_SIGMA = 0.5
HEIGHT_SIGMA = 0.7
ROUGHNESS_M = {"metal": 0.1e-3, **dict.fromkeys(("glass", "ceramic", "porcelain", "mirror", "tile"), 2e-6)}  # by outermost material
ROUGHNESS_OTHER_M = 0.3e-3
CONTENTS_SIGMA = 0.10
HEADSPACE = 0.10  # mean height of the empty space at the top of a filled vessel, as a fraction of the vessel's height


def vary_material(surface: Surface, strength: float, rng: np.random.Generator) -> Surface:
    """Return the surface with log-normal random deviations of its layer thickness and permittivity."""
    stack = layered(surface.material)
    count = len(stack.layers)
    thickness = np.exp(strength * THICKNESS_SIGMA * rng.standard_normal(count))
    sigmas = strength * np.array([PERMITTIVITY_SIGMA, LOSS_SIGMA])[:, None]
    real, loss = np.exp(sigmas * rng.standard_normal((2, count + 1)))
    if strength == 0:
        return surface
    backing = _varied(stack.backing, real[-1], loss[-1])
    if not stack.layers and isinstance(surface.material, str):
        return surface.replaced(material=backing)
    layers = [
        (_varied(name, e, q), depth * float(f))
        for (name, depth), f, e, q in zip(stack.layers, thickness, real[:-1], loss[:-1], strict=True)
    ]
    return surface.replaced(material=Layered(layers, backing=backing))


def vary_roughness(surface: Surface, strength: float, rng: np.random.Generator) -> Surface:
    """Return the surface with a randomly deviating roughness height; a nominally smooth surface becomes rough."""
    factor = float(np.exp(strength * HEIGHT_SIGMA * rng.standard_normal()))
    if strength == 0:
        return surface
    if surface.roughness_m:
        return surface.replaced(roughness_m=factor * surface.roughness_m)
    outermost = split(half_space(surface.material).backing)[0]  # without the deviations that `varied` writes behind the name
    return surface.replaced(roughness_m=strength * ROUGHNESS_M.get(outermost, ROUGHNESS_OTHER_M))


def vary_contents(surface: Surface, strength: float, rng: np.random.Generator) -> list[Surface]:
    """Return a vessel with a deviating liquid and an empty space at its top, as a filled part and an empty part with the same name.

    Surfaces that are not filled vessels are returned unchanged.
    """
    factor = float(np.exp(strength * CONTENTS_SIGMA * rng.standard_normal()))
    empty = strength * HEADSPACE * rng.uniform(0.5, 1.5)
    material = surface.material
    if strength == 0 or not isinstance(material, Layered) or material.backing not in LIQUIDS:
        return [surface]
    low, high = surface.mesh.bounds[:, 2]
    level = high - min(empty, 0.9) * (high - low)
    filled = Layered(material.layers, backing=varied(material.backing, factor, factor))
    parts = []
    for up, contents in ((-1.0, filled), (1.0, Layered(material.layers))):
        part = surface.mesh.slice_plane([0.0, 0.0, level], [0.0, 0.0, up])
        if part is not None and len(part.faces):
            parts.append(surface.replaced(mesh=part, material=contents, role=surface.kind))
    return parts


def _varied(name: str, real: float, loss: float) -> str:
    return name if name in LIQUIDS else varied(name, real, loss)
