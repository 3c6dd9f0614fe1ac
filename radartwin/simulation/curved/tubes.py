"""Shooting and bouncing ray tubes with physical optics.

At each hit that the receiver sees, a tube contributes the integral of the surface currents over its footprint, with the phase expanded to
second order:

    a = -j/(8 pi) [P . V] sqrt(dOmega A)/(L_o cos t) I exp(-j k (L_i + L_o))
    V = n x (k_i x E_i + k_r x E_r) + ((E_i + E_r) x n) x s
    I = integral of w(u) w(v) exp(-j k (s_u u + s_v v + (b_uu u^2 + b_vv v^2)/2 + b_uv u v))
    p_u = x_u + k_i (x_u . n)/cos t        s_u = (k_i - s) . p_u
    b_uv = d_u . p_v + (p_u . p_v - (p_u . s)(p_v . s))/L_o - (k_i - s) . n (dn(p_u) . p_v)

Symbols: L_i -> length_in (unfolded, source to hit), L_o -> length_out (hit to receiver); k_i, k_r, s -> unit vectors of incidence, of
reflection and towards the receiver; n -> normal on the lit side, dn(p) -> its change along p; E_i, E_r -> incident and reflected field by
the TE and TM coefficients of the surface; P -> receive polarisation; x_u, d_u -> position_du, direction_du, derivatives of the ray's
position and direction along the grid; p_u -> step on the surface from tube to tube; dOmega -> weight, the solid angle of a tube (of a
plane wave, its area); A = |x_u x x_v . k_i| -> cross-section of the tube. |a|^2 is received over transmitted power between isotropic
antennas. On a perfect conductor, V is the textbook 2 n x (k x E).

Tubes are ray differentials. Over a distance t, x_u grows by t d_u. A reflection sets x_u = p_u and
d_u = d_u - 2 (d_u . n) n + 2 cos t dn(p_u) - 2 (k_i . dn(p_u)) n. A tube therefore spreads behind a curved surface, its field varies as
the inverse square root of its cross-section, and its phase turns by 90 degrees at each caustic. The contribution depends only on the
product of field and area, which goes to zero at the caustic.

The weight w is a hat (triangle function) on [-1, 1] on curved facets and in rooms, where tubes overlap by half and their weights sum to
one. It is a box (constant) on [-1/2, 1/2] on flat facets of objects. Hats smooth the phase steps between neighbouring tubes, but taper the
edges of a plate. Away from its specular direction, the echo of a plate comes only from its edges. For a 10 cm plate tilted by 10 degrees
and one tube per square wavelength, the error of the echo is -1.8 dB with hats and 0.0 dB with boxes. Tubes that straddle an edge are
divided (radartwin.simulation.curved.division). docs/decisions/001 gives the measured errors.

On a curved facet, the hit is lifted by h = -1/2 sum_{i<j} b_i b_j (n_i - n_j).(p_j - p_i) along the interpolated normal, where b are its
barycentric coordinates. Amplitudes are returned conjugated, for signals exp(+j k L), and without the propagation phase.
Ref: H. Ling, R. Chou, S. Lee, IEEE Trans. Antennas Propag. 37 (1989) 194, with an integral per tube in place of point sums.
"""

from dataclasses import replace

import numpy as np

from radartwin.simulation.curved import shell
from radartwin.simulation.curved.hits import Antennas, Hits, TraceOptions
from radartwin.simulation.curved.tube_grid import TubeGrid
from radartwin.simulation.geometry import Geometry
from radartwin.simulation.reflection_table import ReflectionTable


def trace(geometry: Geometry, table: ReflectionTable, grid: TubeGrid, transmit: Antennas, receive: Antennas, options: TraceOptions) -> Hits:
    """Trace a grid of tubes and return all hits. A Mitsuba variant must be active.

    Tubes also pass through the walls of shells (`shell.find_shells`): straight in through the near wall, reflections inside, straight out.
    In a room with several frequency nodes and pruning, the tracer first finds the tubes that matter (a few in a hundred) at one node with
    the largest reflection over the sweep, then traces only these tubes at all nodes.

    Args:
        geometry: the surfaces. table: their reflection at Q frequencies.
        grid: tubes of F poses. transmit, receive: antennas of the same poses. Antennas at equal positions have one phase centre.
        options: bounces, pruning, occlusion and division.
    """
    # a ray that leaves a convex body does not meet it again
    parts = _traced(geometry, table, None, grid, transmit, receive, replace(options, max_bounces=1) if geometry.convex else options)
    cluster = options.cluster
    shells = shell.find_shells(geometry, table, None if cluster is None else cluster == options.first_cluster)
    if shells is not None:
        inside = replace(options, max_bounces=min(options.max_bounces, shell.INSIDE))
        parts += _traced(geometry, shells.inside, shells, grid, transmit, receive, inside)
    return Hits.concatenate(parts) if parts else Hits.none(len(table.frequencies_hz))


def _traced(
    geometry: Geometry,
    table: ReflectionTable,
    shells: shell.Shells | None,
    grid: TubeGrid,
    transmit: Antennas,
    receive: Antennas,
    options: TraceOptions,
) -> list[Hits]:
    """Return the hits of reflections on the outside or, with `shells`, of tubes that pass through their walls."""
    from radartwin.simulation.curved import tracer

    if not len(geometry.corners):
        return []
    selected = None
    if options.prune and options.hats and len(table.frequencies_hz) > 1:
        envelope = None if shells is None else shells.envelope()
        found = tracer.Tracer(geometry, table.envelope(), envelope, grid, transmit, receive, options).tube_indices()
        matters = np.zeros(max((int(part.max()) + 1 for part in found), default=0), bool)
        for part in found:
            matters[part] = True
        selected = np.flatnonzero(matters)
    return tracer.Tracer(geometry, table, shells, grid, transmit, receive, options).hits(selected)
