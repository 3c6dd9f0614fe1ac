"""Compare RadarTwin with other radar simulation systems: the paper's Table 1, the source of every cell, and checks of our own cells.

The cells of other systems are those of the paper's table (`tab:positioning`): "yes", "partly", "no" and "-" (not applicable). SAID adds
quotations from the paper's text. A cell of RadarTwin's row is empty if its check in `capabilities` fails; two cells of Sionna RT and of the
re-implemented RF-Genesis, which also run here, are checked too. A row "holds" if every checked cell agrees with the paper. The paper claims
that no other system has all capabilities; the last row counts those that have, among the paper's own cells.
"""

from typing import Any

import numpy as np

from experiments import verdicts
from experiments.interface import Config, Progress, Result, Store, Table
from experiments.positioning import capabilities
from experiments.statistics import exact

AXES = ("mechanism", "scene input", "material model", "multipath", "real scene", "no RF data", "target")
TICKS = ("multipath", "real scene", "no RF data")
OURS = "RadarTwin"

CELLS: dict[str, tuple[str, ...]] = {
    "EM solvers": ("full-wave / RT", "manual CAD", "manual per-surf.", "yes", "yes", "yes", "general"),
    "Sionna RT": ("diff. ray trace", "imported mesh", "ITU per-surf.", "yes", "yes", "yes", "comms channel"),
    "ViRa": ("game engine", "engine mesh", "simplified", "partly", "yes", "yes", "robotics"),
    "Shenron/C-Shenron": ("ray tracing", "LiDAR + cam.", "reflectivity", "yes", "yes", "yes", "driving"),
    "Vid2Doppler": ("video projection", "video", "none", "no", "no", "yes", "human"),
    "RF-Genesis": ("RT + diffusion", "vision + diffusion", "uniform", "yes", "no", "yes", "human"),
    "RF-Diffusion": ("diffusion", "-", "-", "-", "no", "no", "signal gen."),
    "mmCLIP": ("mocap synthesis", "human mesh", "none", "no", "no", "yes", "activity"),
    "RFCanvas": ("RT + learned", "mono. + few-shot RF", "learned", "yes", "yes", "no", "channel"),
    OURS: ("ray tracing", "3D scene repr.", "VLM -> ITU", "yes (4-bounce)", "yes", "yes", "objects & materials"),
}

SAID: dict[tuple[str, str], str] = {
    ("EM solvers", "scene input"): "they typically require expert-built CAD scenes",
    ("EM solvers", "material model"): "manually assigned material properties",
    ("Sionna RT", "mechanism"): "provides differentiable ray tracing",
    ("Sionna RT", "target"): "for wireless communication channels",
    ("Shenron/C-Shenron", "scene input"): "use LiDAR and camera data",
    ("Shenron/C-Shenron", "material model"): "material-aware simulation",
    ("Shenron/C-Shenron", "target"): "for driving scenarios",
    ("Vid2Doppler", "mechanism"): "maps video to Doppler signatures",
    ("RF-Genesis", "mechanism"): "combines ray tracing with diffusion-generated scenes",
    ("RF-Genesis", "real scene"): "diffusion-generated scenes and human meshes",
    ("RF-Genesis", "target"): "usually focused on humans or gestures",
    ("RF-Diffusion", "mechanism"): "generates time-frequency radar representations",
    ("RF-Diffusion", "real scene"): "do not model the material composition and multipath structure of a specific indoor deployment",
    ("mmCLIP", "mechanism"): "synthesized from human motion-capture sequences",
    ("mmCLIP", "material model"): "motion-capture synthesis with no material or environment model",
    ("mmCLIP", "multipath"): "motion-capture synthesis with no material or environment model",
    ("mmCLIP", "target"): "transfers zero-shot to real data for activity recognition",
    ("RFCanvas", "scene input"): "from a few real RF measurements",
    ("RFCanvas", "material model"): "fits per-surface channel properties",
    ("RFCanvas", "no RF data"): "presupposes RF hardware already deployed at the target site",
    (OURS, "mechanism"): "Our implementation uses Mitsuba~3",
    (OURS, "scene input"): "starts from the actual indoor scene",
    (OURS, "material model"): "assigns radar-relevant materials without manual labeling",
    (OURS, "multipath"): "multi-bounce propagation",
    (OURS, "real scene"): "it reconstructs the room",
    (OURS, "no RF data"): "requires no real RF measurements to generate training data",
    (OURS, "target"): "indoor object and material recognition",
}

