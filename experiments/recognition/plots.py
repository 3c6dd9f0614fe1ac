"""Figures of the recognition tables: bars, confusion matrices, maps of embeddings, accuracy against the number of labelled recordings."""

import itertools
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from experiments.drawing import COLUMN_WIDTH_IN, PAGE_WIDTH_IN, PALETTE, Figure, error_bars, figure, place
from radartwin.recognize.samples import MEASURED, Samples

GREY = "0.65"
MOST_LEVEL = 6  # largest number of groups of bars whose names fit side by side
Row = Mapping[str, Any]


def grouped(
    rows: Iterable[Row], group: str | Callable[[Row], str], bar: str = "method", metric: str = "accuracy"
) -> dict[str, dict[Any, Row]]:
    """Return {group: {bar: row}} of the rows with this metric of the configured twin and testbed, from their columns `group` and `bar`."""
    groups: dict[str, dict[Any, Row]] = {}
    for row in rows:
        if row["metric"] == metric and not row.get("twin") and not row.get("truth"):
            groups.setdefault(row[group] if isinstance(group, str) else group(row), {})[row[bar]] = row
    return groups


def values(groups: Mapping[str, Mapping[str, Row]], prefix: str = "accuracy") -> dict[str, float]:
    """Return the values of rows by names that start with a prefix, for the metrics of a result."""
    names = {(group, bar): re.sub(r"[^\w.]+", "_", f"{prefix}_{group}_{bar}").strip("_") for group, of in groups.items() for bar in of}
    return {name: float(groups[group][bar]["value"]) for (group, bar), name in names.items()}


def bars(groups: Mapping[str, Mapping[str, Row]], ylabel: str, title: str = "", grey: str = "") -> Figure:
    """Draw bars with confidence intervals from {group: {method: row}}, and a line at the chance level of each group."""
    from matplotlib.patheffects import withStroke

    drawing, axis = figure(width_in=PAGE_WIDTH_IN, height_in=2.6)
    methods = list(dict.fromkeys(method for group in groups.values() for method in group))
    colours = {grey: GREY} | dict(zip((method for method in methods if method != grey), itertools.cycle(PALETTE), strict=False))
    width, named = 0.8 / len(methods), set()
    for at, group in enumerate(groups.values()):
        for number, method in enumerate(methods):
            if method not in group:
                continue
            row, x = group[method], at + (number - (len(methods) - 1) / 2) * width
            value, errors = error_bars([row])
            axis.bar(x, row["value"], 0.92 * width, color=colours[method], label="" if method in named else method)
            named.add(method)
            axis.errorbar(x, value, errors, color="black", lw=0.8, capsize=2)
            halo = [withStroke(linewidth=2, foreground=colours[method])]  # a low bar does not cover its number
            axis.text(
                x - 0.23 * width, 0.02, f"{row['value']:.2f}", rotation=90, color="white", ha="center", va="bottom", path_effects=halo
            )
        chance = next(iter(group.values()))["chance"]
        axis.plot([at - 0.45, at + 0.45], [chance, chance], color="black", ls="--", lw=0.8, label="chance" if at == 0 else None)
    turned = {"rotation": 30, "ha": "right"} if len(groups) > MOST_LEVEL else {}
    axis.set_xticks(range(len(groups)), list(groups), **turned)
    axis.set(ylabel=ylabel, ylim=(0, 1), title=title)
    handles, labels = axis.get_legend_handles_labels()
    order = sorted(range(len(labels)), key=lambda i: labels[i] == "chance")
    drawing.legend([handles[i] for i in order], [labels[i] for i in order], loc="outside upper center", ncols=3)
    return drawing


def accuracy_bars(name: str, group: str, bar: str = "method", grey: str = "", confusion: bool = False) -> tuple[Any, Any]:
    """Return figures and metrics of a table for `framed`: bars of accuracy, grouped by a column, and confusion matrices if asked for."""

    def figures(rows: Sequence[Any], first: Any) -> dict[str, Callable[[], Figure]]:
        drawn = {name: lambda: bars(grouped(rows, group, bar), "accuracy", grey=grey)}
        return drawn | ({f"{name}_confusion": lambda: confusions(rows)} if confusion else {})

    return figures, lambda rows: values(grouped(rows, group, bar))


