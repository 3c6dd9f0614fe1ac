"""Compute the echoes of fringe currents along the sharp convex rims of closed metal bodies.

Near an edge, the currents differ from those of physical optics. The difference radiates like currents along the edge. For each of the two
faces at an edge, with z = x cross n along the edge, x into the face and n its outward normal, the moments of these currents per length are

    T_x = B,    T_z = A + mu cot(b) B - cot(b)/sin(b) (1/N - U) H_z,
    A = E_z/sin(b)^2 [sin(p/N)/(N D) - U sin(p)/(mu + cos(p))],
    B = H_z/sin(b) [sin((pi - a)/N)/(N D sin(a)) - U/(mu + cos(p))],
    D = cos(p/N) - cos((pi - a)/N),    cos(a) = mu = [s . x + (s . z - cos(b)) cot(b)]/sin(b),

in units of 2j/(k Z), and the scattered field of a piece dl is S = T/(2 pi) dl, perpendicular to the direction s of the receiver.

- N pi -> angle outside the wedge. b -> angle between the incident ray and the edge. p -> angle of the source about the edge, from the face.
- U -> 1 if the face is lit, otherwise 0. E, H -> incident field and its magnetic field times the impedance Z of free space.

The first term in each bracket is the exact current of a wedge, integrated over the face along the direction in which the wave of the edge
runs, and the second term is the current of physical optics. Their poles cancel. The formula holds off the Keller cone, where the part of a
rim radiates to a receiver in any direction. It is infinite for a receiver straight ahead of the wave that runs along a face (mu = 1).
Ref: A. Michaeli, IEEE Trans. AP 32 (1984) 252 and 34 (1986) 912.

Edges of open sheets, inner edges and edges of dielectrics have no fringe currents here. Edges of
faces narrower than half a wavelength, such as seams, have none either, and waves from one rim to another are left out.
"""

import cmath
import math
from typing import NamedTuple

import numpy as np

from radartwin.compiled import compiled, fixed, innermost, shared_out
from radartwin.constants import SPEED_OF_LIGHT
from radartwin.simulation import visibility
from radartwin.simulation.curved import borders
from radartwin.simulation.curved.tube_grid import TubeGrid
from radartwin.simulation.flat.vectors import ZERO, cross, dot, moved, norm, toward, transverse, unit, vector
from radartwin.simulation.geometry import Geometry
from radartwin.simulation.hits import Antennas, Hits, TraceOptions
from radartwin.simulation.pruning import EARLY
from radartwin.simulation.reflection_table import ReflectionTable

METAL = 0.8  # smallest magnitude of the reflection coefficient of a metal, also of a rough one, at normal incidence
NARROW = 0.5  # smallest width in wavelengths of a patch whose edges have fringe currents; the theory is one of wide faces
SMALL_SINE = 1e-3  # smallest sine between ray and edge for which fringe currents radiate
AHEAD = 1e-3  # smallest difference of mu from 1
POLE = 1e-6  # smallest magnitude of a denominator whose zero cancels with another one; there, the source is turned by ten times this angle


class Rims(NamedTuple):
    """Hold M short straight pieces of edges.

    Attributes:
        middle: (M, 3) metres. length: (M,) metres. opening: (M,) angle outside the wedge as a multiple of pi.
        into, normal: (M, 2, 3) unit vectors of both faces, perpendicular to the edge: into the face, and its outward normal.
    """

    middle: np.ndarray
    length: np.ndarray
    opening: np.ndarray
    into: np.ndarray
    normal: np.ndarray


