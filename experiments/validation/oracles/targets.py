"""Validation cases of far-field cross-sections: closed forms, Mie series, cylinder series, and iterative optics of trihedrals."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, partial

import numpy as np
import trimesh

import radartwin as rt
from experiments.validation.oracles.case import OBJECTS, WAVELENGTH_M, WAVENUMBER, Case, Finding, Untestable, db, reference_rows, rms, worst
from experiments.validation.oracles.cylinder import conductor_width
from experiments.validation.oracles.iterative_optics import corner_echoes
from radartwin.scene import objects

FAR_M = 2e4  # distance for the quadrature of corners: the wavefront is flat to 1e-3 wavelengths, and double precision resolves the phase
SIDELOBE = 4.493409457909064  # first maximum of |sin x/x| after zero
AHEAD = (1.0, 0.0, 0.0)
DENSITY = 4.0  # rays per square wavelength, unless a case compares several densities


def plate_rcs(side_m: float, angle_rad: float = 0.0) -> float:
    """Return the cross-section in m^2 of a square plate turned about one axis, by physical optics. Ref: Balanis (2012), eq. 11-44."""
    x = WAVENUMBER * side_m * np.sin(angle_rad)
    return 4 * np.pi * side_m**4 / WAVELENGTH_M**2 * (np.sinc(x / np.pi) * np.cos(angle_rad)) ** 2


def mie_rcs(radius_m: float, wavelength_m: float = WAVELENGTH_M) -> float:
    """Return the cross-section in m^2 of a perfectly conducting sphere, by miepython with a very large refractive index."""
    import miepython

    _, _, q_back, _ = miepython.efficiencies_mx(1e4 - 1e4j, 2 * np.pi * radius_m / wavelength_m)
    return float(q_back) * np.pi * radius_m**2


def cylinder_rcs(radius_m: float, height_m: float) -> float:
    """Return the broadside cross-section in m^2 of a cylinder: echo width times 2 L^2/lambda. Ref: Balanis (2012), eq. 11-22b."""
    return 2 * height_m**2 / WAVELENGTH_M * conductor_width(radius_m, WAVELENGTH_M)


def corner_faces(mesh: trimesh.Trimesh) -> list[np.ndarray]:
    """Return the corners of every flat face of a reflector, in order around the face. Coplanar triangles are joined to one face."""
    flat = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    normals = np.round(flat.face_normals, 6)
    faces = []
    for normal in np.unique(normals, axis=0):
        points = np.unique(np.round(flat.triangles[(normals == normal).all(axis=1)].reshape(-1, 3), 12), axis=0)
        across = points - points.mean(axis=0)
        u = across[0] / np.linalg.norm(across[0])
        faces.append(points[np.argsort(np.arctan2(across @ np.cross(normal, u), across @ u))])
    return faces


@cache
def trihedral_rcs(leg_m: float, azimuth_deg: float = 0.0) -> float:
    """Return the far-field cross-section in m^2 of a trihedral with all bounces, by iterative physical optics."""
    azimuth = np.radians(azimuth_deg)
    sensor = FAR_M * np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    amplitude = corner_echoes("trihedral", leg_m, sensor, WAVELENGTH_M)[0]
    return (4 * np.pi) ** 3 * FAR_M**4 * abs(amplitude) ** 2 / WAVELENGTH_M**2


@dataclass(frozen=True)
class Target:
    """A canonical target in three sizes in metres."""

    name: str
    words: str
    oracle: str
    sizes: tuple[tuple[float, ...], ...]
    make: Callable[..., tuple[trimesh.Trimesh, Sequence[float], float]]  # of a size: mesh, direction of view, cross-section


def _sidelobe(side_m: float) -> tuple[trimesh.Trimesh, Sequence[float], float]:
    angle = float(np.arcsin(SIDELOBE / (WAVENUMBER * side_m)))
    return objects.plate(side_m, side_m), (np.cos(angle), np.sin(angle), 0.0), plate_rcs(side_m, angle)


TARGETS = (
    Target("plate", "plate 5, 10, 20 cm, main lobe", "4 pi A^2/lambda^2", ((0.05,), (0.1,), (0.2,)),
           lambda side_m: (objects.plate(side_m, side_m), AHEAD, plate_rcs(side_m))),
    Target("sidelobe", "plate 5, 10, 20 cm, first sidelobe", "physical-optics sinc^2 cos^2 (Balanis 2012, 11-44)",
           ((0.05,), (0.1,), (0.2,)), _sidelobe),
    Target("dihedral", "square dihedral 5, 10, 15 cm", "8 pi a^2 b^2/lambda^2", ((0.05,), (0.1,), (0.15,)),
           lambda face_m: (objects.dihedral(face_m, face_m), AHEAD, 8 * np.pi * face_m**4 / WAVELENGTH_M**2)),
    Target("trihedral", "triangular trihedral, leg 5, 10, 15 cm", "iterative physical optics in the far field",
           ((0.05,), (0.1,), (0.15,)), lambda leg_m: (objects.trihedral(leg_m), AHEAD, trihedral_rcs(leg_m))),
    Target("sphere", "sphere r 2, 3.3, 5 cm", "Mie series (miepython)", ((0.02,), (0.033,), (0.05,)),
           lambda radius_m: (objects.sphere(radius_m, 4), (1.0, 0.2, 0.1), mie_rcs(radius_m))),
    Target("cylinder", "cylinder r 2, 3.3, 5 cm, height 8, 12, 20 cm", "exact cylinder series times 2 L^2/lambda",
           ((0.02, 0.08), (0.033, 0.12), (0.05, 0.2)),
           lambda radius_m, height_m: (objects.cylinder(radius_m, height_m, 64), (1.0, 0.13, 0.0), cylinder_rcs(radius_m, height_m))),
)  # fmt: skip


def level(mesh: trimesh.Trimesh, direction: Sequence[float], density: float, seed: int = 0, **options: object) -> float:
    """Return the ray tracer's cross-section of a mesh in dBsm. `density` is the number of rays per square wavelength."""
    return float(db(rt.rcs(mesh, direction, rays_per_wavelength2=density, seed=seed, **options)))  # type: ignore[arg-type]


