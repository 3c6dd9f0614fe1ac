"""Copy NumPy arrays to the device on which Dr.Jit computes (GPU or CPU). Import this module only after a Mitsuba variant is active.

Numbers that change from call to call become opaque Dr.Jit variables, because Dr.Jit compiles a kernel again for every new numeric literal.
"""

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

_ALIGNMENT = 64  # memory alignment in bytes, the width of the widest vector register of any CPU
_DTYPES = {"Float": np.float32, "Float64": np.float64, "UInt": np.uint32, "UInt64": np.uint64, "Bool": np.bool_}


def upload(kind: Any, values: np.ndarray) -> Any:
    """Copy `values` to a device array of type `kind` in such a way that Dr.Jit can reuse compiled kernels.

    On the CPU, a compiled kernel depends on the memory alignment of NumPy arrays, which changes from call to call. The function therefore
    copies the values to aligned memory. It makes a single value opaque, because Dr.Jit would otherwise compile the value into the kernel.
    """
    if np.size(values) == 1:
        return dr.opaque(kind, np.asarray(values).reshape(-1)[0].item())
    itemsize = dr.itemsize_v(kind)
    flat = np.asarray(values).ravel()
    buffer = np.empty(flat.size * itemsize + _ALIGNMENT, np.uint8)
    start = -buffer.ctypes.data % _ALIGNMENT
    aligned = buffer[start : start + flat.size * itemsize].view(_DTYPES[kind.__name__])
    aligned[:] = flat
    return kind(aligned)


def vectors(values: np.ndarray) -> Any:
    """Copy F vectors `values` (F, 3) to the device, in single precision."""
    return mi.Vector3f(*(upload(mi.Float, values[:, i]) for i in range(3)))