TABLE = Table(
    name="positioning",
    title="Capabilities of RadarTwin and other systems",
    caption="Table 1 of the paper. The cells of other systems are the paper's. Our cells are the result of checks of the code; a cell "
    "is empty where the check contradicts the paper. Two cells each of Sionna RT and of the re-implemented RF-Genesis are "
    "checked too. The verdict of a row is that all its checked cells agree with the paper. n counts checked cells.",
)

DOMAINS = {"RF-Genesis": "capability check of the re-implementation"}
MATERIALS_BY_HAND = ("EM solvers", "Sionna RT")  # the paper says "manual per-surf."; a user of Sionna RT gives each surface an ITU material


def run(config: Config, store: Store, progress: Progress) -> Result:
    """Return the rows of the table. The last row is the number of other systems that have every capability."""
    rows = [row(system) for system in progress.over(list(CELLS), "systems")]
    rows.append(others_with_all())
    radartwin_row = next(r for r in rows if r["method"] == OURS)
    return Result(TABLE.name, rows, metrics={"our_cells_confirmed": float(radartwin_row["value"])})


def row(system: str) -> dict[str, Any]:
    """Run the checks of one system and return the system's row of the table."""
    cells: dict[str, str] = dict(zip(AXES, CELLS[system], strict=True))
    notes: list[str] = []
    agree: list[bool] = []
    checks = capabilities.CHECKS.get(system, {})
    for axis, check in checks.items():
        result, right = check()
        agree.append(right)
        if system == OURS:
            cells[axis] = result if right else ""
        notes.append(f"{axis}: {result}" if right else f"{axis}: {result}, not {CELLS[system][AXES.index(axis)]}")
    return {
        "method": system, **cells, "sources": "; ".join(source(system, axis) for axis in AXES),
        "checked here": "; ".join(notes), **verdicts.score_columns(
            "share of checked cells that are as the paper says", exact(float(np.mean(agree)) if agree else np.nan, len(agree)),
            DOMAINS.get(system, "capability check") if agree else "paper", all(agree),
        ), "paper": f"{sum(cells[axis].startswith('yes') for axis in TICKS)} of {len(TICKS)} marks",
    }  # fmt: skip


def source(system: str, axis: str) -> str:
    """Return as text the source of a table cell, given the system (row) and the capability (column)."""
    said = SAID.get((system, axis))
    return f'{axis}: Table 1 and the text, "{said}"' if said else f"{axis}: Table 1"


def others_with_all() -> dict[str, Any]:
    """Return a row with the number of other systems that have all three capabilities and do not need materials assigned by hand."""
    marked = [s for s, cells in CELLS.items() if s != OURS and all(cells[AXES.index(axis)] == "yes" for axis in TICKS)]
    rivals = [system for system in marked if system not in MATERIALS_BY_HAND]
    note = f"all three marks: {', '.join(marked)}; of these with materials not given by hand: {', '.join(rivals) or 'none'}"
    return {
        "method": "only one that does all", **dict.fromkeys(AXES, ""),
        "sources": 'caption of Table 1: "the only method that infers per-surface materials automatically from an available 3D scene '
        'representation while modeling environment multipath and requiring no RF data"',
        "checked here": f"{note}; the paper does not say whether Shenron infers the reflectivity of each surface",
        **verdicts.score_columns("other systems with every mark", exact(len(rivals), len(CELLS) - 1), "paper"), "paper": "0",
    }  # fmt: skip
