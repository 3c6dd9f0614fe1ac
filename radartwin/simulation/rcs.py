"""Compute the radar cross-section (RCS) of a mesh, in the far field or at a finite distance."""

import numpy as np
import trimesh
from numpy.typing import ArrayLike

from radartwin.constants import SPEED_OF_LIGHT
from radartwin.errors import InputError, SceneError
from radartwin.materials import Layered
from radartwin.scene.mesh_checks import check_mesh, inside_solid
from radartwin.simulation import geometry as geometry_module
from radartwin.simulation import reflection_table, variant
from radartwin.simulation.argument_checks import check_option, check_positive, check_whole
from radartwin.simulation.curved import tube_grid, tubes
from radartwin.simulation.hits import Antennas, TraceOptions

MAX_TUBES = 200_000_000  # largest number of ray tubes per call of `rcs`; tracing this number of tubes takes some minutes


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
    """Compute the monostatic radar cross-section of a mesh in square metres, by ray tubes.

    The result includes the edge waves (fringes) of closed metal bodies, but not those of open sheets, which `simulate` adds. For a plate of
    5 to 10 cm that is turned by 20 to 60 degrees, the result is therefore 1 to 9 dB lower than the echo of `simulate` at 2 m.

    Args:
        mesh: surface with coordinates in metres. Edges sharper than 30 degrees stay sharp; across all other edges the surface is curved.
        direction: (3,) vector from the mesh origin towards the radar, of any length.
        distance: distance R from the mesh origin to the radar in metres; the result is then (4 pi)^3 R^4 Pr/(Pt lambda^2), with the
            received power Pr and the transmitted power Pt. None computes the cross-section in the far field.
        frequency: frequency in Hz.
        material: name of a material, which then fills the half-space behind the surface, or a Layered stack.
        polarization: polarisation of the transmitter, then of the receiver, each V or H. The V vector is the component of the mesh's +z
            axis perpendicular to `direction`. If +z and `direction` are parallel, the +x axis replaces +z. The H vector is the cross
            product of `direction` and V.
        rays_per_wavelength2: number of ray tubes per square wavelength at the target, in the plane perpendicular to `direction`.
        max_bounces: largest number of reflections per path. The function sums all paths with 1 to `max_bounces` reflections.
        seed: 0 aligns the grid of tubes with the target; any other seed shifts the whole grid by a random fraction of a cell.
    Returns:
        Radar cross-section in m^2.
    Raises:
        SceneError: the radar is inside the mesh.
        MeshError: the mesh has NaN coordinates, no faces or an implausible size.
        MaterialError: the material is unknown or has no values at this frequency.
        InputError: another argument has the wrong type or is out of range, or the settings need too many tubes.
    """
    check_mesh(mesh, "rcs mesh")
    check_positive("rcs: rays_per_wavelength2", rays_per_wavelength2)
    check_positive("rcs: frequency", frequency)
    if distance is not None:
        check_positive("rcs: distance (metres, or None for the far field)", distance)
    check_whole("rcs: max_bounces", max_bounces, 1)
    check_whole("rcs: seed", seed, 0)
    check_option("rcs: polarization", polarization, ("VV", "VH", "HV", "HH"))
    towards = _unit_direction(direction)
    if distance is not None and inside_solid(mesh, distance * towards[None]).any():
        raise SceneError(f"rcs: the radar, {distance:g} m from the mesh origin, is inside the mesh; increase distance")

    variant.activate()
    wavelength = SPEED_OF_LIGHT / frequency
    wavenumber = 2 * np.pi / wavelength
    target = geometry_module.build([mesh])
    table = reflection_table.build([(material, 0.0)], frequency)
    if not len(target.corners):  # all faces have zero area
        return 0.0
    far = distance is None
    stand_off = 2 * target.extent_m + 1.0 if far else distance
    # In the far field, the tubes of the plane wave are aimed at the middle of the target, which may differ from the mesh origin.
    position = (towards * stand_off + (target.centre if far else 0.0))[None]
    shift = tuple(np.random.default_rng(seed).random(2)) if seed else target.grid_shift
    grids = _grids(target, position, wavelength / np.sqrt(rays_per_wavelength2), shift, far)
    up = np.array([0.0, 0.0, 1.0]) if abs(towards[2]) < 1 - 1e-9 else np.array([1.0, 0.0, 0.0])
    transmit, receive = (Antennas(position, up[None], letter == "H") for letter in polarization)
    total = 0.0 + 0.0j
    for grid in grids:
        hits = tubes.trace(target, table, grid, transmit, receive, TraceOptions(max_bounces))
        phase = np.exp(1j * wavenumber * (hits.length_in_m + hits.length_out_m))
        total += complex((hits.amplitude[:, 0] * phase).sum())
    if far:
        # For a plane wave, the tracer returns E_s r / (2 k E_i), with the scattered field E_s at distance r and the incident field E_i.
        return float(4 * np.pi * abs(2 * wavenumber * total) ** 2)
    return float((4 * np.pi) ** 3 * stand_off**4 * abs(total) ** 2 / wavelength**2)


def _unit_direction(direction: ArrayLike) -> np.ndarray:
    try:
        towards = np.asarray(direction, float).reshape(-1)
    except (TypeError, ValueError):
        towards = np.zeros(0)
    if towards.shape != (3,) or not np.isfinite(towards).all() or not np.linalg.norm(towards) > 0:
        raise InputError(f"rcs: direction must be three finite numbers, not all zero; got {direction!r}")
    return towards / np.linalg.norm(towards)


def _grids(
    target: geometry_module.Geometry, position: np.ndarray, cell_m: float, shift: tuple[float, float], far: bool
) -> list[tube_grid.TubeGrid]:
    """Return one grid of tubes over the target, or a grid for each face of a cube if the target is too close for a planar grid."""
    points = target.hull_points()
    grid = tube_grid.towards(points, position, target.centre, cell_m, shift, plane=far)
    if grid is None:
        reach = float(np.linalg.norm(points - position, axis=1).max())
        faces = tube_grid.cube_faces(points, position[0], np.eye(3))
        grids = tube_grid.all_around(position, np.eye(3)[None], int(6 * (2 * reach / cell_m) ** 2), faces)
    else:
        grids = [grid]
    if (count := sum(grid.per_pose for grid in grids)) > MAX_TUBES:
        raise InputError(f"rcs: {count:.2g} tubes are needed, over {MAX_TUBES:.0g}; lower rays_per_wavelength2 or look from farther away")
    return grids
