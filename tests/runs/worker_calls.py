"""Functions that tests call in worker processes. Workers that import this module instead of the tests start in half the time."""

from __future__ import annotations

import os
import time
from pathlib import Path

import numpy as np

from radartwin.errors import ConfigError
from radartwin.store.products import Store, save_arrays


def product(one: int, other: int) -> tuple[int, int]:
    return one * other, os.getpid()


def failing(one: int, how: str) -> int:
    if one == 3:
        raise {"refused": ConfigError("number 3 is refused"), "hungry": MemoryError("unable to allocate 8 TiB")}[how]
    return one


def broken(one: int, zero: int) -> float:
    return one / zero


def killed(one: int, number: int) -> None:
    os.kill(os.getpid(), number)


def slow_pid() -> int:
    time.sleep(0.1)
    return os.getpid()


def product_slowly(one: int, other: int) -> int:
    time.sleep(0.05)
    return one


def build(root: Path, seed: int) -> bool:
    return Store(root).fetch("recording", {"seed": seed}, ["radartwin.constants"], lambda f: save_arrays(f, {"x": np.ones(3)})).reused
