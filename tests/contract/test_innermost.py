"""Functions compiled by `innermost`, which does not count references to arrays, must not create arrays."""

import numpy as np
import pytest
from numba.core.errors import NumbaError

from radartwin.compiled import innermost


def test_arrays_cannot_be_made() -> None:
    @innermost
    def makes(count):
        return np.zeros(count).sum()

    with pytest.raises(NumbaError):
        makes(3)
