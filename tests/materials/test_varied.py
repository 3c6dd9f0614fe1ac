"""Material names with factors on permittivity and loss."""

import numpy as np
import pytest

from radartwin.errors import MaterialError
from radartwin.materials import Layered, check_name, permittivity, reflection, varied


def test_factors_multiply_permittivity_and_loss():
    plain, off = permittivity("glass", 77e9), permittivity(varied("glass", 1.1, 0.5), 77e9)
    assert off.real == pytest.approx(1.1 * plain.real)
    assert off.imag == pytest.approx(0.5 * plain.imag)
    assert permittivity("glass~1.0000~1.0000", 77e9) == plain
    assert varied(varied("glass", 1.1, 0.5), 1 / 1.1, 2.0) == "glass~1.0000~1.0000"


def test_a_varied_name_is_accepted_in_a_stack():
    name = varied("plasterboard", 1.2, 1.0)
    check_name(name)
    te, _ = reflection(Layered([(name, 0.0125)], backing=varied("concrete", 0.9, 1.0)), np.array(1.0), np.array(77e9))
    assert 0 < abs(te) < 1


@pytest.mark.parametrize("name", ["glass~1", "glass~1~2~3", "glass~a~1", "glass~0~1", "glass~1~-1", "glass~nan~1"])
def test_invalid_factors_are_refused(name):
    with pytest.raises(MaterialError, match="two factors"):
        check_name(name)


def test_an_unknown_base_is_refused():
    with pytest.raises(MaterialError, match="unknown material"):
        check_name("gloss~1.0~1.0")
