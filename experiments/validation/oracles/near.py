"""Validation cases of targets and panels at close range (quadrature, iterative physical optics), and of the range law at large distance."""

from functools import cache, partial

import numpy as np

import radartwin as rt
from experiments.validation.oracles import traced
from experiments.validation.oracles.case import SPEED_OF_LIGHT, WAVELENGTH_M, Case, Finding, db, reference_rows, worst
from experiments.validation.oracles.iterative_optics import corner_echoes
from experiments.validation.oracles.nearfield import chain_quadrature, panel_quadrature
from experiments.validation.oracles.targets import AHEAD, DENSITY, level
from radartwin.scene import objects

DISTANCES_M = (0.5, 1.0, 2.0)
RCS = "effective cross-section (dBsm)"


def effective(amplitude: np.ndarray, distance_m: np.ndarray) -> np.ndarray:
    """Return the cross-section in dBsm of a far-field target with the same received amplitude at the same distance."""
    return db((4 * np.pi) ** 3 * distance_m**4 * abs(amplitude) ** 2 / WAVELENGTH_M**2)


MESHES = {
    "plate": ("plate 5, 10, 15 cm", {s: objects.plate(s, s) for s in (0.1, 0.05, 0.15)}),
    "trihedral": ("trihedral 5, 10, 15 cm", {s: objects.trihedral(s) for s in (0.1, 0.05, 0.15)}),
    "dihedral": ("square dihedral 5, 10, 15 cm", {s: objects.dihedral(s, s) for s in (0.1, 0.05, 0.15)}),
}


