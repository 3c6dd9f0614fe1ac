"""The faults that `make mutants` plants: changes of one line of the physics, each with the quick tests that should notice."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Fault:
    """One change of one line, what it means, and the tests that should notice."""

    path: str
    right: str
    wrong: str
    meaning: str
    tests: str


def _in(path: str, tests: str, *changes: tuple[str, str, str]) -> list[Fault]:
    """Faults of one module: (right, wrong, meaning) each."""
    return [Fault(f"radartwin/{path}.py", right, wrong, meaning, tests) for right, wrong, meaning in changes]


MATERIALS, MINC = "tests/physics/test_materials.py", "tests/materials/test_minc.py"
RCS, TUBES, SHELLS = "tests/physics/test_rcs.py", "tests/physics/test_tubes.py", "tests/physics/test_shells.py"
SYNTHESIS, DIFFUSE, IMAGES = "tests/physics/test_synthesis.py", "tests/physics/test_diffuse.py", "tests/physics/test_images.py"
COUPLING, DRIVES, ASPECTS = "tests/physics/test_coupling.py", "tests/physics/test_drives.py", "tests/physics/test_aspects.py"
RECEIVER, HARDWARE, BASELINES = "tests/physics/test_receiver.py", "tests/physics/test_hardware.py", "tests/physics/test_baselines.py"
POSES, POINTS = "tests/simulation/test_poses.py", "tests/physics/test_point_targets.py"
RADAR, CFAR, FEATURES = "tests/radar/test_radar.py", "tests/radar/test_cfar.py", "tests/features/test_features.py"
GATE, PROFILE, RANK = "tests/features/test_gate_align.py", "tests/features/test_profile.py", "tests/features/test_rank_calibration.py"

MATERIAL_FAULTS = (
    *_in(
        "materials/layers",
        MATERIALS,
        ("r_te = (kz[outer] - kz[inner])", "r_te = (kz[inner] - kz[outer])", "TE reflection has the wrong sign"),
        (
            "media[inner] * kz[outer] - media[outer] * kz[inner]) / d",
            "media[inner] * kz[inner] - media[outer] * kz[outer]) / d",
            "TM reflection swaps the wave numbers",
        ),
        ("once = np.exp(-1j * k0", "once = np.exp(1j * k0", "a lossy layer amplifies"),
        ("te, through_te = (r_te + te * once**2)", "te, through_te = (r_te + te * once)", "a layer is passed once, not twice"),
        ("t_te * once * through_te", "t_te * through_te", "a layer is passed without phase or loss"),
        ("sin2 = 1 - np.asarray(cos_incidence, float) ** 2", "sin2 = 1 - np.asarray(cos_incidence, float)", "sine of the wrong angle"),
    ),
    *_in(
        "materials/itu",
        MATERIALS,
        ("return real - 1j * conductivity", "return real - 2j * conductivity", "twice the conductivity"),
        ("return real - 1j * conductivity", "return real + 1j * conductivity", "gain instead of loss"),
    ),
    *_in(
        "materials/roughness",
        MATERIALS,
        ("return np.exp(-2 * (wavenumber", "return np.exp(-1 * (wavenumber", "Ament's factor on power"),
        ("np.exp(-0.5 * (wavenumber", "np.exp(-2 * (wavenumber", "a rough face dims what passes as what returns"),
    ),
    *_in(
        "materials/liquids",
        MATERIALS,
        ("static - f * ((static - first)", "static - ((static - first)", "water does not relax"),
        ("np.asarray(eps) ** (1 / 3)", "np.asarray(eps) ** (1 / 2)", "Looyenga's law of mixtures with another power"),
    ),
    *_in("materials/distance", MINC, ("np.maximum(10 * np.log10(", "np.maximum(20 * np.log10(", "decibels of power counted twice")),
)

TRACER_FAULTS = (
    *_in(
        "simulation/rcs",
        RCS,
        (
            "return float(4 * np.pi * abs(2 * wavenumber * total) ** 2)",
            "return float(4 * np.pi * abs(wavenumber * total) ** 2)",
            "far-field cross-section 6 dB low",
        ),
        ("stand_off**4", "stand_off**3", "near field falls with the wrong power of distance"),
        (
            "np.exp(1j * wavenumber * (hits.length_in_m + hits.length_out_m))",
            "np.exp(1j * wavenumber * (hits.length_in_m - hits.length_out_m))",
            "the way back is not added to the way there",
        ),
    ),
    *_in(
        "simulation/tubes",
        f"{RCS} {TUBES}",
        (
            "wavenumber = dr.opaque(mi.Float, 2 * np.pi * self.frequency_hz",
            "wavenumber = dr.opaque(mi.Float, np.pi * self.frequency_hz",
            "half the wavenumber in the tubes",
        ),
    ),
    *_in(
        "simulation/scatter",
        f"{RCS} {TUBES}",
        ("dr.rcp(8 * np.pi * contact.cosine)", "dr.rcp(4 * np.pi * contact.cosine)", "a footprint radiates 6 dB too much"),
        ("radiated.append(electric + magnetic)", "radiated.append(electric - magnetic)", "magnetic currents have the wrong sign"),
        ("bends = [0.5 * wavenumber * bend(i, i)", "bends = [0.25 * wavenumber * bend(i, i)", "half the second-order phase of a footprint"),
    ),
    *_in(
        "simulation/contact",
        f"{RCS} {TUBES}",
        ("feet[i] + turn * (2 * contact.cosine)", "feet[i] + turn * contact.cosine", "a curved mirror has half its power"),
        ("dr.select(one, -im, re * sign), dr.select(one, re,", "dr.select(one, im, re * sign), dr.select(one, -re,", "a caustic delays"),
    ),
    *_in(
        "simulation/footprint",
        f"{RCS} {TUBES}",
        ("moment[1] -= part * sine", "moment[1] += part * sine", "second-order phase of a footprint has the wrong sign"),
    ),
    *_in(
        "simulation/coverage",
        "tests/physics/test_coverage.py",
        ("u, v = u / depth, v / depth", "u, v = u, v", "corners are not projected onto the grid"),
        (
            "int(np.ceil(u[n].max())) + MARGIN + 1",
            "int(np.ceil(u[n].max())) - MARGIN",
            "the cells of a facet end before the facet does",
        ),
    ),
    *_in(
        "simulation/shell",
        SHELLS,
        ("shift = np.exp(1j * wavenumber", "shift = np.exp(-1j * wavenumber", "a wall's thickness shifts the phase the wrong way"),
        ("turned = Layered(material.layers[::-1])", "turned = Layered(())", "a wall seen from inside is nothing"),
    ),
    *_in(
        "simulation/transit",
        SHELLS,
        ("s * (te_re * s_im + te_im * s_re)", "s * (te_re * s_im - te_im * s_re)", "a wall leads where it should lag"),
    ),
    *_in(
        "simulation/diffuse",
        DIFFUSE,
        (
            "(wavelength_m / product) ** 2 / (16 * np.pi**3)",
            "(wavelength_m / product) ** 2 / (64 * np.pi**3)",
            "scattered power 6 dB low",
        ),
        ("np.sqrt(power[kept]) * scatterers", "power[kept] * scatterers", "power taken for amplitude"),
        ("rate = -2 * np.einsum", "rate = -1 * np.einsum", "half the Doppler shift of what is diffuse"),
        ("(1 - coherent**2) * np.abs(c) ** 2", "(1 - coherent) * np.abs(c) ** 2", "more power is lost to roughness than is scattered"),
        ("area = upto[-1] / count / 2 /", "area = upto[-1] / count /", "scatterers stand for twice the area"),
        ("return ~geometry.scene().ray_test(ray).numpy()", "return np.ones(len(distance), bool)", "scatterers are seen through walls"),
    ),
    *_in(
        "simulation/images",
        IMAGES,
        ("flip @ shift[i] + 2 * panels.offset[p]", "flip @ shift[i] + panels.offset[p]", "an image stands half as far behind its mirror"),
        (
            "all(h.max() > aperture.BEHIND for h in height)",
            "any(h.max() > aperture.BEHIND for h in height)",
            "panels mirror what is behind",
        ),
    ),
    *_in(
        "simulation/aperture",
        IMAGES,
        ("* complex(-im, re)", "* complex(im, -re)", "the edge wave has the wrong sign"),
        ("            total = before", "            total = max(total, before)", "what a shadow misses stays, and its cuts as well"),
    ),
    *_in(
        "simulation/coupling",
        COUPLING,
        (
            "crosses.append((out_leg != back_leg)[row[chosen]])",
            "crosses.append((out_leg != out_leg)[row[chosen]])",
            "ways over the room go one way round",
        ),
        ('rate = -np.einsum("ni,ni->n", hits.departure, out.velocity[row]) - ', "rate = -", "only the way back has a Doppler shift"),
        ("free[direct] &= _free(", "free[direct] |= _free(", "things are seen through the furniture"),
        ("over.weigh(amplitude, place_of", "over.weigh(amplitude.copy(), place_of", "what legs carry is not applied"),
    ),
    *_in(
        "simulation/legs",
        COUPLING,
        ("at.field).conj() * at.factor", "at.field) * at.factor", "legs have the other sign of time"),
    ),
    *_in(
        "simulation/drives",
        DRIVES,
        ("arrival[n, i]) - shift[f, i]", "arrival[n, i]) + shift[f, i]", "paths are carried the wrong way along the track"),
        ("total -= turned * velocity[f, i]", "total += turned * velocity[f, i]", "approaching on a drive reads as receding"),
    ),
    *_in(
        "simulation/aspects",
        ASPECTS,
        ("* (self.symmetry * count / (2 * np.pi))", "* (count / (2 * np.pi))", "a symmetric target turns too slowly"),
        (
            "(first[f, c, t] + k + 1 - weights.shape[3] // 2) % count",
            "(first[f, c, t] + k - weights.shape[3] // 2) % count",
            "aspects are one behind their angle",
        ),
    ),
    *_in(
        "simulation/poses",
        POSES,
        ("out[:, :3, 3] = -np.einsum(", "out[:, :3, 3] = np.einsum(", "the inverse of a pose moves the wrong way"),
        ("Rotation.from_rotvec(share * turn)", "Rotation.from_rotvec(0 * turn)", "what turns has no Doppler shift"),
    ),
    *_in(
        "simulation/scatterers", BASELINES, ("(4 * np.pi) ** 3) / distance**2", "(4 * np.pi) ** 3) / distance", "points fall off as 1/R^2")
    ),
)

SIGNAL_FAULTS = (
    *_in(
        "simulation/synthesis",
        f"{SYNTHESIS} {RECEIVER}",
        ("motion = 2 * np.pi * reach", "motion = np.pi * reach", "half the Doppler shift"),
        ("np.float32(np.sqrt(received / transmitted / 2))", "np.float32(np.sqrt(received / transmitted))", "noise 3 dB high"),
        (
            "gain = element_gain(radar.element, paths.departure) * element_gain(radar.element, paths.arrival)",
            "gain = element_gain(radar.element, paths.departure)",
            "the antenna's gain on the way out only",
        ),
        ("block += signal * (1 + np.complex64(1j) * phase", "block += signal * (1 + 0 * phase", "no phase noise on echoes"),
    ),
    *_in(
        "simulation/gridding",
        SYNTHESIS,
        ("change = squared - 2 * length * along", "change = squared - length * along", "antenna elements half as far apart"),
        ("size = orders[k] if k == 0 else 2 * orders[k]", "size = orders[k]", "the Jacobi-Anger series lacks its factor of two"),
    ),
    *_in("radar/antenna", f"{RADAR} {RECEIVER}", ("np.log(10) / 20 *", "np.log(10) / 10 *", "the gain counted twice")),
    *_in(
        "radar/if_filter",
        RECEIVER,
        ("high *= beat_hz / (beat_hz - 1j * corner)", "high *= beat_hz / (beat_hz + 1j * corner)", "a high-pass lags"),
        ("- self.pass_share) / (1 - self.pass_share), 0, 1)", "- self.pass_share), 0, 1)", "the stop band begins beyond the band's edge"),
    ),
    *_in(
        "radar/phase_noise",
        f"{RECEIVER} {HARDWARE}",
        (
            "np.exp(-2j * np.pi * np.outer(delays_s, offset))",
            "np.exp(-1j * np.pi * np.outer(delays_s, offset))",
            "half the range correlation",
        ),
        ("self.density(offset) * spacing)", "self.density(offset) * spacing / 2)", "phase noise 3 dB low"),
    ),
    *_in(
        "radar/hardware",
        HARDWARE,
        ("kept = np.float32(10 ** (-self.line_loss_db / 20))", "kept = np.float32(10 ** (-self.line_loss_db / 10))", "lines lose twice"),
        ("(1 - np.conj(error)) / 2", "(1 + np.conj(error)) / 2", "the mixer's image is as strong as the echo"),
        ("path = apart + self.feed_m", "path = apart", "leakage without its feed lines"),
    ),
    *_in(
        "radar/processing",
        f"{POINTS} {RADAR}",
        (
            "turn = np.exp(-2j * np.pi * doppler_hz",
            "turn = np.exp(2j * np.pi * doppler_hz",
            "the transmitters' delay corrected the wrong way",
        ),
        ("np.exp(1j * wavenumber * row @ direction)", "np.exp(-1j * wavenumber * row @ direction)", "left is right"),
        ("profile = 2 * profile[..., : bins // 2]", "profile = profile[..., : bins // 2]", "real samples read 6 dB low"),
        (
            "fold_m = radar.sample_rate_hz * SPEED_OF_LIGHT / (2 *",
            "fold_m = radar.sample_rate_hz * SPEED_OF_LIGHT / (1 *",
            "range twice as far",
        ),
    ),
    *_in(
        "radar/cfar",
        CFAR,
        ("f.isf(false_alarm, 2 * looks, 2 * looks * training)", "f.isf(false_alarm, looks, looks * training)", "looks counted by halves"),
        ("np.maximum(total - inner, 0.0) / cells", "np.maximum(total, 0.0) / cells", "the cell under test counts as noise"),
    ),
)

FEATURE_FAULTS = (
    *_in("features/align", GATE, ("np.roll(second, -lag)", "np.roll(second, lag)", "late is taken for early")),
    *_in(
        "features/gate",
        GATE,
        ("float(1 - np.sum(inside) / np.sum(total))", "float(np.sum(inside) / np.sum(total))", "direct for multipath"),
    ),
    *_in(
        "features/profile",
        PROFILE,
        ("(np.abs(spectrum) ** 2).mean(axis=(1, 2))", "(np.abs(spectrum.mean(axis=(1, 2))) ** 2)", "channels added coherently"),
        ("range_m > target_m) & ~gate", "range_m > target_m) & gate", "what is beyond the target is what is in its gate"),
    ),
    *_in(
        "features/calibration",
        RANK,
        ("wanted / np.where(still, 1.0, spread)", "spread / np.where(still, 1.0, wanted)", "the map is inverted"),
    ),
    *_in("features/rank", RANK, ("axis=0) - 0.5) / rows.sum()", "axis=0) - 1.0) / rows.sum()", "ranks begin at zero")),
    *_in(
        "features/envelope",
        FEATURES,
        ("return inside - gate_energies(floor", "return inside + gate_energies(floor", "noise is added to the target's energy"),
        ("harmonics(envelope, high)[low - 1 :] ** 2", "harmonics(envelope, high)[low - 1 :]", "amplitudes summed for powers"),
        ("envelope.max() / np.sqrt(np.mean(envelope**2))", "envelope.max() / np.mean(envelope**2)", "the crest factor over a power"),
    ),
    *_in("features/doppler", FEATURES, ("limit / np.pi * np.angle", "-limit / np.pi * np.angle", "receding reads as approaching")),
    *_in("features/extent", FEATURES, ("np.maximum(spectrum - noise, 0.0)", "np.maximum(spectrum, 0.0)", "noise widens the target")),
    *_in("features/brightness", FEATURES, ("dtype=np.float64) ** 4", "dtype=np.float64) ** 2", "the range law of one way")),
    *_in("features/window", FEATURES, ("(np.arange(BINS + 1) - BINS / 2)", "np.arange(BINS + 1)", "the window begins at the target")),
    *_in(
        "features/track", FEATURES, ("processed.power - processed.noise_floor, 0.0) * near", "near * 1.0, 0.0)", "the track ignores power")
    ),
    *_in(
        "features/signature",
        FEATURES,
        ("np.fft.fftshift(1 + decibels / FLOOR_DB, axes=0)", "(1 + decibels / FLOOR_DB)", "what stands still lies at the edge of Doppler"),
    ),
    *_in(
        "features/processed",
        FEATURES,
        ("(radar.num_chirps * np.sum(taps**2))", "np.sum(taps**2)", "the noise floor is that of one chirp"),
    ),
)

FAULTS = (*MATERIAL_FAULTS, *TRACER_FAULTS, *SIGNAL_FAULTS, *FEATURE_FAULTS)
