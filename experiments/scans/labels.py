"""Accuracy of the materials that three sources assign to scanned surfaces, and the reflection error of wrong materials.

The surfaces of the simulated phone scans get labels from the recorded answers of the vision-language model, from one uniform material, or
at random, and are scored by area. A label is close if its reflectivity differs from that of the true material by at most 1 dB, as a mean of
the absolute difference over angles of incidence (plaster for a paint surface, but not metal for wood). It is right if it belongs to the
true category of the data set MINC; for the category `other`, it must also be close. The mean reflection error of each source is then
compared with that of uniform plasterboard.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from experiments import statistics, verdicts
from experiments.drawing import Figure
from experiments.interface import Config, Progress, Result, Store, Table
from experiments.scans import virtual_scan
from experiments.statistics import Estimate
from radartwin.label.material_score import CLOSE_DB, Judged, accuracy_table, judge
from radartwin.label.material_sources import material_source, without_fragments
from radartwin.scene import rooms
from radartwin.scene.scene import Scene

TABLE = Table(
    name="labels",
    title="Material labels, and the reflection error of wrong labels",
    caption="The virtual scans are labelled by the recorded answers of a general-purpose vision-language model, by one material "
    "everywhere, and at random. The model saw the exported pictures and the prompt only. Labels are compared with the true "
    "materials by area. A label is within 1 dB if the mean reflection of its material, over angles and the frequency sweep, is "
    "within 1 dB of the true material's. The gain of a source is the decrease of the mean reflection error in dB relative to "
    "plasterboard everywhere. It is judged for each room: the claim holds if the whole interval is above zero. The diffuse distance "
    "compares the diffuse echoes of the labelled and the true roughness at normal incidence. Intervals of shares are Wilson intervals "
    "at the effective number of surfaces; intervals of the gain are bootstraps over surfaces.",
)

SOURCES: dict[str, dict[str, Any]] = {"vlm": {"missing": "plasterboard"}, "uniform": {"material": "plasterboard"}, "random": {"p": 1.0}}


def run(config: Config, store: Store, progress: Progress) -> Result:
    """Assign materials to the scans at strength 1 from every source, and score the assigned materials."""
    from radartwin.label.material_map import material_map

    rows: list[dict[str, Any]] = []
    keys, labelled = [], {}
    for room in progress.over(config.profile.scan_rooms, "labels"):
        product = virtual_scan.fetch(config, store, room, 1.0)
        keys.append(product.key)
        scene, truth = virtual_scan.scene_of(product), rooms.room(room, detail="cluttered")
        judged: dict[str, Sequence[Judged]] = {}
        for source in SOURCES:
            if source == "random":  # labels are drawn from the categories of the room; the right category is never drawn
                true = material_source("true", scene=truth)(without_fragments(scene, truth))
                labelled[room, source] = material_source(source, seed=config.seed, **SOURCES[source])(true)
            else:
                labelled[room, source] = material_source(source, **SOURCES[source])(scene)
            judged[source] = judge(labelled[room, source], truth)
        rows += [_answered(room, labelled[room, "vlm"], product.key), *_rows(room, judged, product.key)]
        rows += [_beats(room, judged, source, config, product.key) for source in ("vlm", "random")]
    figures: dict[str, Callable[[], Figure]] = {
        f"labels_{room}": lambda room=room: material_map(labelled[room, "vlm"]) for room in config.profile.scan_rooms
    }
    metrics = {
        f"{row['metric'].replace(' ', '_')}_{row['source']}_{row['room']}": row["value"]
        for row in rows
        if row["category"] == "all" and row["source"] != "random"
    }
    return Result(TABLE.name, rows, figures, metrics, keys)


def _row(room: str, source: str, area_m2: float, metric: str, estimate: Estimate, key: str, category: str = "all", note: str = "",
         holds: bool | None = None) -> dict[str, Any]:  # fmt: skip
    return {
        "room": room, "source": source, "category": category, "area_m2": round(area_m2, 2), "note": note,
        **verdicts.score_columns(metric, estimate, "virtual scan", holds, [key]),
    }  # fmt: skip


def _answered(room: str, scene: Scene, key: str) -> dict[str, Any]:
    """Return a row with the share of the scan's area that has a recorded answer; the rest gets the substitute material."""
    area = np.array([s.mesh.area for s in scene])
    share = area[[s.provenance["source"] == "vlm" for s in scene]].sum() / area.sum()
    return _row(room, "vlm", float(area.sum()), "answered", statistics.exact(share, len(scene)), key)


def _rows(room: str, judged: dict[str, Sequence[Judged]], key: str) -> list[dict[str, Any]]:
    """Return the rows of each material source over all categories, and the rows of the recorded answers by category."""
    rows = []
    for source, answers in judged.items():
        for line in accuracy_table(answers).to_dict("records"):
            if source != "vlm" and line["minc"] != "all":
                continue
            n = int(line["n"])
            estimates = {
                "right category": Estimate(line["accuracy"], line["low"], line["high"], n),
                f"within {CLOSE_DB:g} dB": Estimate(line["close"], line["close_low"], line["close_high"], n),
                "mean distance dB": statistics.exact(line["mean_db"], n),
                "worst distance dB": statistics.exact(line["worst_db"], n),
                "mean diffuse distance dB": statistics.exact(line["diffuse_db"], n),
            }
            if source == "uniform":  # the uniform material has no category
                del estimates["right category"]
            note = f"{line['guessed']:.0%} of the area has a substitute material or uncertain layers" if line["guessed"] else ""
            rows += [
                _row(room, source, float(line["area_m2"]), metric, estimate, key, line["minc"], note)
                for metric, estimate in estimates.items()
            ]
    return rows


def _beats(room: str, judged: dict[str, Sequence[Judged]], source: str, config: Config, key: str) -> dict[str, Any]:
    """Return a row with the mean error of plasterboard minus that of a source in dB, weighted by area. Random labels are a control."""
    areas = np.array([j.area_m2 for j in judged[source]])
    gain = np.array([u.distance_db - j.distance_db for u, j in zip(judged["uniform"], judged[source], strict=True)])
    mean = statistics.ratio(gain * areas, areas, config.profile.resamples, config.seed)
    control = source == "random"
    note = "control" if control else f"{source} beats uniform plasterboard in mean dB"
    holds = None if control else mean.low > 0
    return _row(room, source, float(areas.sum()), "gain over uniform dB", mean, key, note=note, holds=holds)
