"""Validation cases of reciprocity, conservation of energy, and the power of diffuse scatter."""

from functools import partial

import numpy as np
import trimesh
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree
from scipy.special import j0

import radartwin as rt
from experiments.validation.oracles import stack, traced
from experiments.validation.oracles.case import FREQUENCY_HZ, SPEED_OF_LIGHT, WAVELENGTH_M, WAVENUMBER, Case, Finding, worst
from experiments.validation.oracles.rooms import ROOMS, room_scene, rotation
from radartwin.materials import CORRELATION_M
from radartwin.scene import objects
from radartwin.simulation import diffuse, geometry, reflection_table, variant
from radartwin.simulation.curved import tube_grid, tubes
from radartwin.simulation.hits import Antennas, TraceOptions


def bistatic(
    mesh: trimesh.Trimesh, sources: np.ndarray, receivers: np.ndarray, *, cross: bool = False, density: float = 16.0, bounces: int = 1
) -> np.ndarray:
    """Return the received amplitudes (F,) of a metal target, from sources (F, 3), polarised V, to receivers (F, 3), V or (`cross`) H."""
    variant.activate()
    built = geometry.build([mesh])
    table = reflection_table.build([("metal", 0.0)], FREQUENCY_HZ)
    grid = tube_grid.towards(built.hull_points(), sources, built.centre, WAVELENGTH_M / np.sqrt(density), built.grid_shift)
    assert grid is not None
    axis = np.tile([0.1, 0.2, 0.97], (len(sources), 1))
    transmit, receive = Antennas(sources, axis), Antennas(receivers, axis, cross)
    hits = tubes.trace(built, table, grid, transmit, receive, TraceOptions(bounces))
    value = hits.amplitude[:, 0] * np.exp(1j * WAVENUMBER * (hits.length_in_m + hits.length_out_m))
    total = np.zeros(len(sources), complex)
    np.add.at(total, hits.pose, value)
    return total


def _swapped(full: bool) -> Finding:
    """Compare the amplitudes of single bounces before and after transmitter and receiver, which are 1 or 5 cm apart, exchange places."""
    meshes = [objects.plate(0.1, 0.1), objects.sphere(0.033), objects.cylinder(0.033, 0.12)]
    pairs = []
    for distance in (0.5, 1.0, 2.0) if full else (1.0,):
        transmitter = np.tile([distance, 0.0, 0.02], (2, 1))
        receiver = transmitter + np.array([[0.0, 0.01, 0.0], [0.0, 0.05, 0.01]])
        for mesh in meshes:
            there, back = bistatic(mesh, transmitter, receiver), bistatic(mesh, receiver, transmitter)
            pairs += list(zip(20 * np.log10(np.abs(there)), 20 * np.log10(np.abs(back)), strict=True))
    return worst([(float(a), float(b)) for a, b in pairs])


def _swapped_images(full: bool) -> Finding:
    """Compare every image path in closed concrete rooms with the reversed path, for levels within 40 dB of the strongest path."""
    pairs = []
    for room in ROOMS if full else ("office",):
        _, size, sensor = ROOMS[room]
        settings = traced.settings("panels", max_bounces=4)
        for paths in traced.trace(room_scene(size, "concrete"), traced.MONOSTATIC, traced.pose(sensor, rotation()), settings):
            keys = np.column_stack([paths.departure, paths.arrival, paths.length_m])
            # paths that hit the walls of a corner in another order have equal directions and length, so their sum counts as one path
            near = KDTree(keys).query_pairs(1e-6, output_type="ndarray")
            links = coo_array((np.ones(len(near)), (near[:, 0], near[:, 1])), shape=(len(keys), len(keys)))
            _, group = connected_components(links, directed=False)
            distinct = keys[np.unique(group, return_index=True)[1]]
            total = np.zeros(len(distinct), complex)
            np.add.at(total, group, paths.amplitude[:, 0])
            apart, partner = KDTree(distinct).query(distinct[:, [3, 4, 5, 0, 1, 2, 6]])
            level = np.abs(total)
            strong = level > 0.01 * level.max()
            if apart[strong].max(initial=0.0) > 1e-6:
                return Finding(float("nan"), float("nan"), float("inf"), len(distinct))
            pairs += list(zip(20 * np.log10(level[strong]), 20 * np.log10(level[partner][strong]), strict=True))
    return worst([(float(a), float(b)) for a, b in pairs])


def solid_angle(triangles: np.ndarray, point: np.ndarray) -> float:
    """Return the solid angle of triangles (N, 3, 3) that do not hide one another. Ref: van Oosterom, Strackee, IEEE T-BME 30 (1983) 125."""
    a, b, c = (triangles - point).transpose(1, 0, 2)
    la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    triple = np.einsum("ni,ni->n", a, np.cross(b, c))
    dots = la * lb * lc + (a * b).sum(1) * lc + (a * c).sum(1) * lb + (b * c).sum(1) * la
    return float(np.abs(2 * np.arctan2(triple, dots)).sum())