@cache
def at_density(target: Target, density: float, full: bool) -> Finding:
    """Compare the ray tracer with the references for three sizes of a target, on the default ray grid and on shifted grids."""
    pairs = []
    for size in target.sizes:
        mesh, direction, reference = target.make(*size)
        pairs += [(float(db(reference)), level(mesh, direction, density, seed)) for seed in range(9 if full else 3)]
    return worst(pairs)


def drift(target: Target, full: bool) -> Finding:
    """Find the largest change of the level in dB with ray density, relative to the level at 4 rays per square wavelength."""
    pairs = []
    for size in target.sizes if full else target.sizes[:2]:
        mesh, direction, _ = target.make(*size)
        levels = [level(mesh, direction, density) for density in ((4, 8, 16, 32, 64) if full else (4, 64))]
        pairs += [(levels[0], level_db) for level_db in levels[1:]]
    return worst(pairs)


def spread(target: Target, full: bool) -> Finding:
    """Find the highest minus the lowest level in dB over ray grids that random seeds shift."""
    pairs = []
    for size in target.sizes if full else target.sizes[1:2]:
        mesh, direction, _ = target.make(*size)
        levels = [level(mesh, direction, 16, seed) for seed in range(1, 13 if full else 5)]
        pairs.append((min(levels), max(levels)))
    return worst(pairs)


