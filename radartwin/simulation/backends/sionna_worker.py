"""Trace paths with Sionna RT, over one mesh whose reflection coefficients come from a table over mesh face and angle of incidence.

Import this module only in the worker process of `sionna`, after the process has activated its Mitsuba variant. Reference: J. Hoydis et al.,
Sionna RT: Differentiable ray tracing for radio propagation modeling, IEEE Globecom Workshops 2023; sionna-rt 2.2.0.

Sionna's own material is one homogeneous slab in air, but the walls of radartwin's scenes are stacks of layers. The table holds the
coefficients of `radartwin.materials.reflection` at 4096 or more equally spaced cosines of incidence, with linear interpolation between
them. The interpolation error is below 3e-3 of the incident field for all wall, floor and ceiling materials of the rooms, at angles of
incidence up to 89.7 degrees. For a slab in air, the table agrees with Sionna's own material. Tests check both statements. Sionna's own code
computes polarisation and sampling probabilities. A single material object serves all surfaces, because Dr.Jit processes
the code of every material object on each call.
"""

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from scipy.spatial.transform import Rotation
from sionna.rt import InteractionType, PathSolver, PlanarArray, RadioMaterial, Receiver, SceneObject, Transmitter, load_scene

from radartwin.constants import SPEED_OF_LIGHT
from radartwin.simulation.backends.sionna_scene import SionnaScene

NAME = "scene"


def trace(
    mesh: SionnaScene, sensor_poses: np.ndarray, offset_m: np.ndarray, max_bounces: int, rays: int, diffraction: bool
) -> dict[str, np.ndarray]:
    """Trace the paths at all sensor poses (F, 4, 4). The receiver is at the position `offset_m` (3,) in the sensor frame, in metres.

    Returns:
        Arrays of N paths: index of the pose (N,), amplitude (N, Q) without the propagation phase, length_m (N,), `vertex`
        (N, D, 3), the hit points in metres; `face` (N, D), the indices of the hit faces, -1 after the last hit; and `mirrored` (N,), which
        is true for paths of mirror reflections only. Q is the number of frequency nodes and D the largest number of hits of a path.
    """
    scene, material, solver = *_build(mesh), PathSolver(deterministic=True)
    parts = [_no_paths(len(mesh.frequencies_hz))]
    for pose, sensor in enumerate(sensor_poses):
        if pose and len(mesh.vertices) > 1:
            scene.mi_scene_params[f"{NAME}.vertex_positions"] = mi.Float(mesh.vertices[pose].astype(np.float32).ravel())
            scene.mi_scene_params.update()
        _place(scene, sensor, offset_m)
        material.use(mesh.te[..., 0], mesh.tm[..., 0])
        paths = solver(
            scene, max_depth=max_bounces, samples_per_src=rays, los=False, specular_reflection=True, diffuse_reflection=False,
            refraction=diffraction, diffraction=diffraction, edge_diffraction=diffraction, synthetic_array=True, seed=0,
        )  # fmt: skip
        if paths._paths_buffer.buffer_size:
            amplitude = _amplitudes(scene, solver, paths, material, mesh, rays, diffraction)
            parts.append({"pose": np.full(len(amplitude), pose), "amplitude": amplitude, **_hits(paths)})
    depth = max(part["face"].shape[1] for part in parts)
    for part in parts:
        missing = depth - part["face"].shape[1]
        part["face"] = np.pad(part["face"], ((0, 0), (0, missing)), constant_values=-1)
        part["vertex"] = np.pad(part["vertex"], ((0, 0), (0, missing), (0, 0)))
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _build(mesh: SionnaScene) -> tuple[Any, "TabulatedMaterial"]:
    """Build a Sionna scene with the mesh and with isotropic antennas that are polarised along z. Return the scene and its material."""
    corners = mesh.vertices[0]
    built = mi.Mesh(NAME, len(corners), len(mesh.faces))
    parameters: Any = mi.traverse(built)
    parameters["vertex_positions"] = mi.Float(corners.astype(np.float32).ravel())
    parameters["faces"] = mi.UInt(mesh.faces.astype(np.uint32).ravel())
    parameters.update()
    material = TabulatedMaterial(mesh.row)
    material.use(mesh.te[..., 0], mesh.tm[..., 0])
    scene: Any = load_scene()
    scene.frequency = float(mesh.frequencies_hz.mean())
    scene.edit(add=SceneObject(mi_mesh=built, name=NAME, radio_material=material))
    scene.tx_array = scene.rx_array = PlanarArray(num_rows=1, num_cols=1, pattern="iso", polarization="V")
    for kind, name in ((Transmitter, "transmitter"), (Receiver, "receiver")):
        scene.add(kind(name, position=mi.Point3f(0, 0, 0), orientation=mi.Point3f(0, 0, 0)))
    return scene, material


def _place(scene: Any, sensor: np.ndarray, offset_m: np.ndarray) -> None:
    orientation = mi.Point3f(*Rotation.from_matrix(sensor[:3, :3]).as_euler("ZYX").tolist())
    for name, place in (("transmitter", sensor[:3, 3]), ("receiver", sensor[:3, 3] + sensor[:3, :3] @ offset_m)):
        scene.get(name).position, scene.get(name).orientation = mi.Point3f(*place.tolist()), orientation


