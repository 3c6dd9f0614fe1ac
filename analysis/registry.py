"""Every table of the study: what it is called and what its caption says. The order here is the order of the report."""

from __future__ import annotations

from dataclasses import dataclass

from radartwin.errors import ConfigError


@dataclass(frozen=True)
class Table:
    """An entry: `name` is also the experiment (experiments/NAME.py, conf/experiment/NAME.yaml) and the file name.

    `named_in`: profiles in which it takes too long to be made without being named.
    """

    name: str
    title: str
    caption: str
    named_in: tuple[str, ...] = ()
    page: str = ""  # module with page(rows), an interactive page beside the figures


TABLES = (
    Table(
        name="validation",
        title="What the tracer is checked against",
        caption="Every physics oracle: closed forms, Mie and layered-cylinder series, near-field quadrature, all image sources of "
        "rectangular rooms, transfer matrices, exact kinematics; none shares code with the tracer. Reference and ours are the figures "
        "where they differ most over the n comparisons of a row; value is the error, which the limit bounds.",
    ),
    Table(
        name="backend_crosscheck",
        title="The same paths by three methods",
        caption="Specular paths of up to four bounces in the procedural rooms, within 40 dB of the strongest: image sources of the room's "
        "six planes, Sionna RT with transmitter and receiver in one place, and with the receiver 3 cm aside (in one place it misses what "
        "comes back out of corners, aside it finds one of a corner's orders), each matched to this tracer's panel images by length and "
        "both directions. Levels are claimed where the first Fresnel zone is clear; where an edge cuts it, an infinite mirror is off by "
        "the difference. n counts paths; intervals are bootstraps over them.",
    ),
    Table(
        name="speed_accuracy",
        title="Speed against accuracy",
        caption="Every method that runs here on five problems: seconds a frame (of processors, all threads, kernels compiled, what a radar "
        "at rest shares with a whole recording divided among its frames; wall clock beside), memory above idle, rays, and errors of the "
        "signal and of the range profile within 40 dB. Methods alternate; a value is a method's time over the default's, in the median and "
        "from least to most over n rounds. Exact references stand beside the front. RF-Genesis style as published is timed on one of the "
        "128 sums of a frame and scaled. On the campaign, methods make the twin's turntables of all objects: error of the features "
        "against the measured ones in spreads of these, and share of measured turns whose symmetry a linear probe misses that was trained "
        "on the simulation; n counts recordings there, timed as they were made. Times are of the machine that the rows name.",
        page="experiments.speed.chart_page",
    ),
    Table(
        name="stability",
        title="Where methods fail",
        caption="Error of every method along sweeps that get harder, against closed forms, series, quadrature and image sources; a value "
        "is the number of swept values, easiest first, before the error passes 3 dB. Methods without absolute level are calibrated on a "
        "metal sphere at 1 m. Equal safe regions count as the largest.",
    ),
    Table(
        name="complexity",
        title="How much model a scene needs",
        caption="What simulator=auto chooses: the cheapest model whose features, on a few frames of a recording, stay within their "
        "repeatability limit (what two recordings set up anew differ by with 95 %, of that object at 1 m, in the testbed) of the finest "
        "model's: whole room, five bounces, four tubes a square wavelength. An error is of the worst feature, in limits; judged on as many "
        "frames between those of the choice. The fixed default is the cheapest setting known to do for all cases, of what is chosen for "
        "all at once and of the shipped default. A value is its core seconds a frame over auto's, from least to most over n rounds, "
        "without the choice itself, which takes the seconds told beside and pays after so many frames; the median is over each case's own "
        "feature set, its interval a bootstrap over cases. One case in the quick profile.",
    ),
    Table(
        name="campaign",
        title="The recordings of both domains",
        caption="Every recording that the tables below share, and what making it took: clean and processed, on this machine, by whichever "
        "run made it. Turntables are traced at the aspects of one turn, drives share what is set up for their track. Targets are the "
        "project's own; intervals are bootstraps over recordings.",
    ),
    Table(
        name="scan",
        title="From a scan to surfaces",
        caption="A virtual phone with LiDAR walks through each procedural room; its frames are fused, segmented and outlined as a "
        "user's are, and scored against the room. Strength scales every error of the phone; targets are the project's own and are "
        "checked at every strength. n counts true surfaces of which 0.25 m2 or more were seen, absent ones included, or scans; intervals "
        "are bootstraps over them.",
    ),
    Table(
        name="labels",
        title="What surfaces are made of, and what a wrong answer costs",
        caption="The virtual scans labelled by recorded answers of a general-purpose vision-language model (asked blind, from the exported "
        "pictures and the prompt alone), by one uniform material and at random, against the rooms' truth, by area. Within 1 dB: the "
        "reflection of the label's material is that near the truth's, in the mean over angles and the sweep. Whether a source beats "
        "uniform plasterboard in mean dB is judged room by room. Intervals are Wilson's at the effective number of surfaces, and "
        "bootstraps over surfaces for the gain.",
    ),
    Table(
        name="gallery",
        title="Side by side",
        caption="Recordings of the campaign measured (above) and simulated (below), each column on one scale of decibels: range over time, "
        "over Doppler (on a turntable across the frames of a turn, which fold at the frame rate in both; else within the middle frame) and "
        "over azimuth. The twin is the room as scanned, its materials by the vision-language model's answers. Other pairs: radartwin run "
        "experiment=gallery experiment.pairs=[OBJECT/ROOM/MOTION/DISTANCE_M,...]. Rows: one recording each, so without intervals.",
    ),
    Table(
        name="gaps",
        named_in=("quick",),
        title="Each gap by itself",
        caption="With every gap off and the twin told the true materials and the exact room, what is left between the domains is the "
        "room's storage in single precision (gap none; claimed against what finer tracing with one bounce more changes). Then each gap "
        "alone: how far it moves the features of the same recordings, beside what physics says of it, written "
        "before the first run. Changes are of the complex signal, in the target gate and half a metre and more from it; geometry moves the "
        "twin, all others the testbed. Three objects on the lab's turntable and one drive in the squash court; intervals are bootstraps "
        "over objects.",
    ),
    Table(
        name="gap_attribution",
        title="Which gap costs what",
        caption="What each gap between the testbed and the twin costs: alone (all others off), left out (all others on), and as its share "
        "of what all cost together (Shapley, exact over the groups, so that shares sum to the total). Losses per recording of a turntable "
        "at 1 m in the laboratory: features apart in spreads between objects, range profiles no longer correlated (decibels), objects no "
        "longer told by forests that learned the twin. Quick: four objects, and only the gaps that need no costly room; clutter, the finer "
        "solver and wrong labels stay off in it and count in the paper profile alone. Materials hold roughness, course holds trajectory "
        "and placement, in the paper profile clutter holds the solver. Intervals are bootstraps over objects; each gap is one draw.",
    ),
    Table(
        name="turntable_shape",
        title="Shape",
        caption="Objects on a turntable in the laboratory: angular harmonic ratio (power at 1 to 6 cycles per turn over DC, of "
        "the target gate less the noise), its order over objects in both domains, the distances between objects over all "
        "shape features (Mantel test), the range-Doppler signatures of a turn (SSIM; slow time at the frame rate, so that"
        " the rim folds, identically in both domains), its variation with distance, and the ripple that flat facets add. "
        "Intervals are 95 % bootstraps over items; n counts recordings.",
    ),
    Table(
        name="turntable_material",
        title="Material",
        caption="Objects of similar size on a turntable: target-gate brightness with the range law taken out, by class of "
        "material at each distance, measured and simulated; the corner reflector is left out. Intervals are 95 % "
        "bootstraps over objects.",
    ),
    Table(
        name="turntable_size",
        title="Size",
        caption="Six cans of one diameter and several heights on a turntable: order of brightness by height (Spearman, exact p) "
        "and its slope (Theil and Sen). Intervals are 95 % bootstraps over cans.",
    ),
    Table(
        name="linear_rail",
        title="Translation",
        caption="A corner reflector on a 60 cm rail from one metre, radially and at 45 degrees: power-weighted range of the "
        "tracked peak, sought in the whole span of the rail; the strongest path that does not jump (continuous) and the "
        "strongest bin of each frame (brightest).",
    ),
    Table(
        name="environment",
        title="The room in the signal",
        caption="Corner reflector on a turntable in a laboratory room: Pearson correlation of mean range profiles with "
        "the measured domain, simulated in void and in the reconstructed room, and the share of energy beyond it. Profiles "
        "from 0.3 to 5.5 m; intervals are 95 % percentile bootstraps over the n measured recordings; a row without a claim "
        "of the paper is untestable.",
    ),
    Table(
        name="rover_fidelity",
        title="Along trajectories",
        caption="Objects before a driving rover: tracked range after the start offset, mean normalised range profile, velocity "
        "from Doppler against the log, order of objects by each feature at matched distance (Spearman; exact binomial p "
        "of the positive share, features taken as independent), and metal less plastic brightness. Intervals are 95 % "
        "bootstraps, shares Clopper-Pearson.",
    ),
    Table(
        name="rover_disentangle",
        title="Object, distance, room",
        caption="Agreement of simulated and measured features with two of object, distance and room held and the third varied; "
        "correlations pooled over distances and matched; and how the variance of their disagreement divides among the "
        "three. Bootstraps over objects.",
    ),
    Table(
        name="corner_reflector_calibration",
        title="Calibrated by one corner reflector",
        caption="Brightness that is left between measured and simulated revolutions after an affine map out of one unlabelled recording of "
        "the reflector at the middle distance; the reflector is not scored. Intervals are bootstraps over objects and distances.",
    ),
    Table(
        name="sensitivity",
        named_in=("quick", "paper"),
        title="What each simulator setting is worth",
        caption="The default with one thing changed at a time, and the finest, with four times the rays and a fifth bounce. Feature "
        "error: root mean square, over a recording's features, of the difference from the finest twin's, each in units of its standard "
        "deviation over the finest twin's recordings of that motion; what drives carry is as coarse in the finest. Times are of recordings "
        "that found their track set up, and of set-ups apart. Below them every headline of the fidelity tables, with its change from the "
        "default's.",
    ),
    Table(
        name="labelled_probe",
        title="What training on simulation is worth",
        caption="An encoder trained on noise copies of simulated revolutions, frozen; measured revolutions are told by the nearest "
        "centroid of others. Other recordings are of other distances, so nothing of the same recording helps. RF-Genesis is the"
        " mended re-implementation; the testbed is of the same physics family as our tracer, which favours ours. Labels per "
        "class are drawn from half of each object's recordings, the other half is scored. n counts recordings, answers "
        "revolutions; intervals are bootstraps over objects and distances.",
    ),
    Table(
        name="turntable_label_free",
        title="What is told without labels on the turntable",
        caption="Rotation vectors rank-normalised within domain and distance; an encoder trained on the simulated ones, and a linear probe "
        "on its embeddings. Chance of geometry and material is the share of the majority.",
    ),
    Table(
        name="contrastive",
        title="Simulated radar aligned with descriptions",
        caption="Balanced accuracy of linear probes on embeddings of measured revolutions, learned from other recordings or from other "
        "objects alone; a class of one object has no other and is left out there.",
    ),
    Table(
        name="rover_recognition",
        title="Recognition by supervision level",
        caption="Random forests on frames and the majority per recording. Label-free: ranks within domain and distance. Calibrated: "
        "energy features mapped by one unlabelled recording of the reflector, which is not scored; chance of material is the "
        "majority's share for accuracy and one third for balanced accuracy. p is the exact binomial one over recordings.",
    ),
    Table(
        name="reconstruction_ablation",
        title="What the reconstruction is worth",
        caption="Label-free recognition of lateral drives in the squash court from twins with labelled materials, with plasterboard "
        "everywhere, and without the room. Unequal answers are recordings that one twin alone gets right, by the majority of "
        "the seeds.",
    ),
    Table(
        name="material_errors",
        title="What wrong materials cost",
        caption="The reconstruction ablation's protocol with a share of the room's labels drawn at random; the level error is the root "
        "mean square over range, 0.3 to 5.5 m, against the twin with true materials.",
    ),
    Table(
        name="positioning",
        title="Among other systems",
        caption="The paper's Table 1. Cells of other systems are the paper's; ours are what checks of the code found, and empty where they "
        "found otherwise. Two cells each of Sionna RT and of the re-implemented RF-Genesis are checked too. A row holds where every "
        "checked cell is as the paper says; n counts checked cells.",
    ),
)

# Said under every table that is scored against the testbed, so that nobody takes it for a measurement of reality.
TESTBED_NOTE = (
    "Scored against the testbed, a virtual measurement campaign that deliberately differs from the twin: this tests "
    "the method and each named gap; it is not a measurement of reality."
)


def select(names: list[str] | None, profile: str = "paper") -> list[Table]:
    """The tables of these names, or all that a profile makes unasked. Raises ConfigError for an unknown one."""
    known = {table.name: table for table in TABLES}
    for name in names or ():
        if name not in known:
            raise ConfigError(f"--only {name}: there is no such table; tables: {', '.join(known)}")
    return [known[name] for name in names] if names else [table for table in TABLES if profile not in table.named_in]