def pattern(azimuth_deg: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the cross-sections of the 10 cm trihedral in dBsm at each azimuth, as (values by quadrature, values of the ray tracer)."""
    mesh = objects.trihedral(0.1)
    simulated = [level(mesh, (np.cos(a), np.sin(a), 0.0), DENSITY) for a in np.radians(azimuth_deg)]
    return np.array([db(trihedral_rcs(0.1, float(a))) for a in azimuth_deg]), np.array(simulated)


def _pattern(full: bool) -> Finding:
    reference, simulated = pattern(np.linspace(-30, 30, 121 if full else 16))
    return rms(simulated - reference)


def _pattern_prototype(full: bool) -> Finding:
    rows = [row for row in reference_rows("trihedral_10cm_pattern.csv") if abs(float(row["az_deg"])) <= 30]
    rows = rows if full else rows[::10]
    _, simulated = pattern(np.array([float(row["az_deg"]) for row in rows]))
    return rms(simulated - np.array([float(row["SBR_h0.1_dBsm"]) for row in rows]))


def _closed_forms(full: bool) -> Finding:
    """Compare the ray tracer's cross-sections at 4 rays per square wavelength with the reference table."""
    meshes = {
        "plate10cm": objects.plate(0.1, 0.1), "tri5": objects.trihedral(0.05), "tri10": objects.trihedral(0.1),
        "tri15": objects.trihedral(0.15), "dihedral5x10": objects.dihedral(0.05, 0.1), "cyl3.3x12": objects.cylinder(0.033, 0.12),
        "sphere5cm": objects.sphere(0.05),
    }  # fmt: skip
    rows = reference_rows("analytic_rcs_77GHz.csv")
    return worst([(float(row["dBsm"]), level(meshes[row["target"]], AHEAD, DENSITY)) for row in rows if row["target"] in meshes])


def _mie_table(full: bool) -> Finding:
    """Compare spheres of at least 5 mm radius, for which physical optics holds, with the Mie reference table."""
    rows = [row for row in reference_rows("mie_pec_sphere_77GHz.csv") if float(row["a_mm"]) >= 5]
    return worst([(float(r["mie_dBsm"]), level(objects.sphere(float(r["a_mm"]) / 1e3, 4), AHEAD, DENSITY)) for r in rows])


def _coarse_cylinder(full: bool) -> Finding:
    mesh, reference = objects.cylinder(0.033, 0.12, 16), db(cylinder_rcs(0.033, 0.12))
    aspects = np.linspace(0, np.pi / 8, 24 if full else 7, endpoint=False) + 0.01
    return rms([level(mesh, (np.cos(a), np.sin(a), 0.0), DENSITY) - reference for a in aspects])


def _coarse_sphere(full: bool) -> Finding:
    errors = []
    rng = np.random.default_rng(3)
    for radius in (0.033, 0.05):
        mesh, reference = objects.sphere(radius, 3), db(mie_rcs(radius))
        errors += [level(mesh, direction, DENSITY) - reference for direction in rng.normal(size=(24 if full else 4, 3))]
    return rms(errors)


def scanned(name: str) -> trimesh.Trimesh:
    """Return the mesh of a scanned object, moved so that its centre is at the origin. Raises Untestable if the file is absent."""
    path = OBJECTS / "ycb" / f"{name}.obj"
    if not path.is_file():
        raise Untestable(f"scanned object {name}.obj is missing")
    mesh = trimesh.load_mesh(path)
    mesh.apply_translation(-mesh.bounds.mean(axis=0))
    return mesh


def _scanned(name: str, full: bool) -> Finding:
    """Return the rms difference of the amplitudes of a scanned object at 4 and at 64 rays per square wavelength, over aspects."""
    mesh = scanned(name)
    aspects = np.radians(np.linspace(0, 360, 24 if full else 5, endpoint=False) + 7)
    few, many = (
        np.array([np.sqrt(rt.rcs(mesh, (np.cos(a), np.sin(a), 0.0), rays_per_wavelength2=n)) for a in aspects]) for n in (4.0, 64.0)
    )
    error = float(20 * np.log10(1 + np.sqrt(np.mean((few - many) ** 2) / np.mean(many**2))))
    return Finding(float(db(np.mean(many**2))), float(db(np.mean(few**2))), error, len(aspects))


RCS = "cross-section (dBsm)"
CASES = [
    *(
        Case(f"{t.name}-{n}-ray{'s' * (n > 1)}", "targets", f"{t.words}: {n} ray{'s' * (n > 1)} per square wavelength", t.oracle, RCS,
             limit, "dB", partial(at_density, t, float(n)))
        for t in TARGETS for n, limit in ((1, 0.5), (4, 0.25))
    ),
    *(Case(f"{t.name}-drift", "targets", f"{t.words}: from 4 to 64 rays", "itself at 4 rays", RCS, 0.25, "dB", partial(drift, t))
      for t in TARGETS),
    *(Case(f"{t.name}-seeds", "targets", f"{t.words}: grid moved at 16 rays, highest less lowest", "itself", RCS, 0.1, "dB",
           partial(spread, t)) for t in TARGETS),
    Case("trihedral-pattern", "targets", "trihedral 10 cm over +-30 degrees, rms", TARGETS[3].oracle, "difference (dB)", 0.15, "dB",
         _pattern),
    Case("trihedral-pattern-table", "targets", "trihedral 10 cm over +-30 degrees, rms",
         "reference/trihedral_10cm_pattern.csv (prototype at 0.1 wavelengths)", "difference (dB)", 0.3, "dB", _pattern_prototype),
    Case("closed-form-table", "targets", "seven targets at 4 rays", "reference/analytic_rcs_77GHz.csv", RCS, 0.5, "dB", _closed_forms),
    Case("mie-table", "targets", "spheres of 5 to 100 mm radius at 4 rays", "reference/mie_pec_sphere_77GHz.csv", RCS, 0.5, "dB",
         _mie_table),
    Case("coarse-cylinder", "targets", "16-sided cylinder over aspects, rms", "exact cylinder series", "difference (dB)", 0.5, "dB",
         _coarse_cylinder),
    Case("coarse-sphere", "targets", "1280-face spheres over aspects, rms", "Mie series (miepython)", "difference (dB)", 0.35, "dB",
         _coarse_sphere),
    *(Case(f"scan-{name.lower()}", "targets", f"scanned {words}: 4 against 64 rays, rms over aspects", "itself at 64 rays",
           "mean cross-section (dBsm)", 0.25, "dB", partial(_scanned, name), cost)
      for name, words, cost in (("TomatoSoupCan", "can", "full"), ("MustardBottle", "bottle", "full"))),
]  # fmt: skip
