"""Implement `radartwin doctor`: check this machine, an output folder or a recording set, and print how to correct each problem."""

from __future__ import annotations

import contextlib
import importlib.metadata
import os
import shutil
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from radartwin.constants import __version__
from radartwin.errors import OutputError
from radartwin.io import files
from radartwin.io.one_line import plural
from radartwin.runs.checkout import commit
from radartwin.store.products import CACHE

LIBRARIES = ("mitsuba", "drjit", "numpy", "scipy", "trimesh", "hydra-core", "mlflow", "matplotlib")
DISK_NEEDED_GB = 5.0  # free disk space that runs need; the quick profile writes less than 1 GB, the paper profile a few GB


@dataclass(frozen=True)
class Finding:
    """One line of the report that `radartwin doctor` prints. With status `missing`, the machine cannot run simulations."""

    topic: str
    status: Literal["ok", "note", "missing"]
    text: str
    remedy: str = ""


def doctor(output: Path) -> int:
    """Print what was checked on this machine and how to correct each problem. Return exit status 0 if simulations can run, else 2."""
    findings = list(examine(output))
    for finding in findings:
        print(f"{finding.status:8s}{finding.topic:10s}{finding.text}")
    for finding in findings:
        if finding.remedy:
            print(f"to do: {finding.remedy}")
    usable = all(finding.status != "missing" for finding in findings)
    print(f"doctor: this machine {'can' if usable else 'cannot yet'} run simulations{'' if usable else '; see above'}")
    return 0 if usable else 2


def doctor_data(folder: Path) -> int:
    """Print the content of a recording set and all its problems. Return exit status 0 if the recording set can be used, else 2."""
    from radartwin.io.progress import Progress
    from radartwin.recordings.examine import examine as examine_set

    report = examine_set(folder, Progress())
    for kind, lines in (("note", report.notes), ("problem", report.problems)):
        for line in lines:
            print(f"{kind:9s}{line}")
    radar = f"; radar {report.radar.name}" if report.radar else ""
    licence = f", {report.card.licence}" if report.card and report.card.licence else ""
    name = report.card.name if report.card and report.card.name else str(folder)
    size = f"{plural(len(report.rows), 'recording')}, {plural(report.frames, 'frame')}, {report.bytes / 1e6:.1f} MB"
    print(f"{name}: {size}{radar}{licence}")
    for column in ("object", "distance_m", "room", "motion", "split"):
        counts = report.counts(column)
        if any(counts.keys()):
            print(f"{column:12s}{', '.join(f'{key or None} {count}'.lower() for key, count in counts.items())}")
    print(f"doctor: {plural(len(report.problems), 'problem')}; see above" if report.problems else "doctor: the set can be used")
    return 2 if report.problems else 0


def examine(output: Path) -> Iterator[Finding]:
    head, dirty = commit()
    code = f", commit {head[:12]}{' with changes' if dirty else ''}" if head != "none" else ""
    number = ".".join(map(str, sys.version_info[:3]))
    good = (3, 11) <= sys.version_info[:2] <= (3, 13)
    remedy = "" if good else "install Python 3.11, 3.12 or 3.13"
    yield Finding("python", "ok" if good else "missing", f"{number}; radartwin {__version__}{code}", remedy)
    installed = {}
    for name in LIBRARIES:
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):
            installed[name] = importlib.metadata.version(name)
    yield Finding("libraries", "ok", ", ".join(map(" ".join, installed.items())))
    if absent := [name for name in LIBRARIES if name not in installed]:
        yield Finding("libraries", "missing", ", ".join(absent), f"pip install {' '.join(absent)} -c constraints.txt")
    yield from _devices()
    pages = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 1e9
    yield Finding("machine", "ok", f"{plural(os.cpu_count() or 1, 'core')}, {pages:.0f} GB memory")
    try:
        files.check_folder(output)
    except OutputError as error:
        yield Finding("disk", "missing", str(error), "give a folder that can be written with --output DIR")
        return
    folder = next(parent for parent in (output.absolute(), *output.absolute().parents) if parent.exists())
    free = shutil.disk_usage(folder).free / 1e9
    enough = free >= DISK_NEEDED_GB
    remedy = "" if enough else f"free {DISK_NEEDED_GB:g} GB or choose another folder with --output DIR"
    yield Finding("disk", "ok" if enough else "note", f"{free:.0f} GB free in {folder}", remedy)
    if (output / CACHE).is_dir():
        size_mb = files.folder_bytes(output / CACHE) / 1e6
        yield Finding("cache", "ok", f"{size_mb:.0f} MB in {output / CACHE}; runs compute again what is deleted there")
    yield _tracking(output)


def _devices() -> Iterator[Finding]:
    from radartwin.simulation import variant

    cuda, llvm = variant.has_cuda(), variant.find_llvm()
    yield Finding("gpu", "ok" if cuda else "note", "NVIDIA device found" if cuda else "no NVIDIA device; the CPU computes the simulation")
    if llvm is not None:
        yield Finding("llvm", "ok", f"version {variant.llvm_version(llvm)}, {llvm}")
    else:
        explicit = os.environ.get("DRJIT_LIBLLVM_PATH")
        text = f"DRJIT_LIBLLVM_PATH={explicit} is no library" if explicit else "no library"
        text += f" of version {variant.LLVM_MINIMUM} or newer"
        yield Finding("llvm", "note" if cuda else "missing", text, variant.REMEDY)
    if cuda or llvm is not None:
        yield Finding("variant", "ok", "cuda_ad_rgb" if cuda else "llvm_ad_rgb")


def _tracking(output: Path) -> Finding:
    from radartwin.runs.tracking import DATABASE

    database = output.absolute() / DATABASE
    if not database.exists():
        return Finding("tracking", "ok", f"{database} will be created by the first run")
    import sqlite3

    try:
        with contextlib.closing(sqlite3.connect(f"file:{database}?mode=ro", uri=True, timeout=5)) as connection:
            runs = connection.execute("SELECT count(*) FROM runs").fetchone()[0]
    except sqlite3.Error as error:
        return Finding("tracking", "note", f"{database}: {error}", f"move {database} away; the next run creates it again")
    return Finding("tracking", "ok", f"{database}, {plural(runs, 'run')}")