def _hits(paths: Any) -> dict[str, np.ndarray]:
    """Return the lengths and the hits of the paths of one pose, in an order that is the same in every run.

    The order of the paths in Sionna's tensors depends on the timing of threads.
    """
    order = np.array(paths._path_ind)
    face, kind = (np.array(values)[:, 0, 0, order].T for values in (paths.primitives, paths.interactions))
    return {
        "length_m": np.array(paths.tau)[0, 0, order].astype(float) * SPEED_OF_LIGHT,
        "vertex": np.moveaxis(np.array(paths.vertices)[:, 0, 0, order], 0, 1).astype(float),
        "face": np.where(kind == InteractionType.NONE, -1, face.astype(np.int64)),
        "mirrored": ((kind == InteractionType.NONE) | (kind == InteractionType.SPECULAR)).all(axis=1),
    }


def _no_paths(nodes: int) -> dict[str, np.ndarray]:
    return {
        "pose": np.zeros(0, int), "amplitude": np.zeros((0, nodes), complex), "length_m": np.zeros(0), "vertex": np.zeros((0, 1, 3)),
        "face": np.zeros((0, 1), np.int64), "mirrored": np.zeros(0, bool),
    }  # fmt: skip


def _amplitudes(scene: Any, solver: Any, paths: Any, material: Any, mesh: SionnaScene, rays: int, diffraction: bool) -> np.ndarray:
    """Compute the complex amplitudes (N, Q) of N known paths at Q frequency nodes, each with the reflection table of this frequency.

    Sionna's path solver accepts only one frequency per call and would search the paths again at each frequency. This function therefore
    uses Sionna's field calculator, which is not part of Sionna's public interface.
    """
    source, source_turn, *_ = scene.sources(True, True)
    target, target_turn, *_ = scene.targets(True, True)
    dr.make_opaque(source, target, source_turn, target_turn)
    columns = []
    for q, frequency in enumerate(mesh.frequencies_hz):
        material.use(mesh.te[..., q], mesh.tm[..., q])
        field = solver._field_calculator(
            wavelength=dr.opaque(mi.Float, SPEED_OF_LIGHT / frequency), paths=paths._paths_buffer, samples_per_src=rays,
            diffraction=diffraction, src_positions=source, tgt_positions=target, src_orientations=source_turn,
            tgt_orientations=target_turn, src_antenna_patterns=scene.tx_array.antenna_pattern.patterns,
            tgt_antenna_patterns=scene.rx_array.antenna_pattern.patterns,
        ).a[0][0]  # fmt: skip
        columns.append(np.array(field.real).astype(complex) + 1j * np.array(field.imag))
    return np.stack(columns, axis=1)


class TabulatedMaterial(RadioMaterial):
    """Reflect waves at each mesh face with the tabulated coefficients of the face's material.

    Args:
        row: (F,) index of the table row that holds the coefficients of each of F faces.
    """

    def __init__(self, row: np.ndarray) -> None:
        # Sionna uses the conductivity to choose between reflection and transmission. With the conductivity of a metal, it always reflects.
        super().__init__(name="tabulated", conductivity=1e7)
        self._rows = mi.UInt(np.ascontiguousarray(row, np.uint32))
        self._table: list[Any] = []
        self._cosines = 0
        self._row: Any = None
        dr.make_opaque(self._rows)

    def use(self, te: np.ndarray, tm: np.ndarray) -> None:
        """Set the complex TE and TM reflection tables (D materials, C equally spaced cosines of incidence from 0 to 1)."""
        self._cosines = te.shape[1]
        parts = (np.real(te), np.imag(te), np.real(tm), np.imag(tm))
        self._table = [mi.Float(np.ascontiguousarray(part, np.float32).ravel()) for part in parts]
        dr.make_opaque(self._table)

    def sample(self, ctx: Any, si: Any, sample1: Any, sample2: Any, active: Any = True) -> Any:
        self._select(si)
        return super().sample(ctx, si, sample1, sample2, active)

    def eval(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
        self._select(si)
        return super().eval(ctx, si, wo, active)

    def pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
        self._select(si)
        return super().pdf(ctx, si, wo, active)

    def _select(self, si: Any) -> None:
        """Select the table rows of the faces that the rays hit."""
        self._row = dr.gather(mi.UInt, self._rows, si.prim_index)

    def _specular_reflection_transmission_matrix(
        self, to_world: Any, ki_local: Any, ko_local: Any, reflection: Any, r_te: Any, r_tm: Any, t_te: Any, t_tm: Any
    ) -> Any:
        """Return Sionna's Jones matrix of the reflection, computed with the tabulated coefficients instead of Sionna's r_te and r_tm."""
        place = dr.clip(-ki_local.z, 0, 1) * (self._cosines - 1)
        below = dr.minimum(mi.UInt(place), self._cosines - 2)
        share, index = place - mi.Float(below), below + self._row * self._cosines
        values = [dr.lerp(dr.gather(mi.Float, part, index), dr.gather(mi.Float, part, index + 1), share) for part in self._table]
        pair: Any = mi.Complex2f
        te, tm = pair(values[0], values[1]), pair(values[2], values[3])
        return super()._specular_reflection_transmission_matrix(to_world, ki_local, ko_local, reflection, te, tm, t_te, t_tm)