def curve(name: str, size_m: float, distances_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the effective cross-sections in dBsm at each distance, as (reference, values of the ray tracer)."""
    mesh = MESHES[name][1][size_m]
    simulated = [level(mesh, AHEAD, DENSITY, distance=float(d)) for d in distances_m]
    return effective(corner_echoes(name, size_m, distances_m[:, None] * AHEAD, WAVELENGTH_M), distances_m), np.array(simulated)


def _near(name: str, full: bool) -> Finding:
    pairs = []
    for size in list(MESHES[name][1])[: 3 if full else 1]:
        reference, simulated = curve(name, size, np.array(DISTANCES_M))
        pairs += list(zip(reference.tolist(), simulated.tolist(), strict=True))
    return worst(pairs)


def _table(full: bool) -> Finding:
    """Compare the levels of plate, trihedrals and can at 0.5 to 2 m, relative to their far field, with the reference table."""
    rows = {float(row["R_m"]): row for row in reference_rows("near_over_far_field_dB.csv")}
    meshes = {
        "plate10cm": (objects.plate(0.1, 0.1), 19.1855), "tri5": (objects.trihedral(0.05), 2.3731),
        "tri10": (objects.trihedral(0.1), 14.4143), "tri15": (objects.trihedral(0.15), 21.4579),
        "cyl3.3x12": (objects.cylinder(0.033, 0.12), -1.1527),
    }  # fmt: skip
    return worst([
        (far + float(rows[distance][name]), level(mesh, AHEAD, DENSITY, distance=distance))
        for name, (mesh, far) in meshes.items() for distance in DISTANCES_M
    ])  # fmt: skip


def _range_law(full: bool) -> Finding:
    """Compare received power times R^4 at distances R of 10 to 80 m with the value at 5 m, for a 3 cm plate and dihedral."""
    pairs = []
    for mesh in (objects.plate(0.03, 0.03), objects.dihedral(0.03, 0.03)):
        first = level(mesh, AHEAD, DENSITY, distance=5.0)
        pairs += [(first, level(mesh, AHEAD, DENSITY, distance=d)) for d in ((10.0, 20.0, 40.0, 80.0) if full else (10.0, 40.0))]
    return worst(pairs)


def _friis(method: str, full: bool) -> Finding:
    """Compare the echo of a 12 m wall at distances d of 1 to 4 m with Friis' formula lambda/(4 pi 2 d) for the image at distance 2 d."""
    pairs = []
    for distance in (1.0, 2.0, 4.0) if full else (2.0,):
        scene = rt.Scene([rt.Surface(objects.plate(12.0, 12.0), "metal", "wall")])
        sensor = np.array([distance, 0.13, -0.21])
        frequency = traced.MONOSTATIC.center_frequency_hz
        simulated = traced.field(traced.trace(scene, traced.MONOSTATIC, traced.pose(sensor), traced.settings(method)), frequency)
        pairs.append((20 * np.log10(SPEED_OF_LIGHT / frequency / (8 * np.pi * distance)), 20 * np.log10(abs(simulated))))
    return worst(pairs)


def panel_positions(full: bool) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return (corners, sensor) of panels of 0.1 to 1 m seen from 0.5 to 4 m, from the middle to one width beyond the edge."""
    positions = []
    for width in (0.1, 0.3, 1.0):
        half = width / 2
        corners = np.array([[0, -half, -half], [0, half, -half], [0, half, half], [0, -half, half]])
        for distance in (0.5, 1.0, 2.0, 4.0) if full else (0.5, 2.0) if width < 0.5 else (2.0,):
            for beyond in (0.0, 0.25, 0.5, 0.75, 1.0, 1.5) if full else (0.0, 0.5, 1.5):
                for up in (0.03, 0.4) if full else (0.03,):
                    positions.append((corners, np.array([distance, beyond * width, up * width])))
    return positions


@cache
def exact_panels(full: bool) -> list[complex]:
    """Return the exact echo amplitude by quadrature for every entry of `panel_positions`."""
    wavelength = SPEED_OF_LIGHT / traced.MONOSTATIC.center_frequency_hz
    return [panel_quadrature(corners, sensor, wavelength) for corners, sensor in panel_positions(full)]


def panel_errors(method: str, full: bool) -> np.ndarray:
    """Return the magnitude of the ray tracer's amplitude error at every panel position, relative to the echo of an infinite panel."""
    frequency = traced.MONOSTATIC.center_frequency_hz
    wavelength = SPEED_OF_LIGHT / frequency
    errors = []
    for (corners, sensor), exact in zip(panel_positions(full), exact_panels(full), strict=True):
        scene = rt.Scene([rt.Surface(traced.polygon(corners), "metal", "panel", role="object" if method == "tubes" else "room")])
        settings = traced.settings(method, rays_per_wavelength2=4.0)
        simulated = traced.field(traced.trace(scene, traced.MONOSTATIC, traced.pose(sensor), settings), frequency)
        image = wavelength / (8 * np.pi * sensor[0])
        errors.append(abs(simulated - exact) / image)
    return np.array(errors)


def _panels(method: str, full: bool) -> Finding:
    return worst([(0.0, float(error)) for error in panel_errors(method, full)])


def _two_panels(method: str, full: bool) -> Finding:
    """Compare the double bounce of two 0.5 m panels at a right angle, relative to the double image of infinite panels."""
    frequency = traced.MONOSTATIC.center_frequency_hz
    wavelength = SPEED_OF_LIGHT / frequency
    first = np.array([[0.001, 0, -0.25], [0.5, 0, -0.25], [0.5, 0, 0.25], [0.001, 0, 0.25]])
    second = first[:, [1, 0, 2]]
    role = "object" if method == "tubes" else "room"
    scene = rt.Scene([rt.Surface(traced.polygon(corners), "metal", name, role=role) for corners, name in ((first, "a"), (second, "b"))])
    errors = []
    for sensor in ([1.0, 0.8, 0.02], [0.4, 1.5, 0.1], [1.2, 1.2, -0.2]) if full else ([1.0, 0.8, 0.02],):
        place = np.array(sensor)
        parts = traced.trace(scene, traced.MONOSTATIC, traced.pose(place), traced.settings(method, max_bounces=2, rays_per_wavelength2=4.0))
        simulated = traced.field([part.where(part.bounces == 2) for part in parts], frequency)
        exact = sum(chain_quadrature(order, place, wavelength) for order in ((first, second), (second, first)))
        errors.append(abs(simulated - exact) / (wavelength / (8 * np.pi * np.hypot(*place[:2]))))
    return Finding(0.0, max(errors), max(errors), len(errors))


QUADRATURE = "near-field physical-optics quadrature, geometric-optics illumination"
CASES = [
    *(
        Case(f"near-{name}", "near field", f"{words} at 0.5, 1 and 2 m, 4 rays",
             QUADRATURE if name == "plate" else "iterative physical optics", RCS, 0.2, "dB", partial(_near, name))
        for name, (words, _) in MESHES.items()
    ),
    Case("near-table", "near field", "plate, trihedrals and can at 0.5, 1 and 2 m", "reference/near_over_far_field_dB.csv", RCS, 0.3,
         "dB", _table),
    Case("range-law", "near field", "plate and dihedral 3 cm from 5 to 80 m", "R^-4", RCS, 0.05, "dB", _range_law),
    *(
        case
        for method, words in traced.METHODS.items()
        for case in (
            Case(f"friis-{method}", "near field", f"12 m metal wall, {words}", "Friis over the image's distance",
                 "received over transmitted power (dB)", 0.25, "dB", partial(_friis, method)),
            Case(f"panel-{method}", "near field", f"0.1 to 1 m panels at 0.5 to 4 m to a width beyond the edge, {words}, worst", QUADRATURE,
                 "complex error over the image", 0.01, "", partial(_panels, method), "full" if method == "tubes" else "quick"),
            Case(f"two-panels-{method}", "near field", f"two 0.5 m panels at a right angle, double bounce, {words}", QUADRATURE,
                 "complex error over the image", 0.03, "", partial(_two_panels, method)),
        )
    ),
]  # fmt: skip
