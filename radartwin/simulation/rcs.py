"""Radar cross-section of a mesh, in the far field or as it appears at a finite distance."""

import numpy as np
import trimesh
from numpy.typing import ArrayLike

from radartwin.constants import SPEED_OF_LIGHT
from radartwin.errors import InputError, SceneError
from radartwin.materials import Layered
from radartwin.simulation import geometry as geometry_module
from radartwin.simulation import reflection_table, variant
from radartwin.simulation.curved import tube_grid, tubes
from radartwin.simulation.curved.hits import Antennas, TraceOptions

PIECES = 3  # each way, of a tube that straddles an edge
MAX_TUBES = 200_000_000  # some minutes of tracing


def rcs(
    mesh: trimesh.Trimesh,
    direction: ArrayLike,
    *,
    distance: float | None = None,
    frequency: float = 77e9,
    material: str | Layered = "metal",
    polarization: str = "VV",
    rays_per_wavelength2: float = 1.0,
    max_bounces: int = 4,
    seed: int = 0,
) -> float:
    """Monostatic radar cross-section in square metres.

    Args:
        mesh: surface in metres; edges sharper than 30 degrees stay sharp, others are curved through vertex normals.
        direction: (3,) from the mesh origin towards the radar; need not be normalised.
        distance: metres from the mesh origin to the radar, with (4 pi)^3 R^4 Pr/(Pt lambda^2) as the cross-section; None: far field.
        frequency: Hz.
        material: a name (half-space) or a Layered stack.
        polarization: transmit then receive, each V (the part of mesh +z across `direction`, of +x if parallel) or H = direction x V.
        rays_per_wavelength2: tubes per square wavelength of the aperture across `direction` at the target.
        max_bounces: reflections; paths with 1 to this many are summed.
        seed: 0 fits the grid to the target; any other shifts the whole grid by a part of a cell.
    Returns:
        Cross-section in m^2.
    Raises:
        SceneError: the radar is inside the mesh.
        MeshError: NaN, empty or oversized mesh. MaterialError: unknown or without values at this frequency.
        InputError: an argument of the wrong kind, direction of length zero, non-positive distance, frequency, ray density or bounces,
            unknown polarization.
    """
    from radartwin.scene.checks import check_mesh, inside_solid

    check_mesh(mesh, "rcs mesh")
    for name, value in (("rays_per_wavelength2", rays_per_wavelength2), ("frequency", frequency), ("distance", distance)):
        if not (name == "distance" and value is None) and not _positive(value):
            raise InputError(f"rcs: {name} must be a positive number{' of metres or None' * (name == 'distance')}, not {value!r}")
    for name, value, least in (("max_bounces", max_bounces, 1), ("seed", seed, 0)):
        if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
            raise InputError(f"rcs: {name} must be a whole number of at least {least}, not {value!r}")
    if polarization not in ("VV", "VH", "HV", "HH"):
        raise InputError(f"rcs: polarization must be VV, VH, HV or HH, not {polarization!r}")
    try:
        towards = np.asarray(direction, float).reshape(-1)
    except (TypeError, ValueError):
        towards = np.zeros(0)
    if towards.shape != (3,) or not np.isfinite(towards).all() or not np.linalg.norm(towards) > 0:
        raise InputError(f"rcs: direction must be three finite numbers, not all zero; got {direction!r}")

    if distance is not None and inside_solid(mesh, distance * towards[None] / np.linalg.norm(towards)).any():
        raise SceneError(f"rcs: the radar, {distance:g} m from the mesh origin, is inside the mesh; increase distance")

    variant.activate()
    towards = towards / np.linalg.norm(towards)
    wavelength = SPEED_OF_LIGHT / frequency
    wavenumber = 2 * np.pi / wavelength
    target = geometry_module.build([mesh])
    table = reflection_table.build([(material, 0.0)], frequency)
    if not len(target.corners):  # faces without area return nothing
        return 0.0
    shift = tuple(np.random.default_rng(seed).random(2)) if seed else target.grid_shift
    cell = wavelength / np.sqrt(rays_per_wavelength2)
    far = distance is None
    stand_off = 2 * target.extent_m + 1.0 if far else distance
    # a plane wave travels from its launch plane to the middle of the target, which need not be the mesh origin
    position = (towards * stand_off + (target.centre if far else 0.0))[None]
    grid = tube_grid.towards(target.hull_points(), position, target.centre, cell, shift, plane=far)
    if grid is None:  # so close that a planar grid cannot hold the target
        reach = float(np.linalg.norm(target.hull_points() - position, axis=1).max())
        grids = tube_grid.all_around(position, np.eye(3)[None], int(6 * (2 * reach / cell) ** 2))
    else:
        grids = [grid]
    count = sum(one.per_pose for one in grids)
    if count > MAX_TUBES:
        raise InputError(f"rcs: {count:.2g} tubes are needed, over {MAX_TUBES:.0g}; lower rays_per_wavelength2 or look from farther away")
    up = np.array([0.0, 0.0, 1.0]) if abs(towards[2]) < 1 - 1e-9 else np.array([1.0, 0.0, 0.0])
    transmit, receive = (Antennas(position, up[None], letter == "H") for letter in polarization)
    total = 0.0 + 0.0j
    for one in grids:
        hits = tubes.trace(target, table, one, transmit, receive, TraceOptions(max_bounces, pieces=PIECES))
        phase = np.exp(1j * wavenumber * (hits.length_in_m + hits.length_out_m))
        total += complex((hits.amplitude[:, 0] * phase).sum())
    if far:
        # the kernel returns E_s r / (2 k E_i), with unit incident field, for a plane wave
        return float(4 * np.pi * abs(2 * wavenumber * total) ** 2)
    return float((4 * np.pi) ** 3 * stand_off**4 * abs(total) ** 2 / wavelength**2)


def _positive(value: object) -> bool:
    """Whether it is a finite number above zero; True and "1" are not numbers."""
    return isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool) and bool(0 < value < np.inf)