def confusions(rows: Iterable[Any]) -> Figure:
    """Draw a confusion matrix, normalised by its rows (true classes), for each table row with a panel (title, truth, prediction)."""
    from sklearn.metrics import confusion_matrix

    panels = {row.panel[0]: row.panel[1:] for row in rows if row.panel and not row.get("twin") and not row.get("truth")}
    drawing, axes = figure(1, len(panels), width_in=PAGE_WIDTH_IN, height_in=3.4, squeeze=False, sharey=True)
    classes = sorted({str(label) for truth, _ in panels.values() for label in truth})
    names = [name.replace("_", " ") for name in classes]
    for axis, (title, (truth, prediction)) in zip(axes[0], panels.items(), strict=True):
        shares = confusion_matrix(truth, prediction, labels=classes, normalize="true")
        axis.imshow(shares, vmin=0, vmax=1, cmap="Blues")
        for row, column in np.argwhere(shares >= 0.005):
            dark = "white" if shares[row, column] > 0.6 else "black"
            axis.text(column, row, f"{100 * shares[row, column]:.0f}", ha="center", va="center", color=dark)
        axis.set_xticks(range(len(names)), names, rotation=60, ha="right")
        axis.set_yticks(range(len(names)), names)
        axis.set(title=title, xlabel="answer (% of a class)")
        axis.spines[:].set_visible(False)
    axes[0, 0].set_ylabel("object")
    return drawing


def embedding_map(recordings: Samples, classes: Mapping[str, str], title: str) -> Figure:
    """Draw measured (filled) and simulated embeddings on their first two principal components, coloured by class."""
    from sklearn.decomposition import PCA

    drawing, axis = figure(width_in=COLUMN_WIDTH_IN * 1.5, height_in=3.2)
    plane = PCA(2, svd_solver="full").fit(recordings.values)
    points = plane.transform(recordings.values)
    kinds = sorted(set(classes.values()))
    colours, markers = dict(zip(kinds, PALETTE, strict=False)), dict(zip(kinds, "os^D", strict=False))
    for kind in kinds:
        for domain, filled in (("simulated", False), (MEASURED, True)):
            mask = (recordings.domain == domain) & np.array([classes[label] == kind for label in recordings.label])
            face = colours[kind] if filled else "none"
            label = f"{kind}, {domain}"
            axis.scatter(*points[mask].T, s=14, marker=markers[kind], facecolors=face, edgecolors=colours[kind], lw=0.8, label=label)
    share = 100 * plane.explained_variance_ratio_
    axis.set(title=title, xlabel=f"component 1 ({share[0]:.0f} % of variance)", ylabel=f"component 2 ({share[1]:.0f} %)")
    drawing.legend(loc="outside upper center", ncols=2)
    drawing.draw_without_rendering()
    measured = recordings.domain == MEASURED
    first = [int(np.flatnonzero(measured & (recordings.label == name))[0]) for name in recordings.classes]
    order = [*first, *(k for k in range(len(points)) if k not in first)]  # a measured point of each object has a label
    names = [str(recordings.label[k]).replace("_", " ") if k in first else "" for k in order]
    place(axis, [tuple(points[k]) for k in order], names, ["black"] * len(order))
    return drawing


def label_curve(rows: Mapping[str, Mapping[Any, Row]], chance: float) -> Figure:
    """Draw accuracy against the number of labelled recordings per class (symlog axis), from {method: {number: row}}."""
    drawing, axis = figure(width_in=COLUMN_WIDTH_IN * 1.4, height_in=2.8)
    for number, (method, by_number) in enumerate(rows.items()):
        value, low, high = (np.array([row[name] for row in by_number.values()], float) for name in ("value", "low", "high"))
        colour = PALETTE[number % len(PALETTE)]
        axis.plot(list(by_number), value, color=colour, marker="os^DvPX"[number % 7], ms=4, label=method)
        axis.fill_between(list(by_number), low, high, color=colour, alpha=0.2, lw=0)
    axis.axhline(chance, color="black", ls="--", lw=0.8, label="chance")
    ticks = sorted({shots for by_number in rows.values() for shots in by_number})
    axis.set_xscale("symlog", base=2, linthresh=1)
    axis.set_xticks(ticks, [str(tick) for tick in ticks])
    axis.minorticks_off()
    axis.set(xlabel="labelled measured revolutions per class", ylabel="accuracy", ylim=(0, 1.02))
    drawing.legend(loc="outside upper center", ncols=2)
    return drawing
