"""Functions compiled by `innermost`, which does not count references to arrays, must not return or create arrays."""

import ast
from pathlib import Path

import numpy as np
import pytest
from numba.core.errors import NumbaError

import radartwin
from radartwin.compiled import innermost

SOURCES = [text for path in sorted(Path(radartwin.__file__).parent.rglob("*.py")) if innermost.__name__ in (text := path.read_text())]


def _functions() -> list[ast.FunctionDef]:
    found = [node for text in SOURCES for node in ast.walk(ast.parse(text)) if isinstance(node, ast.FunctionDef)]
    return [node for node in found if any(isinstance(d, ast.Name) and d.id == innermost.__name__ for d in node.decorator_list)]


def _handed_back(function: ast.FunctionDef) -> list[ast.expr]:
    """Return the expressions that the return statements of a function return."""
    values = [node.value for node in ast.walk(function) if isinstance(node, ast.Return) and node.value is not None]
    return [part for value in values for part in (value.elts if isinstance(value, ast.Tuple) else [value])]


def test_none_hands_back_what_may_be_an_array() -> None:
    """An array that a function returns without a reference count would be freed while the caller still uses it."""
    functions = _functions()
    assert len(functions) > 20
    for function in functions:
        numbers = [ast.dump(ast.Name(kind, ast.Load())) for kind in ("int", "float", "bool")]
        taken = {a.arg for a in function.args.args if a.annotation is None or ast.dump(a.annotation) not in numbers}
        for value in _handed_back(function):
            whole = value.value if isinstance(value, ast.Subscript | ast.Attribute) else value
            assert not (isinstance(whole, ast.Name) and whole.id in taken), (function.name, ast.unparse(value))


def test_arrays_cannot_be_made() -> None:
    @innermost
    def makes(count):
        return np.zeros(count).sum()

    with pytest.raises(NumbaError):
        makes(3)
