"""Draw the room, the radar, the objects and the paths in the 3D scene of a viser server."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from radartwin.live.birds_eye import level_colours
from radartwin.live.echoes import LivePath, span_db
from radartwin.live.setting import Movable
from radartwin.scene import objects
from radartwin.scene.scene import Scene
from radartwin.scene.surface import Surface
from radartwin.scene.trajectories.trajectory import pose
from radartwin.scene.viewer.colouring import RGB, material_colours, material_label
from radartwin.scene.viewer.display_mesh import MAX_FACES, thinned, wall_planes
from radartwin.simulation.poses import check_poses

PATHS_DYNAMIC_DB = 50.0  # range of levels of the drawn paths, below the strongest
LINE_M = 0.014  # thickness of a drawn path
CHOSEN_RGB = (214, 40, 40)
RADAR_RGB = (35, 35, 45)
BORESIGHT_RGB = (194, 65, 12)
AMBIENT, SUN = 2.2, 1.3  # intensities of light; pi would show the colour of a material unchanged


class Stage:
    """Draw into a viser server. `moved` gets the name of what the user has dragged, `clicked` origin and direction of a click's ray."""

    def __init__(self, server: Any, moved: Callable[[str], object], clicked: Callable[[np.ndarray, np.ndarray], object]) -> None:
        self._server, self._moved = server, moved
        self._gizmos: dict[str, Any] = {}
        self._room: list[Any] = []
        self._walls: list[dict[str, list[float]]] = []
        self._number = 0
        self.colours: dict[str, RGB] = {}
        # even light, so that a surface has about the colour of its material in the legend, and edges between walls stay visible
        server.scene.configure_default_lights(False)
        server.scene.configure_environment_map(None)
        server.scene.add_light_ambient("/light/all", intensity=AMBIENT)
        server.scene.add_light_directional("/light/sun", intensity=SUN, position=(0.5, -0.8, 1.6), cast_shadow=False)
        server.scene.on_click()(lambda event: clicked(np.array(event.ray_origin), np.array(event.ray_direction)))

    def look(self, room: Scene, radar_pose: np.ndarray) -> None:
        """Set the first view: from above, behind and beside the radar, with the room in the middle of the picture."""
        low, high = room.bounds if len(room) else (radar_pose[:3, 3] - 2, radar_pose[:3, 3] + 2)
        middle, size = (low + high) / 2, float(np.linalg.norm((high - low)[:2]))
        ahead = np.array([*radar_pose[:2, 0], 0.0])
        ahead = ahead / max(float(np.linalg.norm(ahead)), 1e-9)
        initial = self._server.initial_camera
        initial.position = middle - 0.55 * size * ahead + 0.3 * size * np.cross(ahead, [0, 0, 1]) + np.array([0, 0, 0.6 * size])
        initial.look_at = middle - np.array([0, 0, 0.1 * size])
        initial.up = np.array([0.0, 0.0, 1.0])

    def look_again(self, camera: Any) -> None:
        """Give the camera of a viser client the first view."""
        initial = self._server.initial_camera
        camera.up, camera.position, camera.look_at = initial.up, initial.position, initial.look_at

    def outside(self, position: np.ndarray) -> bool:
        """Return whether a position (3,) lies behind a wall of the room. Fewer than four walls bound no room."""
        behind = [np.dot(wall["normal"], position - wall["point"]) < 0 for wall in self._walls]
        return len(behind) >= 4 and any(behind)

    def show_room(self, room: Scene, movables: Sequence[Movable]) -> None:
        """Draw the room coloured by material. Walls show their inner side only, so that the room is open to a view from outside."""
        for handle in self._room:
            handle.remove()
        self._room = []
        self.colours = material_colours([s.material for s in (*room, *(s for m in movables for s in m.surfaces))])
        meshes, _ = thinned([s.mesh for s in room], MAX_FACES)
        planes = wall_planes(room.surfaces)
        self._walls = [plane for plane in planes if plane is not None] or self._walls  # a radar without room stands where the room was
        for index, (surface, mesh, plane) in enumerate(zip(room, meshes, planes, strict=True)):
            faces = np.asarray(mesh.faces)
            if plane is not None:
                faces = _facing(mesh, np.array(plane["normal"]))
            side = "double" if plane is None else "front"
            self._room.append(self._mesh(f"/room/{index}", surface, np.asarray(mesh.vertices), faces, side))

    def add_radar(self, pose: np.ndarray) -> None:
        gizmo = self._gizmo("radar", pose, 0.55)
        scene = self._server.scene
        scene.add_box(f"{gizmo.name}/board", dimensions=(0.02, 0.07, 0.09), color=RADAR_RGB)
        shaft = trimesh.creation.cylinder(0.006, segment=[[0, 0, 0], [0.5, 0, 0]], sections=12)
        tip = trimesh.creation.cone(0.02, 0.06, sections=16).apply_transform(trimesh.geometry.align_vectors([0, 0, 1], [1, 0, 0]))
        arrow = objects.joined([shaft, tip.apply_translation([0.5, 0, 0])])
        vertices, faces = np.asarray(arrow.vertices), np.asarray(arrow.faces)
        scene.add_mesh_simple(f"{gizmo.name}/boresight", vertices, faces, color=BORESIGHT_RGB, cast_shadow=False)
        scene.add_label(f"{gizmo.name}/label", "radar", position=(0, 0, 0.12))

    def add_object(self, movable: Movable) -> None:
        gizmo = self._gizmo(movable.name, movable.pose, 0.4)
        for index, surface in enumerate(movable.surfaces):
            self.colours |= {k: v for k, v in material_colours([surface.material]).items() if k not in self.colours}
            self._mesh(f"{gizmo.name}/{index}", surface, np.asarray(surface.mesh.vertices), np.asarray(surface.mesh.faces), "double")
        high = max(float(s.mesh.bounds[1, 2]) for s in movable.surfaces)
        self._server.scene.add_label(f"{gizmo.name}/label", movable.name, position=(0, 0, high + 0.06))

    def remove(self, name: str) -> None:
        self._gizmos.pop(name).remove()

    def pose(self, name: str) -> np.ndarray:
        """Return the pose (4, 4) of the radar (name "radar") or of an object."""
        gizmo = self._gizmos[name]
        rotation = Rotation.from_quat(np.asarray(gizmo.wxyz, float), scalar_first=True).as_matrix()
        return check_poses(pose(np.asarray(gizmo.position, float), rotation), "pose")[0]

    def place(self, name: str, pose: np.ndarray) -> None:
        """Move the radar or an object, as a drag does."""
        gizmo = self._gizmos[name]
        gizmo.wxyz, gizmo.position = quaternion(pose[:3, :3]), pose[:3, 3]

    def show_paths(self, paths: Sequence[LivePath], path_number: int | None) -> None:
        """Draw the paths coloured by level; the chosen one is red and thicker."""
        levels_db = np.array([path.level_db for path in paths])
        colours = level_colours(levels_db, *span_db(levels_db, PATHS_DYNAMIC_DB))
        chosen = [] if path_number is None else [paths[path_number]]
        for name, drawn, rgb, thickness_m in (("all", paths, colours, LINE_M), ("chosen", chosen, [CHOSEN_RGB], 2.2 * LINE_M)):
            legs = [np.stack([path.points[:-1], path.points[1:]], axis=1) for path in drawn] or [np.zeros((1, 2, 3))]
            leg_rgb = np.repeat(np.array(rgb if len(drawn) else [CHOSEN_RGB], np.uint8), [len(leg) for leg in legs], axis=0)
            points, point_rgb = np.concatenate(legs), np.repeat(leg_rgb[:, None], 2, axis=1)
            self._server.scene.add_line_segments(f"/paths/{name}", points, point_rgb, thickness=thickness_m, visible=len(drawn) > 0)

    def _mesh(self, name: str, surface: Surface, vertices: np.ndarray, faces: np.ndarray, side: str) -> Any:
        colour = self.colours[material_label(surface.material)]
        return self._server.scene.add_mesh_simple(
            name, vertices, faces, color=colour, flat_shading=not surface.is_curved(), side=side, cast_shadow=False, receive_shadow=False
        )

    def _gizmo(self, name: str, pose: np.ndarray, scale: float) -> Any:
        # The control has a number instead of the object's name, because viser would read some names as paths.
        gizmo = self._server.scene.add_transform_controls(
            f"/moved/{self._number}", scale=scale, line_width=2.5, depth_test=False, opacity=0.7,
            wxyz=quaternion(pose[:3, :3]), position=pose[:3, 3],
        )  # fmt: skip
        gizmo.on_update(lambda _: self._moved(name))
        self._number += 1
        self._gizmos[name] = gizmo
        return gizmo


def quaternion(rotation: np.ndarray) -> np.ndarray:
    """Return the unit quaternion (w, x, y, z) of a rotation matrix (3, 3)."""
    return Rotation.from_matrix(rotation).as_quat(scalar_first=True)


def _facing(mesh: trimesh.Trimesh, normal: np.ndarray) -> np.ndarray:
    """Return the triangles of a wall, with the order of corners that turns their front towards `normal` (3,)."""
    faces = np.array(mesh.faces)
    away = mesh.face_normals @ normal < 0
    faces[away] = faces[away][:, ::-1]
    return faces