def find(geometry: Geometry, table: ReflectionTable, options: TraceOptions) -> Rims:
    """Return the convex edges between metal faces of closed bodies, in pieces of at most a wavelength."""
    edges = borders.edges(geometry)
    metal = np.abs(table.te[:, -1]).min(axis=1) > METAL
    keep = edges.solid & edges.convex & metal[geometry.surface[edges.face]].all(axis=1)
    if options.cluster is not None:
        keep &= (options.cluster[edges.face] == options.first_cluster).any(axis=1)
    wavelength = SPEED_OF_LIGHT / float(table.frequencies_hz.mean())
    keep &= (_width_m(geometry, edges)[geometry.patch[edges.face]] > NARROW * wavelength).all(axis=1)
    ends, face = edges.ends[keep], edges.face[keep]
    along = ends[:, 1] - ends[:, 0]
    length = np.linalg.norm(along, axis=1)
    along = along / length[:, None]
    # the smooth normals of both faces at the edge, which its corners share with it
    at = (geometry.corners[face][:, :, :, None] == ends[:, None, None]).all(axis=4).any(axis=3)
    normal = np.einsum("efci,efc->efi", geometry.normals[face], at)
    normal -= np.einsum("efi,ei->ef", normal, along)[..., None] * along[:, None]
    normal /= np.linalg.norm(normal, axis=2, keepdims=True)
    into = np.cross(along[:, None], normal)
    towards = geometry.corners[face].mean(axis=2) - ends[:, None].mean(axis=2)
    into *= np.sign(np.einsum("efi,efi->ef", into, towards))[..., None]
    opening = 1 + np.arccos(np.clip(np.einsum("ei,ei->e", normal[:, 0], normal[:, 1]), -1, 1)) / np.pi
    parts = np.ceil(length / wavelength).astype(int)
    of = np.repeat(np.arange(len(parts)), parts)
    place = (np.arange(len(of)) - (np.cumsum(parts) - parts)[of] + 0.5) / parts[of]
    middle = ends[of, 0] + (place * length[of])[:, None] * along[of]
    return Rims(*map(fixed, (middle, (length / np.maximum(parts, 1))[of], opening[of], into[of], normal[of])))


def _width_m(geometry: Geometry, edges: borders.Edges) -> np.ndarray:
    """Return the mean width of each smooth patch in metres, which is twice its area over the length of its borders."""
    area = 0.5 * np.linalg.norm(geometry.area_vectors, axis=1)
    length = np.repeat(np.linalg.norm(edges.ends[:, 1] - edges.ends[:, 0], axis=1), 2)
    border = np.bincount(geometry.patch[edges.face].ravel(), length, geometry.patch.max(initial=0) + 1)
    return 2 * np.bincount(geometry.patch, area, len(border)) / np.maximum(border, 1e-9)


def hits(
    geometry: Geometry, table: ReflectionTable, grid: TubeGrid, transmit: Antennas, receive: Antennas, options: TraceOptions
) -> list[Hits]:  # fmt: skip
    """Return the echoes of fringe currents as hits of one bounce; an empty list if the geometry has no such edges. The arguments are those
    of `tubes.trace`.
    """
    rims = find(geometry, table, options)
    if not len(rims.length):
        return []
    poses, wavenumbers = grid.poses, 2 * np.pi * table.frequencies_hz / SPEED_OF_LIGHT
    amplitude = np.zeros((poses, len(rims.length)), complex)
    places = [fixed(np.asarray(values, float)) for values in (grid.source, grid.forward, transmit.axis, receive.position, receive.axis)]
    shared_out(_strengths, poses, rims, *places, transmit.cross, receive.cross, grid.plane, float(wavenumbers.mean()), amplitude)
    level = np.abs(amplitude) / (2 * wavenumbers.min())
    floor = options.prune * level.max(axis=1)
    if options.least is not None:
        floor = np.maximum(floor, EARLY * options.least)
    pose, piece = np.nonzero((level > 0) & (level >= floor[:, None]))
    if not grid.plane:  # a place near the geometry has several grids
        within = grid.covers(pose, rims.middle[piece])
        pose, piece = pose[within], piece[within]
    if not geometry.convex:
        seen = _visible(geometry, rims, grid, receive.position, pose, piece)
        pose, piece = pose[seen], piece[seen]
    way, back = rims.middle[piece] - grid.source[pose], rims.middle[piece] - receive.position[pose]
    if grid.plane:
        departure = arrival = grid.forward[pose]
    else:
        departure, arrival = (w / np.linalg.norm(w, axis=1, keepdims=True) for w in (way, back))
    length_in, length_out = (np.einsum("ni,ni->n", w, d) for w, d in ((way, departure), (back, arrival)))
    # Signals have the phase factor exp(+j k L), so that amplitudes are conjugated.
    value = amplitude[pose, piece].conj()[:, None] / (2 * wavenumbers)
    return [Hits(pose, np.ones(len(pose), int), value, length_in, length_out, departure, arrival, length_in)]


