"""Draw a three-dimensional page (as the command radartwin view does) and a preview picture of each room of the study."""

import functools
import io
from dataclasses import dataclass

PIXELS = 480
BARE = ("empty", "void")  # rooms without furniture


@dataclass(frozen=True)
class RoomPage:
    """The report's files for one room. `page` and `picture` are links of the report page."""

    name: str
    surfaces: int
    size_m: tuple[float, ...]
    page: str
    picture: str
    html: bytes
    jpeg: bytes
    pixels: int = PIXELS


@functools.cache
def drawn() -> list[RoomPage]:
    """Return the pages of all furnished rooms, with each room's true surfaces and materials."""
    import numpy as np
    from PIL import Image

    from radartwin.label.material_map import corner_camera
    from radartwin.label.z_buffer import Drawing
    from radartwin.scene import rooms
    from radartwin.scene.viewer.page import describe, page_of

    pages = []
    for name in (room for room in rooms.ROOMS if room not in BARE):
        scene, spoken, stream = rooms.room(name), name.replace("_", " "), io.BytesIO()
        drawing = Drawing(scene)
        camera = corner_camera(scene, drawing, PIXELS)
        Image.fromarray(drawing.picture(camera, drawing.seen(camera))).save(stream, "JPEG", quality=85)
        html = page_of(*describe(scene, title=spoken)).encode()
        size_m = tuple(np.ptp(scene.bounds, axis=0).tolist())
        pages.append(RoomPage(spoken, len(scene), size_m, f"rooms/{name}.html", f"rooms/{name}.jpg", html, stream.getvalue()))
    return pages
