"""Contribution of a tube's footprint to the receiver. Formulas and symbols as in `radartwin.simulation.curved.tubes`.

Import only after a Mitsuba variant is active.
"""

from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from radartwin.simulation.curved.contact import Contact, across_incidence
from radartwin.simulation.curved.device import Device
from radartwin.simulation.curved.flight import Tubes
from radartwin.simulation.curved.footprint import footprint_integral

MOST_BEND = 3.0  # radians; limit of the second-order phase on a curved surface, unless the first-order phase is steep
TERMINATOR = 0.4  # cosine of incidence below which currents on a curved surface fade out, except towards the mirror direction


class Reception(NamedTuple):
    """Describe the receiver as seen from the contacts.

    Attributes:
        direction: unit vector from the contact to the receiver. length: distance, metres.
        axis: receive polarisation P, or per node its (real, imaginary) parts.
        plane: whether the receiver is infinitely far away.
    """

    direction: Any
    length: Any
    axis: Any
    plane: bool


def scatter(device: Device, tubes: Tubes, contact: Contact, reception: Reception, wavenumber: Any, active: Any) -> list[tuple[Any, Any]]:
    """Compute every tube's contribution to the receiver, per node (real, imaginary), and reflect the tubes' fields."""
    s = across_incidence(tubes.direction, contact.normal)
    mirrored = contact.mirrored(tubes.direction)
    p_in, p_out = dr.cross(tubes.direction, s), dr.cross(mirrored, s)
    total_re, total_im = _footprint(device, tubes, contact, reception, wavenumber, active)
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
            magnetic = dr.cross(dr.cross(incident + reflected, contact.normal), reception.direction)
            radiated.append(electric + magnetic)
        if isinstance(reception.axis, list):
            axis_re, axis_im = reception.axis[node]
            parts = [
                dr.dot(axis_re, radiated[0]) - dr.dot(axis_im, radiated[1]), dr.dot(axis_re, radiated[1]) + dr.dot(axis_im, radiated[0])
            ]  # fmt: skip
        else:
            parts = [dr.dot(reception.axis, vector) for vector in radiated]
        out.append((parts[0] * total_re - parts[1] * total_im, parts[0] * total_im + parts[1] * total_re))
        tubes.field_re[node], tubes.field_im[node] = r_re, r_im
    return out


def _footprint(device: Device, tubes: Tubes, contact: Contact, reception: Reception, wavenumber: Any, active: Any) -> tuple[Any, Any]:
    """Return real and imaginary part of sqrt(dOmega A)/(8 pi L_o cos t) I; zero in inactive lanes."""
    outgoing = reception.direction
    inverse_out = mi.Float(0.0) if reception.plane else dr.rcp(reception.length)
    gradient = tubes.direction - outgoing  # gradient of the path length at the hit
    # change of the path length if the hit lies deeper along the ray
    deeper = (1 - dr.dot(tubes.direction, outgoing)) * dr.rcp(contact.cosine)
    spreads = tubes.direction_du, tubes.direction_dv
    steps = [contact.step(tubes.direction, derivative) for derivative in (tubes.position_du, tubes.position_dv)]
    turns = [contact.turn(step) for step in steps] if device.curved else []
    alongs = [dr.dot(step, outgoing) for step in steps]

    def bend(i: int, j: int) -> Any:
        value = dr.dot(spreads[i], steps[j]) + (dr.dot(steps[i], steps[j]) - alongs[i] * alongs[j]) * inverse_out
        return value + deeper * dr.dot(turns[i], steps[j]) if device.curved else value

    hat = device.hats
    if device.curved:
        hat = hat | contact.is_curved()
    slopes = [wavenumber * dr.dot(gradient, step) for step in steps]
    bends = [0.5 * wavenumber * bend(i, i) for i in range(2)]
    if device.curved:  # near a shadow line, the expansion is not valid beyond this limit
        for i, slope in enumerate(slopes):
            most = dr.select(contact.is_curved(), dr.maximum(0.25 * dr.abs(slope), MOST_BEND), dr.inf)
            bends[i] = dr.clip(bends[i], -most, most)
    re, im = footprint_integral(slopes, bends, wavenumber * bend(0, 1), hat)
    # the field varies as the inverse square root of the cross-section, so field times area stays finite at zero cross-section
    cross_section = dr.abs(dr.dot(dr.cross(tubes.position_du, tubes.position_dv), tubes.direction))
    level = dr.sqrt(tubes.weight * cross_section) * dr.rcp(8 * np.pi * contact.cosine) * (1.0 if reception.plane else inverse_out)
    if device.curved:
        # physical optics cuts the currents at the shadow line of a curved surface; fade them out there, except towards the mirrored ray
        fade = TERMINATOR * 0.5 * (1 - dr.dot(contact.mirrored(tubes.direction), outgoing))
        least = dr.minimum(contact.cosine, dr.dot(contact.normal, outgoing))
        x = dr.clip(least * dr.rcp(dr.maximum(fade, 1e-6)), 0, 1)
        level *= dr.select(contact.is_curved(), x * x * (3 - 2 * x), 1.0)
    if tubes.hat_share is not None:
        level *= dr.select(hat, tubes.hat_share, dr.select(tubes.in_box, mi.Float(1.0), 0.0))
    return dr.select(active, re * level, 0.0), dr.select(active, im * level, 0.0)
