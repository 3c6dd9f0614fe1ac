"""The paper's Table 1, cell by cell, with the sentences of the paper about each cell.

The first source of every cell is the table itself (`tab:positioning`); SAID adds quotations from the paper's text. A test compares both
with the paper if the paper lies beside the checkout. "yes", "partly", "no" and "-" stand for the table's marks: present, partly present,
absent, and not applicable.
"""

from __future__ import annotations

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


def source(system: str, axis: str) -> str:
    """Return the source of a cell as text."""
    said = SAID.get((system, axis))
    return f'{axis}: Table 1 and the text, "{said}"' if said else f"{axis}: Table 1"
