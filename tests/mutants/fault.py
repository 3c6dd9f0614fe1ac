"""A planted fault: one expression or statement of one function, with its faulty replacement.

The expression is compared as a syntax tree, so that comments, docstrings and formatting of the source may change.
"""

from __future__ import annotations

import ast
from dataclasses import dataclass
from typing import NamedTuple


class Change(NamedTuple):
    """One faulty replacement inside one function of a module."""

    function: str  # the name as in __qualname__, e.g. "Aspects.at"
    right: str
    wrong: str
    meaning: str


@dataclass(frozen=True)
class Fault:
    """One change of one module and the test files, separated by spaces, that must fail on it."""

    path: str
    tests: str
    change: Change

    def plant(self, source: str) -> str:
        """The module's source with the fault.

        Raises:
            LookupError: the module has no such function, or the function does not contain the expression exactly once.
        """
        tree, right = ast.parse(source), ast.dump(_parsed(self.change.right))
        functions = _functions(tree)
        if self.change.function not in functions:
            raise LookupError(f"{self.path} has no function {self.change.function}; correct the fault in tests/mutants/faults.py")
        places = [node for node in ast.walk(functions[self.change.function]) if ast.dump(node) == right]
        if len(places) != 1:
            raise LookupError(
                f"{self.path}: {self.change.function} contains `{self.change.right}` {len(places)} times, not once; "
                "correct the fault in tests/mutants/faults.py"
            )
        return ast.unparse(_Replacement(places[0], _parsed(self.change.wrong)).visit(tree))


class _Replacement(ast.NodeTransformer):
    def __init__(self, place: ast.AST, wrong: ast.AST):
        self.place, self.wrong = place, wrong

    def visit(self, node: ast.AST) -> ast.AST:
        return self.wrong if node is self.place else super().visit(node)


def _parsed(source: str) -> ast.AST:
    (statement,) = ast.parse(source).body
    return statement.value if isinstance(statement, ast.Expr) else statement


def _functions(node: ast.AST, prefix: str = "") -> dict[str, ast.AST]:
    """Functions and methods by qualified name."""
    found: dict[str, ast.AST] = {}
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.FunctionDef):
            found[prefix + child.name] = child
        elif isinstance(child, ast.ClassDef):
            found |= _functions(child, f"{prefix}{child.name}.")
    return found
