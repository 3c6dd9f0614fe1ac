"""Compare Numba, torch and Dr.Jit on the CPU: time of the diffraction coefficients of many paths.

    python -m experiments.speed.frameworks

The diffraction coefficient is the largest part of the field of a path with an edge. The three programs compute the same sum of wedge terms
in double precision on all processor cores. A time is the smallest wall-clock time of REPEATS calls. The first two calls, the first of which
compiles the program, do not count. The search for paths and the tests of visibility, which have many branches, are not part of the
comparison.
"""

import math
import time
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np

from radartwin.compiled import compiled, shared_out
from radartwin.simulation import variant
from radartwin.simulation.flat import wedge

COUNTS = (100, 1000, 10_000, 100_000, 1_000_000)
REPEATS = 7
K = 2 * math.pi / 3.9e-3  # rad/m
_STEP = wedge.LAST / wedge.STEPS
TAIL_SLOPE = (2j * _STEP * np.arange(wedge.STEPS + 1) * wedge.TAIL - 1) * _STEP  # slope of `wedge.scaled_tail`, times the step of its table


@compiled
def _pieces(begin: int, stop: int, phi: np.ndarray, phi0: np.ndarray, n: np.ndarray, distance: np.ndarray, out: np.ndarray) -> None:
    for i in range(begin, stop):
        through, first, last, _, _ = wedge.coefficients(phi[i], phi0[i], n[i], K, 1.0, distance[i])
        out[i] = through + first + last


def by_numba(paths: np.ndarray) -> Callable[[], np.ndarray]:
    """Return a call that computes the terms (N,) of paths (4, N): angles of observer and source, opening over pi, distance parameter."""
    phi, phi0, n, distance = (np.ascontiguousarray(row) for row in paths)
    out = np.empty(len(phi), complex)

    def call() -> np.ndarray:
        shared_out(_pieces, len(out), phi, phi0, n, distance, out)
        return out

    return call


def by_torch(paths: np.ndarray) -> Callable[[], np.ndarray]:
    """Return the same call in torch."""
    import torch

    phi, phi0, n, distance = (torch.tensor(row) for row in paths)
    tail, slope = torch.tensor(wedge.TAIL), torch.tensor(TAIL_SLOPE)
    operations = SimpleNamespace(
        round=torch.round, sin=torch.sin, cos=torch.cos, sqrt=torch.sqrt, where=torch.where, clip=torch.clamp, complex=torch.complex,
        whole=lambda x: x.to(torch.int64), looked_up=lambda at: (tail[at], slope[at]),
    )  # fmt: skip

    def call() -> np.ndarray:
        return _terms(operations, phi, phi0, n, distance).numpy()

    return call


def by_drjit(paths: np.ndarray) -> Callable[[], np.ndarray]:
    """Return the same call in Dr.Jit."""
    import drjit as dr
    from drjit.llvm import Complex2f64, Float64, Int32

    variant.activate()
    phi, phi0, n, distance = (Float64(row) for row in paths)
    parts = [Float64(np.ascontiguousarray(part)) for values in (wedge.TAIL, TAIL_SLOPE) for part in (values.real, values.imag)]

    def looked_up(at: Int32) -> tuple[Complex2f64, Complex2f64]:
        values = [dr.gather(Float64, part, at) for part in parts]
        return Complex2f64(*values[:2]), Complex2f64(*values[2:])

    operations = SimpleNamespace(
        round=dr.round, sin=dr.sin, cos=dr.cos, sqrt=dr.sqrt, where=dr.select, clip=dr.clip, complex=Complex2f64, whole=Int32,
        looked_up=looked_up,
    )  # fmt: skip

    def call() -> np.ndarray:
        out = _terms(operations, phi, phi0, n, distance)
        dr.eval(out)
        dr.sync_thread()
        return np.array(out.real) + 1j * np.array(out.imag)

    return call


def _terms(at: SimpleNamespace, phi: Any, phi0: Any, n: Any, distance: Any) -> Any:
    """Return the sum of the four wedge terms with the array operations `at`, as in `wedge.coefficients` but without slopes and limits."""
    total, kl = 0, K * distance
    for beta in (phi - phi0, phi + phi0):
        for sign in (1.0, -1.0):
            order = at.round((sign * math.pi + beta) / (2 * math.pi * n))
            argument = (math.pi + sign * beta) / (2 * n)
            u = at.sqrt(2 * kl) * abs(at.cos(math.pi * n * order - 0.5 * beta))
            place = at.clip(u, 0.0, wedge.LAST - 1e-9) * (wedge.STEPS / wedge.LAST)
            i = at.whole(place)
            t = place - i
            rest = 1 - t
            (low, rise), (high, fall) = at.looked_up(i), at.looked_up(i + 1)
            near = low * ((1 + 2 * t) * rest * rest) + high * (t * t * (3 - 2 * t)) + rise * (t * rest * rest) - fall * (t * t * rest)
            x = at.clip(u, wedge.LAST, 1e9)
            far = at.complex((0.5 / x**2 - 1.875 / x**6) / (2 * x), -(1 - 0.75 / x**4) / (2 * x))
            total = total + at.complex(0 * u, 2 * u) * at.where(u < wedge.LAST, near, far) * (at.cos(argument) / at.sin(argument))
    return total * at.complex(0 * n - math.sqrt(0.5), 0 * n + math.sqrt(0.5)) / (2 * n * math.sqrt(2 * math.pi * K))


def sample(count: int) -> np.ndarray:
    """Return random paths (4, count) for the three programs."""
    rng = np.random.default_rng(1)
    n = rng.choice([1.5, 2.0], count)
    return np.stack([rng.uniform(0.1, 0.95, count) * n * np.pi, rng.uniform(0.1, 0.95, count) * n * np.pi, n, rng.uniform(0.3, 3, count)])


def seconds(call: Callable[[], object]) -> float:
    """Return the smallest wall-clock time of REPEATS calls, after two calls that compile."""
    call()
    call()
    times = []
    for _ in range(REPEATS):
        began = time.perf_counter()
        call()
        times.append(time.perf_counter() - began)
    return min(times)


def main() -> None:
    print(f"{'paths':>9} {'Numba':>10} {'torch':>10} {'Dr.Jit':>10}   milliseconds")
    for count in COUNTS:
        calls = [by(sample(count)) for by in (by_numba, by_torch, by_drjit)]
        known = calls[0]()
        for call in calls[1:]:
            np.testing.assert_allclose(call(), known, rtol=1e-9)
        print(f"{count:9d} " + " ".join(f"{1e3 * seconds(call):10.3f}" for call in calls), flush=True)


if __name__ == "__main__":
    main()
