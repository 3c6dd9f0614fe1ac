"""Store traced paths in the shared array cache (radartwin/store/array_cache.py), so that each room is traced only once."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from radartwin.simulation.paths import Paths
from radartwin.store import array_cache
from radartwin.store.array_cache import Arrays
from radartwin.store.digest import array_digest, source_digest, spec_digest


def traced_once(spec: Mapping[str, Any], arrays: Mapping[str, np.ndarray], trace: Callable[[], list[Paths]]) -> list[Paths]:
    """Return the cached paths, or call `trace` and cache its paths. Do not write to the returned arrays, because callers share them.

    Args:
        spec: settings that affect the paths. arrays: geometry, reflection tables and poses that affect the paths.
    """
    digests = {name: array_digest(array) for name, array in arrays.items()}
    key = spec_digest({"spec": spec, "arrays": digests, "source": source_digest(["radartwin.simulation"])})
    cache = array_cache.shared()
    found = cache.get(key, from_arrays)
    if found is None:
        found = trace()
        cache.put(key, to_arrays(found))
    return found


def to_arrays(parts: Sequence[Paths]) -> dict[str, np.ndarray]:
    """Return the fields of all parts as named arrays."""
    arrays = {"parts": np.array(len(parts))}
    for i, part in enumerate(parts):
        values = {field.name: getattr(part, field.name) for field in dataclasses.fields(Paths)}
        arrays |= {f"{i}.{name}": np.asarray(value) for name, value in values.items() if value is not None}
    return arrays


def from_arrays(arrays: Arrays) -> list[Paths]:
    """Rebuild the parts from the arrays of `to_arrays`. Raises ValueError, LookupError or TypeError for arrays that do not fit together."""
    parts = []
    for i in range(int(arrays["parts"])):
        values: dict[str, Any] = {f.name: arrays[f"{i}.{f.name}"] for f in dataclasses.fields(Paths) if f"{i}.{f.name}" in arrays}
        for name, value in values.items():
            if name not in ("poses", "frequencies_hz") and len(value) != len(values["pose"]):
                raise ValueError(f"{name} has {len(value)} entries, not {len(values['pose'])}")
        values["poses"] = int(values["poses"])
        parts.append(Paths(**values))
    return parts
