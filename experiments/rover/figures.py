"""Figures of the rover tables: range-time maps, rank correlations by feature family, agreement along object, distance and room."""

import numpy as np

from experiments.campaign.cases import COMPARED, LABELS, MEASURED
from experiments.campaign.frame import Frame
from experiments.drawing import PAGE_WIDTH_IN, PALETTE, Figure, figure, range_map
from radartwin.features.profile import FAR_M, NEAR_M
from radartwin.scene.objects.catalogue import catalogue

SHOWN = ("corner_reflector", "can_211_400", "mug", "mustard")  # the reflector and one object of each material class
SPAN_DB = 50.0


def panels_figure(frame: Frame) -> Figure:
    """Draw range-time maps of up to four objects at one place, preferably of a "depth" drive, each relative to its maximum."""
    places = [place for place, _ in frame.groupby(["room", "motion", "distance_m"])]
    place = next((candidate for candidate in places if candidate[1] == "depth"), places[0])
    here = frame[(frame.room == place[0]) & (frame.motion == place[1]) & (frame.distance_m == place[2])]
    names = [name for name in SHOWN if name in set(here.object)] or list(here.object.unique()[:4])
    drawing, panels = figure(len(COMPARED), len(names), width_in=PAGE_WIDTH_IN, height_in=3.6, sharex=True, sharey=True, squeeze=False)
    for line, domain in zip(panels, COMPARED, strict=True):
        for panel, name in zip(line, names, strict=True):
            drive = next(here[(here.domain == domain) & (here.object == name)].itertuples())
            inside = (drive.range_m >= NEAR_M) & (drive.range_m <= FAR_M)
            level = 10 * np.log10(np.maximum(drive.power[:, inside] / drive.power[:, inside].max(), 1e-12))
            end = len(level) / drive.frame_rate_hz
            extent = (0, end, float(drive.range_m[inside][0]), float(drive.range_m[inside][-1]))
            range_map(panel, level, extent, 0, SPAN_DB)
            panel.plot((np.arange(len(level)) + 0.5) / drive.frame_rate_hz, drive.track_m, color="white", lw=0.8, ls=":")
            if domain == MEASURED:
                panel.set_title(catalogue()[name].label)
        line[0].set_ylabel(f"{LABELS[domain]}\nrange (m)")
    for panel in panels[-1]:
        panel.set_xlabel("time (s)")
    drawing.colorbar(panels[0, 0].images[0], ax=panels, label="below the brightest cell (dB)", pad=0.01)
    drawing.suptitle(f"{place[0].replace('_', ' ')}, {place[1]} drive at {place[2]:g} m; dotted: tracked peak")
    return drawing


def correlation_figure(agreements: Frame) -> Figure:
    """Draw the rank correlations over objects by feature family (rover_fidelity.agreements), in one panel per room and motion."""
    groups = [*agreements.groupby(["room", "motion"])]
    families = list(agreements.family.unique())
    drawing, panels = figure(1, max(len(groups), 1), width_in=PAGE_WIDTH_IN, height_in=2.6, sharey=True, squeeze=False)
    for panel, ((room, motion), group) in zip(panels[0], groups, strict=False):
        for i, family in enumerate(families):
            values = group.rho[group.family == family]
            if len(values):
                spread = np.linspace(-0.25, 0.25, len(values)) if len(values) > 1 else np.zeros(1)
                panel.plot(values, i + spread, ".", ms=4, color=PALETTE[0], alpha=0.7)
                panel.plot([values.mean()] * 2, [i - 0.35, i + 0.35], color=PALETTE[1], lw=1.5)
        panel.axvline(0, color="0.5", lw=0.8)
        panel.set(title=f"{room.replace('_', ' ')}, {motion}", xlabel="rank correlation over objects (Spearman)", xlim=(-1.05, 1.05))
        panel.set_yticks(range(len(families)), families)
    return drawing


def slices_figure(slices: dict[tuple[str, str], np.ndarray]) -> Figure:
    """Draw histograms of the agreement over objects and over distances, and of its direction between rooms."""
    motions = list(dict.fromkeys(motion for motion, _ in slices))
    drawing, panels = figure(1, len(motions), width_in=PAGE_WIDTH_IN, height_in=2.4, sharey=True, squeeze=False)
    for panel, motion in zip(panels[0], motions, strict=True):
        factors = [factor for known, factor in slices if known == motion]
        for i, factor in enumerate(factors):
            values = slices[motion, factor]
            share, label = np.full(len(values), 1 / len(values)), f"{factor}, mean {values.mean():+.2f}"
            panel.hist(values, bins=np.linspace(-1, 1, 21), weights=share, histtype="step", color=PALETTE[i], label=label)
        panel.axvline(0, color="0.5", lw=0.8)
        panel.set(title=f"{motion} drives", xlabel="agreement of simulated and measured feature")
        panel.legend(title="what varies", loc="upper left")
    panels[0, 0].set_ylabel("share of features and slices")
    return drawing