def _scattered(corner: bool, full: bool) -> Finding:
    """Compare the power scattered through a sphere, in both polarisations, with the power that hits the target; only more is an error."""
    source = np.array([1.0, 0.04, 0.03])
    count = 12_000 if full else 2500
    place = np.arange(count) + 0.5
    height, azimuth = 1 - 2 * place / count, np.pi * (1 + 5**0.5) * place
    away = np.stack([np.sqrt(1 - height**2) * np.cos(azimuth), np.sqrt(1 - height**2) * np.sin(azimuth), height], axis=1)
    radius = 30.0
    levels = []
    smooth = [(objects.plate(0.02, 0.02), 1), (objects.sphere(0.01, 3), 1)]
    for mesh, bounces in [(objects.dihedral(0.03, 0.03), 2)] if corner else smooth:
        sources = np.tile(source, (count, 1))
        power = sum(np.abs(bistatic(mesh, sources, radius * away, cross=h, density=4.0, bounces=bounces)) ** 2 for h in (False, True))
        # aperture of an isotropic antenna: lambda^2/(4 pi)
        scattered = float(np.mean(power)) * 4 * np.pi * radius**2 * 4 * np.pi / WAVELENGTH_M**2
        triangles = np.asarray(mesh.triangles, float)
        facing = np.einsum("ni,ni->n", np.asarray(mesh.face_normals), source - triangles[:, 0]) > 0
        levels.append(10 * np.log10(scattered / (solid_angle(triangles[facing], source) / (4 * np.pi))))
    highest = float(max(levels))
    return Finding(0.0, highest, max(0.0, highest), len(levels))


def _diffuse(full: bool) -> Finding:
    """Compare the mean diffuse power of a rough wall with Kirchhoff's integral times the share that smooth concrete reflects."""
    variant.activate()
    radar = traced.MONOSTATIC
    wavelength = SPEED_OF_LIGHT / radar.center_frequency_hz
    pairs = []
    for roughness, distance in ((0.2e-3, 1.0), (0.3e-3, 2.0), (0.5e-3, 3.0)) if full else ((0.3e-3, 2.0),):
        corners = np.array([[0.0, -1.5, -1.0], [0.0, 1.5, -1.0], [0.0, 1.5, 1.4], [0.0, -1.5, 1.4]])
        surface = rt.Surface(traced.polygon(corners), "concrete", "wall", roughness, correlation_m=CORRELATION_M)
        built = geometry.build([surface.mesh])
        strength = diffuse.strengths([surface], radar)
        powers = []
        for seed in range(64 if full else 16):
            scatterers = diffuse.cloud([surface], built, 4000, seed)
            paths = diffuse.paths(scatterers, strength, built, radar, traced.pose([distance, 0.1, 0.2])[None])
            powers.append(float((np.abs(paths.amplitude) ** 2).sum()))
        reference = rough_wall_power(corners, np.array([distance, 0.1, 0.2]), roughness, wavelength)
        pairs.append((float(10 * np.log10(reference)), float(10 * np.log10(np.mean(powers)))))
    return worst(pairs)


def rough_wall_power(corners: np.ndarray, sensor: np.ndarray, roughness_m: float, wavelength_m: float) -> float:
    """Return the ratio of diffuse received power to transmitted power of a concrete rectangle at x = 0, by Gauss-Legendre quadrature."""
    nodes, weights = np.polynomial.legendre.leggauss(200)
    (y0, z0), (y1, z1) = corners[0, 1:], corners[2, 1:]
    y, z = np.meshgrid((y0 + y1) / 2 + (y1 - y0) / 2 * nodes, (z0 + z1) / 2 + (z1 - z0) / 2 * nodes, indexing="ij")
    area = np.outer(weights, weights) * (y1 - y0) * (z1 - z0) / 4
    ray = np.stack([0 * y, y, z], axis=-1) - sensor
    distance = np.linalg.norm(ray, axis=-1)
    ray /= distance[..., None]
    cosine = np.abs(ray[..., 0])
    te, _ = stack.fresnel(stack.permittivity("concrete", SPEED_OF_LIGHT / wavelength_m), np.ones(1))
    facing = float(np.abs(te[0]) ** 2)  # facets that scatter back face the radar, so that the incidence is normal
    angles = np.linspace(0, 1.2, 200)
    table = [kirchhoff_cross_section(roughness_m, CORRELATION_M, wavelength_m, angle) for angle in angles]
    scattered = np.interp(np.arccos(cosine), angles, table)
    return float((area * facing * scattered * wavelength_m**2 / ((4 * np.pi) ** 3 * distance**4)).sum())


def kirchhoff_cross_section(roughness_m: float, correlation_m: float, wavelength_m: float, angle: float) -> float:
    """Return the cross-section per area of a rough conductor by Kirchhoff's integral over the correlation exp(-r^2/l^2)."""
    k = 2 * np.pi / wavelength_m
    radius = np.linspace(0, 7 * correlation_m, 4000)
    g = (2 * k * roughness_m * np.cos(angle)) ** 2
    coherence = np.exp(-g * (1 - np.exp(-((radius / correlation_m) ** 2)))) - np.exp(-g)
    integral = 2 * np.pi * np.trapezoid(coherence * j0(2 * k * np.sin(angle) * radius) * radius, radius)
    return float(k**2 / (np.pi * np.cos(angle) ** 2) * max(integral, 0.0))


CASES = [
    Case("reciprocity-single", "energy", "transmitter and receiver swapped, plate, sphere, can, single bounces", "itself, swapped",
         "received over transmitted power (dB)", 0.05, "dB", _swapped),
    Case("reciprocity-images", "energy", "image paths of closed concrete rooms, each against its reverse", "itself, reversed",
         "received over transmitted power (dB)", 0.05, "dB", _swapped_images),
    *(Case(f"scattered-power-{name}", "energy", f"{words}: no more power is scattered than meets it", "its solid angle",
           "scattered over intercepted power (dB)", 0.1, "dB", partial(_scattered, corner), cost)
      for name, words, corner, cost in (("single", "a plate and a sphere", False, "quick"), ("corner", "a 3 cm dihedral", True, "full"))),
    Case("diffuse-power", "energy", "mean diffuse power of rough concrete walls", "Kirchhoff's integral times facing reflection",
         "received over transmitted power (dB)", 0.25, "dB", _diffuse),
]  # fmt: skip
