"""What rays at the middles and corners of a grid's cells meet, without any field. Import only once a Mitsuba variant is active."""

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from radartwin.simulation.curved.contact import cast, leave, meet
from radartwin.simulation.curved.device import Device
from radartwin.simulation.curved.flight import Tubes, rays
from radartwin.simulation.curved.tube_grid import Launch

SPREADING = 1 << 31  # of what a scouting ray met: it went from a curved surface on to another


def faces_met(device: Device, launch: Launch, poses: tuple[int, int], max_bounces: int, first_hit: int, walls: Any = None) -> np.ndarray:
    """What rays at the middles and at the corners of a grid's cells meet: a number per sequence of smooth patches, 0 for nothing.

    Returns:
        (poses, count_u count_v + (count_u + 1)(count_v + 1)) uint32: middles, then corners, rows along u. SPREADING is set where a
        curved surface sends the ray on to another. Through `walls`: what rays meet first and behind it.
    """
    middles, corners = launch.per_pose, (launch.count_u + 1) * (launch.count_v + 1)
    index = dr.arange(mi.UInt32, (poses[1] - poses[0]) * (middles + corners))
    pose = index // dr.opaque(mi.UInt32, middles + corners)
    cell = index - pose * dr.opaque(mi.UInt32, middles + corners)
    pose += dr.opaque(mi.UInt32, poses[0])
    corner = cell >= dr.opaque(mi.UInt32, middles)
    cell = dr.select(corner, cell - dr.opaque(mi.UInt32, middles), cell)
    count = dr.select(corner, dr.opaque(mi.UInt32, launch.count_u + 1), dr.opaque(mi.UInt32, launch.count_u))
    cell_v = cell // count
    offset = dr.select(corner, mi.Float(0.5), 0.0)
    origin, direction, *_ = rays(launch, pose, mi.Float(cell - cell_v * count) - offset, mi.Float(cell_v) - offset)
    nothing, none = mi.Vector3f(0.0), mi.Float64(0.0)
    tubes = Tubes(
        index, pose, origin, direction, nothing, nothing, nothing, nothing, none, None, None, nothing, [], [], none, none, mi.UInt64(0)
    )
    alive, met, curved, spreading = mi.Bool(True), mi.UInt32(0), mi.Bool(False), mi.Bool(False)
    for number in range(2 if walls else max_bounces):
        alive = cast(device, tubes, number == 0, alive)
        contact, alive = meet(device, tubes, number == 0, alive)
        if number == 0 and device.cluster is not None:
            alive &= dr.gather(mi.UInt32, device.cluster, contact.face, alive) == dr.opaque(mi.UInt32, first_hit)
        if walls and number == 0:
            alive = walls.enter(tubes, contact, alive)
        # multiplied by an odd constant, so that the order of the faces counts
        met = dr.select(alive, (met * 0x9E3779B1) ^ dr.gather(mi.UInt32, device.patch, contact.face, alive), met)
        if walls and number == 0:
            continue
        if device.curved and not walls:
            spreading = spreading | (alive & curved)
            curved = curved | (alive & contact.bends())
        alive &= leave(device, tubes, contact)
    # the lowest bit is set so that no sequence looks like nothing
    met = dr.select(met > 0, ((met << 1) & (SPREADING - 1)) | 1, 0) | dr.select(spreading, mi.UInt32(SPREADING), 0)
    return met.numpy().reshape(poses[1] - poses[0], -1)
