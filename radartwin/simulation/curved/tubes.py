"""Trace ray tubes from the radar over several reflections and sum their echoes by physical optics (shooting and bouncing rays).

At each hit that the receiver sees, a tube adds the amplitude a to the received signal. This amplitude is the integral of the surface
currents over the footprint of the tube on the surface. The phase of the integrand is expanded to second order in the grid coordinates u, v:

    a = -j/(8 pi) [P . V] sqrt(dOmega A)/(L_o cos t) I exp(-j k (L_i + L_o))
    V = n x (k_i x E_i + k_r x E_r) + ((E_i + E_r) x n) x s
    I = integral of w(u) w(v) exp(-j k (s_u u + s_v v + (b_uu u^2 + b_vv v^2)/2 + b_uv u v))
    p_u = x_u + k_i (x_u . n)/cos t        s_u = (k_i - s) . p_u
    b_uv = d_u . p_v + (p_u . p_v - (p_u . s)(p_v . s))/L_o - (k_i - s) . n (dn(p_u) . p_v)

Symbols of the formulas and their names in the code:
- k is the wavenumber and t the angle of incidence.
- L_i -> length_in, path length from the source over all reflections to the hit. L_o -> length_out, distance from the hit to the receiver.
- k_i, k_r, s -> unit vectors of the incident ray, of the reflected ray and from the hit towards the receiver.
- n -> surface normal on the illuminated side; dn(p) -> change of the normal along the vector p.
- E_i, E_r -> incident field, and reflected field by the TE and TM coefficients of the surface.
- P -> receive polarisation vector.
- x_u, d_u -> position_du and direction_du, derivatives of the ray's position and direction along the grid axis u.
- p_u -> step on the surface from the centre of one tube to the centre of its neighbour along u.
- dOmega -> weight, the solid angle of a tube, or its area if the wave is plane.
- A = |x_u x x_v . k_i| -> cross-section of the tube.
|a|^2 is received over transmitted power between isotropic antennas. On a perfect conductor, V is the textbook expression 2 n x (k x E).

The tracer describes a tube by ray differentials. Over a distance t, the derivative x_u grows by t d_u. A reflection sets x_u = p_u and
d_u = d_u - 2 (d_u . n) n + 2 cos t dn(p_u) - 2 (k_i . dn(p_u)) n. A tube therefore spreads behind a curved surface. The field of a tube
varies as the inverse square root of the tube's cross-section, and the phase of the field turns by 90 degrees at each caustic. The amplitude
a depends only on the product of field and cross-section, which goes to zero at a caustic.

The weight function w is a triangle (hat) on [-1, 1] in units of the tube width. Neighbouring tubes overlap by half, and their weights sum
to one, which smooths the phase steps between them. Hats would taper the ends of a surface, whose waves are the whole echo away from the
mirror direction. Along the ends of smooth patches, pieces of constant weight therefore replace the hats (`borders`). `division` explains
which other tubes are divided. docs/decisions/001 gives measured errors.

Sharp rims of closed metal bodies also have fringe currents (`rims`). rms error of the cross-section in dB over all elevations, at one tube
per square wavelength, against a method of moments (far field by `rcs`, 1 m by `simulate`):

| body | far, VV | far, HH | 1 m, VV | 1 m, HH |
|---|---|---|---|---|
| can, radius 33 mm, height 115 mm | 1.2 | 0.4 | 0.8 | 0.3 |
| tin, radius 42 mm, height 60 mm | 1.1 | 0.5 | | |
| cup, radii 45 and 30 mm, height 90 mm | 1.4 | 0.8 | 1.6 | 0.6 |

Recessed ends and seams are decided by several reflections: the limit is about 3 dB for a recess of 3 mm, and 6 dB (VV) and 4 dB (HH) for
seams of a third of a wavelength.

On a curved facet, the tracer lifts the hit by h = -1/2 sum_{i<j} b_i b_j (n_i - n_j).(p_j - p_i) along the interpolated normal. Here b are
the barycentric coordinates of the hit, p the corners of the facet and n the normals at the corners. The tracer returns the complex
conjugate of each amplitude, because the signals have the phase factor exp(+j k L). The returned amplitude does not contain the propagation
phase. Reference: H. Ling, R. Chou, S. Lee, IEEE Trans. Antennas Propag. 37 (1989) 194. That paper sums point contributions where this
module computes an integral per tube.
"""

from dataclasses import replace

from radartwin.simulation.curved import rims, shell
from radartwin.simulation.curved.tube_grid import TubeGrid
from radartwin.simulation.geometry import Geometry
from radartwin.simulation.hits import Antennas, Hits, TraceOptions
from radartwin.simulation.reflection_table import ReflectionTable


def trace(geometry: Geometry, table: ReflectionTable, grid: TubeGrid, transmit: Antennas, receive: Antennas, options: TraceOptions) -> Hits:
    """Trace a grid of tubes and return all hits. A Mitsuba variant must be active.

    A tube that meets a sheet of layers with air behind it continues as a reflected tube and as a straight tube, through at most
    `transit.CROSSINGS` sheets. The echoes return through sheets in the same way. Tubes also pass through the walls of hollow objects
    (`shell.find_shells`). These tubes enter straight through the near wall, are reflected inside and leave straight through a wall.

    Args:
        geometry: triangles of the surfaces.
        table: reflection coefficients of the surfaces at Q frequency nodes.
        grid: grid of tubes for F sensor poses.
        transmit: transmit antennas at the F sensor poses.
        receive: receive antennas at the F sensor poses. Transmit and receive antennas at equal positions have one common phase centre.
        options: number of bounces, pruning, occlusion and division of tubes.
    """
    from radartwin.simulation.curved.tracer import Tracer

    if not len(geometry.corners):
        return Hits.none(len(table.frequencies_hz))
    cluster = options.cluster
    shells = shell.find_shells(geometry, table, None if cluster is None else cluster == options.first_cluster)
    # A ray that leaves a convex body does not meet this body again, so one bounce is enough.
    outside = replace(options, max_bounces=1) if geometry.convex else options
    panes = None if geometry.convex else shell.find_panes(geometry, table)
    parts = Tracer(geometry, table, None, grid, transmit, receive, outside, panes).hits()
    if shells is not None:
        inside = replace(options, max_bounces=min(options.max_bounces, shell.INSIDE))
        parts += Tracer(geometry, shells.inside, shells, grid, transmit, receive, inside).hits()
    parts += [] if options.hats else rims.hits(geometry, table, grid, transmit, receive, options)
    return Hits.concatenate(parts) if parts else Hits.none(len(table.frequencies_hz))
