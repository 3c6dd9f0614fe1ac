"""Write a three-dimensional page (as the command radartwin view does) and a preview picture for each room of the study."""

from __future__ import annotations

import functools
import io
from dataclasses import dataclass
from typing import TYPE_CHECKING

from analysis.report.publish import Stage

if TYPE_CHECKING:
    from radartwin.scene.scene import Scene

PIXELS = 480
BARE = ("empty", "void")  # rooms without furniture


@dataclass(frozen=True)
class RoomPage:
    """The report's files for one room. `page` and `picture` are links relative to the parts folder."""

    name: str
    surfaces: int
    size_m: tuple[float, ...]
    page: str
    picture: str
    pixels: int = PIXELS


def write(staged: Stage) -> list[RoomPage]:
    """Write the three-dimensional pages of all furnished rooms, with each room's true surfaces and materials."""
    import numpy as np

    from radartwin.scene import rooms
    from radartwin.scene.viewer.page import view

    pages = []
    for name in (room for room in rooms.ROOMS if room not in BARE):
        scene, jpeg = _drawn(name)
        page, picture, spoken = f"rooms/{name}.html", f"rooms/{name}.jpg", name.replace("_", " ")
        view(scene, staged.path(page), title=spoken)
        staged.path(picture).write_bytes(jpeg)
        pages.append(RoomPage(spoken, len(scene), tuple(np.ptp(scene.bounds, axis=0).tolist()), page, picture))
    return pages


@functools.cache
def _drawn(name: str) -> tuple[Scene, bytes]:
    """Return the scene of a room, and the bytes of a JPEG picture taken from a corner of the room."""
    from PIL import Image

    from radartwin.label.material_map import corner_camera
    from radartwin.label.z_buffer import Drawing
    from radartwin.scene import rooms

    scene = rooms.room(name)
    drawing = Drawing(scene)
    camera = corner_camera(scene, drawing, PIXELS)
    stream = io.BytesIO()
    Image.fromarray(drawing.picture(camera, drawing.seen(camera))).save(stream, "JPEG", quality=85)
    return scene, stream.getvalue()
