"""Plant each deliberate fault of faults.py in a copy of the repository, and run the quick physics tests, which must detect the fault.

    make mutants                              all faults
    python tests/mutants/plant.py layers rcs  the faults of files whose path contains one of these words

The program prints one line per fault. The exit status is 1 if the tests do not detect a fault or if the code to change is not found.
"""

from __future__ import annotations

import ast
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from faults import TABLE

ROOT = Path(__file__).resolve().parents[2]
LIMIT_S = 900


class Fault(NamedTuple):
    """A deliberate fault: the expression or statement of a function that it replaces, the faulty replacement, and the test files that must
    fail.
    """

    path: str
    tests: list[str]
    function: str  # the name as in __qualname__, e.g. "Aspects.at"
    right: str
    wrong: str
    meaning: str

    def plant(self, source: str) -> str:
        """Return the module's source with the fault. The function compares expressions as syntax trees, so comments and formatting do not
        matter.

        Raises:
            LookupError: the module does not contain the function, or the function does not contain the expression exactly once.
        """
        tree, right = ast.parse(source), ast.dump(_parsed(self.right))
        functions = _functions(tree)
        if self.function not in functions:
            raise LookupError(f"{self.path} has no function {self.function}; correct the fault in tests/mutants/faults.py")
        places = [node for node in ast.walk(functions[self.function]) if ast.dump(node) == right]
        if len(places) != 1:
            raise LookupError(
                f"{self.path}: {self.function} contains `{self.right}` {len(places)} times, not once; "
                "correct the fault in tests/mutants/faults.py"
            )
        return ast.unparse(_Replacement(places[0], _parsed(self.wrong)).visit(tree))


class _Replacement(ast.NodeTransformer):
    def __init__(self, place: ast.AST, wrong: ast.AST):
        self.place, self.wrong = place, wrong

    def visit(self, node: ast.AST) -> ast.AST:
        return self.wrong if node is self.place else super().visit(node)


def _parsed(source: str) -> ast.AST:
    (statement,) = ast.parse(source).body
    return statement.value if isinstance(statement, ast.Expr) else statement


def _functions(node: ast.AST, prefix: str = "") -> dict[str, ast.AST]:
    """Return {qualified name: syntax tree} of all functions and methods."""
    found: dict[str, ast.AST] = {}
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.FunctionDef):
            found[prefix + child.name] = child
        elif isinstance(child, ast.ClassDef):
            found |= _functions(child, f"{prefix}{child.name}.")
    return found


def read(table: str) -> list[Fault]:
    """Read the faults from a table in the format of faults.py."""
    faults = []
    for section in table.strip().split("\n\n"):
        head, *rows = section.splitlines()
        module, _, tests = head.partition(": ")
        files = [f"tests/{name}.py" for name in tests.split()]
        faults += [Fault(f"radartwin/{module}.py", files, *row.split(" | ")) for row in rows]
    return faults


FAULTS = read(TABLE)


def test_status(tests: Sequence[str], tree: Path) -> int | None:
    """Return the exit status of pytest on these test files in the copy of the repository; None after a timeout."""
    command = [sys.executable, "-m", "pytest", "-q", "-x", "--no-header", "-p", "no:cacheprovider", *tests]
    environment = {**os.environ, "PYTHONPATH": str(tree), "NUMBA_CACHE_DIR": str(tree / "numba")}
    try:
        return subprocess.run(command, cwd=tree, env=environment, capture_output=True, timeout=LIMIT_S, check=False).returncode
    except subprocess.TimeoutExpired:
        return None


def outcome(fault: Fault, tree: Path) -> str:
    """Plant the fault, run its tests, and return the verdict. The verdict is `caught` if a test fails or does not end, `NOT CAUGHT` if all
    tests pass, and `NO PLACE` if the code to change is not found. For any other exit status of pytest, the verdict names this status.
    """
    path = tree / fault.path
    source = path.read_text(encoding="utf-8")
    try:
        path.write_text(fault.plant(source), encoding="utf-8")
    except LookupError as error:
        return f"NO PLACE ({error})"
    try:
        status = test_status(fault.tests, tree)
    finally:
        path.write_text(source, encoding="utf-8")
    return {0: "NOT CAUGHT", 1: "caught", None: "caught"}.get(status, f"pytest {status}")


def main(words: Sequence[str]) -> int:
    chosen = [fault for fault in FAULTS if not words or any(word in fault.path for word in words)]
    missed = 0
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "tree"
        shutil.copytree(ROOT, tree, ignore=shutil.ignore_patterns(".git", ".venv", "outputs", "__pycache__", "results"))
        (tree.parent / "shared").symlink_to(ROOT.parent / "shared")  # some tests skip without its files, and detect nothing
        tests = sorted({test for fault in chosen for test in fault.tests})
        if test_status(tests, tree) != 0:
            print(f"mutants: these tests fail without a fault: {' '.join(tests)}")
            return 1
        for fault in chosen:
            started = time.monotonic()
            result = outcome(fault, tree)
            missed += result != "caught"
            print(f"{result:10s} {time.monotonic() - started:6.1f} s  {fault.path}: {fault.meaning}", flush=True)
    print(f"mutants: {len(chosen) - missed} of {len(chosen)} caught")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
