"""What a tube's footprint sends to the receiver.

Formulas and symbols as in `radartwin.simulation.curved.tubes`. Import only once a Mitsuba variant is active.
"""

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from radartwin.simulation.curved.contact import Contact, across_incidence
from radartwin.simulation.curved.device import Device
from radartwin.simulation.curved.flight import Tubes
from radartwin.simulation.curved.footprint import footprint_integral

MOST_BEND = 3.0  # second-order phase, radians, that a footprint on a curved surface follows unless it is steep
TERMINATOR = 0.4  # cosine below which a curved surface's currents fade away from its mirrored direction


def scatter(
    device: Device,
    tubes: Tubes,
    contact: Contact,
    outgoing: Any,
    length_out: Any,
    receive_axis: Any,
    wavenumber: Any,
    active: Any,
    plane: bool,
) -> list[tuple[Any, Any]]:
    """Contribution of every tube to the receiver per node, (real, imaginary) of P.V times its integral; mirrors the tubes' fields.

    `receive_axis` is P, or per node its real and imaginary part.
    """
    # s across the plane of incidence, p along the field in it, before and after
    s = across_incidence(tubes.direction, contact.normal)
    mirrored = contact.mirrored(tubes.direction)
    p_in, p_out = dr.cross(tubes.direction, s), dr.cross(mirrored, s)
    inverse_out = mi.Float(0.0) if plane else dr.rcp(length_out)
    change = tubes.direction - outgoing  # gradient of the path length at the hit
    foots = tubes.foot_u, tubes.foot_v
    onward = (1 - dr.dot(tubes.direction, outgoing)) * dr.rcp(contact.cosine)  # of the path for a hit that lies deeper along the ray
    steps = [contact.step(tubes.direction, place) for place in (tubes.place_u, tubes.place_v)]
    turns = [contact.turn(step) for step in steps] if device.curved else []
    alongs = [dr.dot(step, outgoing) for step in steps]

    def bend(i: int, j: int) -> Any:
        value = dr.dot(foots[i], steps[j]) + (dr.dot(steps[i], steps[j]) - alongs[i] * alongs[j]) * inverse_out
        return value + onward * dr.dot(turns[i], steps[j]) if device.curved else value

    hat = device.hats
    if device.curved:
        hat = hat | contact.bends()
    slopes = [wavenumber * dr.dot(change, step) for step in steps]
    bends = [0.5 * wavenumber * bend(i, i) for i in range(2)]
    if device.curved:  # near a shadow line the expansion means nothing beyond this
        for i, slope in enumerate(slopes):
            most = dr.select(contact.bends(), dr.maximum(0.25 * dr.abs(slope), MOST_BEND), dr.inf)
            bends[i] = dr.clip(bends[i], -most, most)
    re, im = footprint_integral(slopes, bends, wavenumber * bend(0, 1), hat)
    # field times area: the field falls with the square root of the cross-section, and stays finite where that vanishes
    cross_section = dr.abs(dr.dot(dr.cross(tubes.place_u, tubes.place_v), tubes.direction))
    level = dr.sqrt(tubes.weight * cross_section) * dr.rcp(8 * np.pi * contact.cosine) * (1.0 if plane else inverse_out)
    if device.curved:
        # currents end at the shadow line of a curved surface only in physical optics; faded out there, save towards the mirrored ray
        fade = TERMINATOR * 0.5 * (1 - dr.dot(mirrored, outgoing))
        least = dr.minimum(contact.cosine, dr.dot(contact.normal, outgoing))
        x = dr.clip(least * dr.rcp(dr.maximum(fade, 1e-6)), 0, 1)
        level *= dr.select(contact.bends(), x * x * (3 - 2 * x), 1.0)
    if tubes.share is not None:
        level *= dr.select(hat, tubes.share, dr.select(tubes.whole, mi.Float(1.0), 0.0))
    total_re, total_im = re * level, im * level
    total_re, total_im = dr.select(active, total_re, 0.0), dr.select(active, total_im, 0.0)
    out = []
    for node in range(device.nodes):
        e_re, e_im = tubes.field_re[node], tubes.field_im[node]
        te_re, te_im, tm_re, tm_im = device.reflection(contact.face, contact.cosine, node, active)
        s_re, s_im, p_re, p_im = dr.dot(e_re, s), dr.dot(e_im, s), dr.dot(e_re, p_in), dr.dot(e_im, p_in)
        r_re = s * (te_re * s_re - te_im * s_im) + p_out * (tm_re * p_re - tm_im * p_im)
        r_im = s * (te_re * s_im + te_im * s_re) + p_out * (tm_re * p_im + tm_im * p_re)
        radiated = []
        for incident, reflected in ((e_re, r_re), (e_im, r_im)):
            electric = dr.cross(contact.normal, dr.cross(tubes.direction, incident) + dr.cross(mirrored, reflected))
            magnetic = dr.cross(dr.cross(incident + reflected, contact.normal), outgoing)
            radiated.append(electric + magnetic)
        if isinstance(receive_axis, list):
            axis_re, axis_im = receive_axis[node]
            parts = [
                dr.dot(axis_re, radiated[0]) - dr.dot(axis_im, radiated[1]), dr.dot(axis_re, radiated[1]) + dr.dot(axis_im, radiated[0])
            ]  # fmt: skip
        else:
            parts = [dr.dot(receive_axis, vector) for vector in radiated]
        out.append((parts[0] * total_re - parts[1] * total_im, parts[0] * total_im + parts[1] * total_re))
        tubes.field_re[node], tubes.field_im[node] = r_re, r_im
    return out
