"""Run Sionna RT in a separate worker process, because Sionna needs a polarised Mitsuba variant and a process can have only one variant.

The module `sionna_process` starts the worker process, in which it calls the function `answer`. Reference: J. Hoydis et al., Sionna RT:
Differentiable ray tracing for radio propagation modeling, IEEE Globecom Workshops 2023; sionna-rt 2.2.0.
"""

from typing import Any, cast

import numpy as np
from scipy.spatial.transform import Rotation

from radartwin.constants import SPEED_OF_LIGHT
from radartwin.simulation import variant

NAME = "scene"
SEED = 0  # random seed of Sionna's diffuse rays


def answer(message: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Handle a message of the main process: call `trace` if the message has the key "vertices", and `slab` otherwise."""
    variant.activate(str(message["variant"]), "mono_polarized")
    return trace(message) if "vertices" in message else slab(message)


def slab(message: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the reflection coefficients of a slab in air that Sionna itself computes.

    Args:
        message: "cosine" (N,) of incidence, complex "permittivity", "thickness_m" and "frequency_hz".
    Returns:
        TE coefficients "te" (N,) and TM coefficients "tm" (N,).
    """
    import mitsuba as mi
    from sionna.rt.utils import itu_coefficients_single_layer_slab

    eta, pair = complex(message["permittivity"]), cast(Any, mi.Complex2f)
    te, tm, *_ = itu_coefficients_single_layer_slab(
        mi.Float(message["cosine"].astype(np.float32)),
        pair(eta.real, eta.imag),
        mi.Float(float(message["thickness_m"])),
        mi.Float(SPEED_OF_LIGHT / float(message["frequency_hz"])),
    )
    return {"te": _complex(te), "tm": _complex(tm)}


def trace(message: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Trace the paths at all sensor poses with Sionna.

    Args:
        message: mapping of these arrays and numbers. The mesh has vertices (F or 1, V, 3) in the world in metres and faces (T, 3). The
            reflection tables te and tm (D, C, Q) have one row per material; row (T,) is the table row of each face. scattering (T,) is
            Sionna's scattering coefficient of each face. frequencies_hz (Q,) are the frequency nodes. sensor (F, 4, 4) are the sensor
            poses, and offset_m (3,) is the position of the receiver in the sensor frame in metres. max_bounces is the largest number of
            reflections, samples the number of rays, diffuse whether to add diffuse reflection, and diffraction whether to add diffraction.
    Returns:
        Arrays of N paths: index of the pose (N,), amplitude (N, Q) without the propagation phase, length_m (N,), `vertex`
        (N, D, 3), the hit points in metres; `face` (N, D), the indices of the hit faces, -1 after the last hit; `scattered` (N,), which
        is true for paths with a diffuse hit; and `mirrored` (N,), which is true for paths of mirror reflections only. Q is the number of
        frequency nodes and D the largest number of hits of a path.
    """
    import mitsuba as mi
    from sionna.rt import PathSolver

    scene, material = _build(message)
    solver = PathSolver(deterministic=True)
    vertices, diffraction = message["vertices"], bool(message["diffraction"])
    found: list[dict[str, np.ndarray]] = []
    for pose, sensor in enumerate(message["sensor"]):
        if pose and len(vertices) > 1:
            scene.mi_scene_params[f"{NAME}.vertex_positions"] = mi.Float(vertices[pose].astype(np.float32).ravel())
            scene.mi_scene_params.update()
        _place(scene, sensor, message["offset_m"])
        material.use(message["te"][..., 0], message["tm"][..., 0])
        paths = solver(
            scene, max_depth=int(message["max_bounces"]), samples_per_src=int(message["samples"]), los=False, specular_reflection=True,
            diffuse_reflection=bool(message["diffuse"]), refraction=diffraction, diffraction=diffraction, edge_diffraction=diffraction,
            synthetic_array=True, seed=SEED,
        )  # fmt: skip
        if paths._paths_buffer.buffer_size:
            found.append(_found(pose, scene, solver, paths, material, message))
    if not found:
        return _nothing(len(message["frequencies_hz"]))
    depth = max(one["face"].shape[1] for one in found)
    for one in found:
        missing = depth - one["face"].shape[1]
        one["face"] = np.pad(one["face"], ((0, 0), (0, missing)), constant_values=-1)
        one["vertex"] = np.pad(one["vertex"], ((0, 0), (0, missing), (0, 0)))
    return {name: np.concatenate([one[name] for one in found]) for name in found[0]}


def _build(message: dict[str, np.ndarray]) -> tuple[Any, Any]:
    """Build a Sionna scene with the mesh and with isotropic antennas that are polarised along z. Return the scene and its material."""
    import mitsuba as mi
    from sionna.rt import PlanarArray, Receiver, SceneObject, Transmitter, load_scene

    from radartwin.simulation.backends.sionna_material import TabulatedMaterial

    corners, faces = message["vertices"][0], message["faces"]
    mesh = mi.Mesh(NAME, len(corners), len(faces))
    parameters: Any = mi.traverse(mesh)
    parameters["vertex_positions"] = mi.Float(corners.astype(np.float32).ravel())
    parameters["faces"] = mi.UInt(faces.astype(np.uint32).ravel())
    parameters.update()
    material = TabulatedMaterial(message["row"], message["scattering"])
    material.use(message["te"][..., 0], message["tm"][..., 0])
    scene = load_scene()
    scene.frequency = float(message["frequencies_hz"].mean())
    scene.edit(add=SceneObject(mi_mesh=mesh, name=NAME, radio_material=material))
    scene.tx_array = scene.rx_array = PlanarArray(num_rows=1, num_cols=1, pattern="iso", polarization="V")
    for kind, name in ((Transmitter, "transmitter"), (Receiver, "receiver")):
        scene.add(kind(name, position=mi.Point3f(0, 0, 0), orientation=mi.Point3f(0, 0, 0)))
    return scene, material


def _place(scene: Any, sensor: np.ndarray, offset_m: np.ndarray) -> None:
    import mitsuba as mi

    turn = mi.Point3f(*Rotation.from_matrix(sensor[:3, :3]).as_euler("ZYX").tolist())
    scene.get("transmitter").position = mi.Point3f(*sensor[:3, 3].tolist())
    scene.get("receiver").position = mi.Point3f(*(sensor[:3, 3] + sensor[:3, :3] @ offset_m).tolist())
    for name in ("transmitter", "receiver"):
        scene.get(name).orientation = turn


def _found(pose: int, scene: Any, solver: Any, paths: Any, material: Any, message: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the paths of one pose in an order that is the same in every run.

    The order of the paths in Sionna's tensors depends on the timing of threads.
    """
    from sionna.rt import InteractionType

    order = np.array(paths._path_ind)
    face, kind = (np.array(values)[:, 0, 0, order].T for values in (paths.primitives, paths.interactions))
    return {
        "pose": np.full(len(order), pose),
        "amplitude": _amplitudes(scene, solver, paths, material, message),
        "length_m": np.array(paths.tau)[0, 0, order].astype(float) * SPEED_OF_LIGHT,
        "vertex": np.moveaxis(np.array(paths.vertices)[:, 0, 0, order], 0, 1).astype(float),
        "face": np.where(kind == InteractionType.NONE, -1, face.astype(np.int64)),
        "scattered": (kind == InteractionType.DIFFUSE).any(axis=1),
        "mirrored": ((kind == InteractionType.NONE) | (kind == InteractionType.SPECULAR)).all(axis=1),
    }


def _nothing(nodes: int) -> dict[str, np.ndarray]:
    return {
        "pose": np.zeros(0, int), "amplitude": np.zeros((0, nodes), complex), "length_m": np.zeros(0), "vertex": np.zeros((0, 1, 3)),
        "face": np.zeros((0, 1), np.int64), "scattered": np.zeros(0, bool), "mirrored": np.zeros(0, bool),
    }  # fmt: skip


def _amplitudes(scene: Any, solver: Any, paths: Any, material: Any, message: dict[str, np.ndarray]) -> np.ndarray:
    """Compute the complex amplitudes (N, Q) of N known paths at Q frequency nodes, each with the reflection table of this frequency.

    Sionna's path solver accepts only one frequency per call and would search the paths again at each frequency. This function therefore
    uses Sionna's field calculator, which is not part of Sionna's public interface.
    """
    import drjit as dr
    import mitsuba as mi

    source, source_turn, *_ = scene.sources(True, True)
    target, target_turn, *_ = scene.targets(True, True)
    dr.make_opaque(source, target, source_turn, target_turn)
    columns = []
    for q, frequency in enumerate(message["frequencies_hz"]):
        material.use(message["te"][..., q], message["tm"][..., q])
        replayed = solver._field_calculator(
            wavelength=dr.opaque(mi.Float, SPEED_OF_LIGHT / frequency), paths=paths._paths_buffer,
            samples_per_src=int(message["samples"]), diffraction=bool(message["diffraction"]),
            src_positions=source, tgt_positions=target, src_orientations=source_turn, tgt_orientations=target_turn,
            src_antenna_patterns=scene.tx_array.antenna_pattern.patterns, tgt_antenna_patterns=scene.rx_array.antenna_pattern.patterns,
        )  # fmt: skip
        columns.append(_complex(replayed.a[0][0]))
    return np.stack(columns, axis=1)


def _complex(values: Any) -> np.ndarray:
    return np.array(values.real).astype(complex) + 1j * np.array(values.imag)