def _visible(geometry, rims, grid, receiver, pose, piece) -> np.ndarray:
    """Return the mask of those pieces that source and receiver see at each pose."""
    outward = rims.normal.sum(axis=1)
    outward *= 10 * geometry.lift_m / np.linalg.norm(outward, axis=1, keepdims=True)
    start = rims.middle[piece] + outward[piece]
    seen = np.ones(len(pose), bool)
    for end in {id(e): e for e in (grid.source, receiver)}.values():
        away = -grid.forward[pose] if grid.plane else end[pose] - start
        distance = np.linalg.norm(away, axis=1)
        reach = np.full(len(pose), np.inf) if grid.plane else distance
        seen &= visibility.visible(geometry, start, away / distance[:, None], reach)
    return seen


@compiled
def _strengths(begin, stop, rims, source, forward, transmit, receiver, receive, sent_cross, got_cross, plane, wavenumber, out):
    """Write the scattered field S of each piece at the poses `begin` to `stop` - 1 for an incident field of 1 V/m at one metre from the
    source, times the spreading to the receiver, to `out` (poses, M). It is zero for pieces that the body itself hides.
    """
    for f in range(begin, stop):
        for m in range(len(rims.length)):
            way, away = vector(forward, f), moved(ZERO, vector(forward, f), -1.0)
            if not plane:
                way, away = toward(source[f], rims.middle[m], 1.0), toward(rims.middle[m], receiver[f], 1.0)
            there, back = norm(way), norm(away)
            way, away = unit(way), unit(away)
            if _inside(rims, m, way, -1.0) or _inside(rims, m, away, 1.0):
                continue
            # the polarisations; horizontal ones are turned by 90 degrees about the ray
            electric, got = transverse(transmit[f], way), transverse(receive[f], away)
            electric = cross(electric, way) if sent_cross else electric
            got = cross(away, got) if got_cross else got
            total = 0j
            for side in range(2):
                x, n = vector(rims.into[m], side), vector(rims.normal[m], side)
                total += _face(x, n, rims.opening[m], way, away, electric, cross(way, electric), got)
            # the phase along the straight piece
            along = dot(cross(rims.into[m, 0], rims.normal[m, 0]), toward(away, way, 1.0))
            phase = 0.5 * wavenumber * rims.length[m] * along
            width = math.sin(phase) / phase if abs(phase) > 1e-6 else 1.0
            out[f, m] = total * width * rims.length[m] / (2 * math.pi * (1.0 if plane else there * back))


@innermost
def _inside(rims, m, ray, sign):
    """Return whether the ray of direction sign x `ray` from an edge lies inside the wedge, that is, behind both faces."""
    return sign * dot(rims.normal[m, 0], ray) < 0 and sign * dot(rims.normal[m, 1], ray) < 0


@innermost
def _face(x, n, opening, way, away, electric, magnetic, got):
    """Return the received moment of the fringe currents on one face, got . T of the module's docstring."""
    z = cross(x, n)
    cosine = dot(z, way)
    sine = math.sqrt(max(0.0, 1 - cosine * cosine))
    if sine < SMALL_SINE:
        return 0j
    source = math.atan2(-dot(way, n), -dot(way, x)) % (2 * math.pi)
    cot = cosine / sine
    mu = min((dot(away, x) + (dot(z, away) - cosine) * cot) / sine, 1 - AHEAD)
    if abs(mu + 1) < POLE:
        mu -= 10 * POLE
    lit = source < math.pi
    if abs(mu + math.cos(source)) < POLE:
        source += 10 * POLE * (1 if source < 1 else -1)
    around = math.pi - cmath.acos(complex(mu, 0.0)) if mu > -1 else complex(0.0, math.acosh(-mu))  # pi - a
    pole = opening * (math.cos(source / opening) - cmath.cos(around / opening))
    soft = math.sin(source / opening) / pole
    hard = cmath.sin(around / opening) / (pole * cmath.sin(around))
    if lit:
        soft -= math.sin(source) / (mu + math.cos(source))
        hard -= 1 / (mu + math.cos(source))
    a = dot(z, electric) / (sine * sine) * soft
    b = dot(z, magnetic) / sine * hard
    end = cot / sine * (1 / opening - (1.0 if lit else 0.0)) * dot(z, magnetic)
    return dot(got, x) * b + dot(z, got) * (a + mu * cot * b - end)
