"""The faults that `make mutants` plants in the physics, each with the quick tests that must catch it.

A change is (function, expression, faulty replacement, meaning). The file is one table and therefore exceeds 300 lines.
"""

from __future__ import annotations

from fault import Change, Fault


def _in(module: str, tests: str, *changes: tuple[str, str, str, str]) -> list[Fault]:
    return [Fault(f"radartwin/{module}.py", tests, Change(*change)) for change in changes]


MATERIALS, MINC = "tests/physics/test_materials.py", "tests/materials/test_minc.py"
RCS, TUBES, SHELLS = "tests/physics/test_rcs.py", "tests/physics/test_tubes.py", "tests/physics/test_shells.py"
SYNTHESIS, DIFFUSE, IMAGES = "tests/physics/test_synthesis.py", "tests/physics/test_diffuse.py", "tests/physics/test_images.py"
COUPLING, DRIVES, ASPECTS = "tests/physics/test_coupling.py", "tests/physics/test_drives.py", "tests/physics/test_aspects.py"
RECEIVER, HARDWARE, BASELINES = "tests/physics/test_receiver.py", "tests/physics/test_hardware.py", "tests/physics/test_baselines.py"
POSES, POINTS, COVERAGE = "tests/simulation/test_poses.py", "tests/physics/test_point_targets.py", "tests/physics/test_coverage.py"
RADAR, CFAR, FEATURES = "tests/radar/test_radar.py", "tests/radar/test_cfar.py", "tests/features/test_features.py"
ALIGN, PROFILE, NORMALISE = "tests/features/test_align.py", "tests/features/test_profile.py", "tests/features/test_normalise.py"
PROCESSED = "tests/features/test_processed.py"

MATERIAL_FAULTS = (
    *_in(
        "materials/layers",
        MATERIALS,
        ("_stack", "kz[outer] - kz[inner]", "kz[inner] - kz[outer]", "TE reflection has the wrong sign"),
        (
            "_stack",
            "media[inner] * kz[outer] - media[outer] * kz[inner]",
            "media[inner] * kz[inner] - media[outer] * kz[outer]",
            "TM reflection swaps the wave numbers",
        ),
        ("_stack", "-1j * k0", "1j * k0", "a lossy layer amplifies"),
        ("_stack", "r_te + te * once**2", "r_te + te * once", "the wave crosses a layer once, not twice"),
        ("_stack", "t_te * once * through_te", "t_te * through_te", "a layer transmits without phase and loss"),
        ("_stack", "np.asarray(cos_incidence, float) ** 2", "np.asarray(cos_incidence, float)", "the sine of the incidence is wrong"),
    ),
    *_in(
        "materials/itu",
        MATERIALS,
        ("permittivity", "1j * conductivity", "2j * conductivity", "the conductivity is doubled"),
        ("permittivity", "1j * conductivity", "-1j * conductivity", "a material amplifies"),
    ),
    *_in(
        "materials/roughness",
        MATERIALS,
        ("ament", "-2", "-1", "Ament's factor applies to the power"),
        ("ament_transmitted", "-0.5", "-2", "roughness reduces transmission as much as reflection"),
    ),
    *_in(
        "materials/liquids",
        MATERIALS,
        (
            "water",
            "static - f * ((static - first) / (f - 1j * gamma_1) + (first - second) / (f - 1j * gamma_2))",
            "static - ((static - first) / (f - 1j * gamma_1) + (first - second) / (f - 1j * gamma_2))",
            "water does not relax",
        ),
        ("looyenga", "np.asarray(eps) ** (1 / 3)", "np.asarray(eps) ** (1 / 2)", "Looyenga's mixing law has the wrong power"),
    ),
    *_in(
        "materials/distance",
        MINC,
        ("_level", "10 * np.log10(np.maximum(power, 1e-30))", "20 * np.log10(np.maximum(power, 1e-30))", "decibels are doubled"),
    ),
)

TRACER_FAULTS = (
    *_in(
        "simulation/rcs",
        RCS,
        ("rcs", "2 * wavenumber * total", "wavenumber * total", "the far-field cross-section is 6 dB low"),
        ("rcs", "stand_off**4", "stand_off**3", "the near field falls with the wrong power of distance"),
        ("rcs", "hits.length_in_m + hits.length_out_m", "hits.length_in_m - hits.length_out_m", "the return length is subtracted"),
    ),
    *_in(
        "simulation/curved/tracer",
        f"{RCS} {TUBES}",
        (
            "Tracer.__init__",
            "2 * np.pi * float(table.frequencies_hz.mean())",
            "np.pi * float(table.frequencies_hz.mean())",
            "half the wavenumber",
        ),
    ),
    *_in(
        "simulation/curved/scatter",
        f"{RCS} {TUBES}",
        ("_footprint", "8 * np.pi * contact.cosine", "4 * np.pi * contact.cosine", "a footprint radiates 6 dB too much"),
        ("scatter", "electric + magnetic", "electric - magnetic", "magnetic currents have the wrong sign"),
        ("_footprint", "0.5 * wavenumber", "0.25 * wavenumber", "the second-order phase of a footprint is halved"),
    ),
    *_in(
        "simulation/curved/contact",
        f"{RCS} {TUBES}",
        ("bounce", "2 * contact.cosine", "contact.cosine", "a curved mirror has half its power"),
        (
            "pass_caustics",
            "dr.select(one, -im, re * sign), dr.select(one, re, im * sign)",
            "dr.select(one, im, re * sign), dr.select(one, -re, im * sign)",
            "a caustic delays the phase",
        ),
    ),
    *_in(
        "simulation/curved/footprint",
        f"{RCS} {TUBES}",
        ("footprint_moments", "moment[1] -= part * sine", "moment[1] += part * sine", "the second-order phase has the wrong sign"),
    ),
    *_in(
        "simulation/curved/coverage",
        COVERAGE,
        ("covered", "(u / depth, v / depth)", "(u, v)", "corners are not projected onto the grid"),
        ("_mark", "int(np.ceil(u[n].max())) + MARGIN + 1", "int(np.ceil(u[n].max())) - MARGIN", "cells end before their facet"),
    ),
    *_in(
        "simulation/curved/shell",
        SHELLS,
        ("find_shells", "1j * wavenumber", "-1j * wavenumber", "a wall's thickness shifts the phase the wrong way"),
        ("find_shells", "material.layers[::-1]", "()", "a wall has no layers from inside"),
    ),
    *_in(
        "simulation/curved/transit",
        SHELLS,
        (
            "Walls._passed",
            "te_re * s_im + te_im * s_re",
            "te_re * s_im - te_im * s_re",
            "a wall advances the phase instead of delaying it",
        ),
    ),
    *_in(
        "simulation/diffuse",
        DIFFUSE,
        ("scattered_power", "16 * np.pi**3", "64 * np.pi**3", "scattered power is 6 dB low"),
        ("_block", "np.sqrt(power[kept])", "power[kept]", "power is used as amplitude"),
        (
            "_block",
            "-2 * np.einsum('ni,ni->n', direction, velocity[pose])",
            "-1 * np.einsum('ni,ni->n', direction, velocity[pose])",
            "half the Doppler shift of diffuse echoes",
        ),
        ("scattered_share", "1 - coherent**2", "1 - coherent", "roughness removes more power than it scatters"),
        ("cloud", "upto[-1] / count / 2", "upto[-1] / count", "each scatterer represents twice its area"),
        ("_visible", "~geometry.scene().ray_test(ray).numpy()", "np.ones(len(distance), bool)", "walls do not hide scatterers"),
    ),
    *_in(
        "simulation/flat/images",
        IMAGES,
        ("prepare", "2 * panels.offset[p] * panels.normal[p]", "panels.offset[p] * panels.normal[p]", "an image has half its distance"),
        (
            "_sides",
            "all(h.max() > aperture.BEHIND for h in height)",
            "any(h.max() > aperture.BEHIND for h in height)",
            "panels reflect from behind",
        ),
    ),
    *_in(
        "simulation/flat/aperture",
        IMAGES,
        ("_tail", "complex(-im, re)", "complex(im, -re)", "the edge wave has the wrong sign"),
        ("subtract", "total = before", "total = max(total, before)", "pieces that the shadow misses are cut"),
    ),
    *_in(
        "simulation/flat/coupling",
        COUPLING,
        ("group_paths", "out_leg != back_leg", "out_leg != out_leg", "paths over the room run in one direction only"),
        (
            "group_paths",
            "-np.einsum('ni,ni->n', hits.departure, out.velocity[row]) - np.einsum('ni,ni->n', hits.arrival, back.velocity[row])",
            "-np.einsum('ni,ni->n', hits.arrival, back.velocity[row])",
            "only the return has a Doppler shift",
        ),
        (
            "group_paths",
            "free[direct] &= _free(occluder, sensor_poses[frame[direct], :3, 3], point[direct])",
            "free[direct] |= _free(occluder, sensor_poses[frame[direct], :3, 3], point[direct])",
            "furniture does not hide objects",
        ),
        (
            "group_paths",
            "over.weigh(amplitude, place_of[frame[chosen]], leg[row[chosen]], point[chosen])",
            "over.weigh(amplitude.copy(), place_of[frame[chosen]], leg[row[chosen]], point[chosen])",
            "the amplitudes of the legs are not applied",
        ),
    ),
    *_in(
        "simulation/flat/legs",
        COUPLING,
        (
            "_View.carried",
            "np.einsum('nk,nqk->nq', unit, at.field).conj()",
            "np.einsum('nk,nqk->nq', unit, at.field)",
            "the field of a leg is not conjugated",
        ),
    ),
    *_in(
        "simulation/drives",
        DRIVES,
        (
            "_carry",
            "length * (departure[n, i] if end == 0 else arrival[n, i]) - shift[f, i]",
            "length * (departure[n, i] if end == 0 else arrival[n, i]) + shift[f, i]",
            "paths move the wrong way along the track",
        ),
        ("_carry", "total -= turned * velocity[f, i]", "total += turned * velocity[f, i]", "approaching reads as receding"),
    ),
    *_in(
        "simulation/aspects",
        ASPECTS,
        ("Aspects.at", "self.symmetry * count", "count", "a symmetric target turns too slowly"),
        ("_combine", "first[f, c, t] + k + 1", "first[f, c, t] + k", "aspects are one step behind their angle"),
    ),
    *_in(
        "simulation/poses",
        POSES,
        (
            "inverse",
            "-np.einsum('fij,fj->fi', rotation, poses[:, :3, 3])",
            "np.einsum('fij,fj->fi', rotation, poses[:, :3, 3])",
            "the inverse of a pose moves the wrong way",
        ),
        ("_advanced", "share * turn", "0 * turn", "rotation causes no Doppler shift"),
    ),
    *_in("simulation/backends/scatterers", BASELINES, ("PointBackend._object", "distance**2", "distance", "points fall off as 1/R^2")),
)

SIGNAL_FAULTS = (
    *_in(
        "simulation/signal/synthesis",
        f"{SYNTHESIS} {RECEIVER}",
        ("_motion_terms", "2 * np.pi * reach", "np.pi * reach", "the Doppler shift is halved"),
        ("thermal_noise", "received / transmitted / 2", "received / transmitted", "noise is 3 dB high"),
        (
            "synthesize",
            "element_gain(radar.element, paths.departure) * element_gain(radar.element, paths.arrival)",
            "element_gain(radar.element, paths.departure)",
            "the antenna gain applies at transmission only",
        ),
        ("received", "np.complex64(1j) * phase.reshape(shape)", "0 * phase.reshape(shape)", "echoes have no phase noise"),
    ),
    *_in(
        "simulation/signal/gridding",
        SYNTHESIS,
        ("_element_distance", "2 * length * along", "length * along", "antenna elements are half as far apart"),
        ("_motion", "orders[k] if k == 0 else 2 * orders[k]", "orders[k]", "the Jacobi-Anger series lacks its factor of two"),
    ),
    *_in("radar/antenna", f"{RADAR} {RECEIVER}", ("element_gain", "np.log(10) / 20", "np.log(10) / 10", "the gain is doubled")),
    *_in(
        "radar/if_filter",
        RECEIVER,
        ("IfFilter.gain", "beat_hz - 1j * corner", "beat_hz + 1j * corner", "the high-pass filter delays the phase"),
        (
            "IfFilter.gain",
            "(np.abs(beat_hz) / band_hz - self.pass_share) / (1 - self.pass_share)",
            "np.abs(beat_hz) / band_hz - self.pass_share",
            "the stop band begins beyond the edge of the band",
        ),
    ),
    *_in(
        "radar/phase_noise",
        f"{RECEIVER} {HARDWARE}",
        ("_lines", "-2j * np.pi", "-1j * np.pi", "the range correlation is halved"),
        ("PhaseNoise.processes", "self.density(offset) * spacing", "self.density(offset) * spacing / 2", "phase noise is 3 dB low"),
    ),
    *_in(
        "radar/hardware",
        HARDWARE,
        ("Hardware.leaked", "-self.line_loss_db / 20", "-self.line_loss_db / 10", "line loss is doubled"),
        ("Hardware.digitised", "1 - np.conj(error)", "1 + np.conj(error)", "the mixer's image is as strong as the echo"),
        ("Hardware.leakage", "apart + self.feed_m", "apart", "leakage does not pass the feed lines"),
    ),
    *_in(
        "radar/processing",
        f"{POINTS} {RADAR}",
        ("doppler_fft", "-2j * np.pi", "2j * np.pi", "the delay between transmitters is corrected the wrong way"),
        ("steering", "1j * wavenumber", "-1j * wavenumber", "left and right are swapped"),
        ("range_fft", "2 * profile[..., : bins // 2]", "profile[..., : bins // 2]", "real samples read 6 dB low"),
        ("range_axis", "2 * radar.slope_hz_per_s", "1 * radar.slope_hz_per_s", "ranges are doubled"),
    ),
    *_in(
        "radar/cfar",
        CFAR,
        (
            "ca_factor",
            "f.isf(false_alarm, 2 * looks, 2 * looks * training)",
            "f.isf(false_alarm, looks, looks * training)",
            "the number of looks is halved",
        ),
        ("ca_cfar", "total - inner", "total", "the cell under test counts as noise"),
    ),
)

FEATURE_FAULTS = (
    *_in("features/align", ALIGN, ("overlap", "max(0, -frames)", "max(0, frames)", "the offset has the wrong sign")),
    *_in(
        "features/profile",
        PROFILE,
        ("multipath_share", "1 - np.sum(inside) / np.sum(total)", "np.sum(inside) / np.sum(total)", "the direct share is reported"),
        ("beyond_target_share", "~gate(range_m, target_m)", "gate(range_m, target_m)", "the gate counts as beyond the target"),
    ),
    *_in(
        "features/normalise",
        NORMALISE,
        (
            "fit_map",
            "measured_spread / np.where(constant, 1.0, spread)",
            "spread / np.where(constant, 1.0, measured_spread)",
            "inverted map",
        ),
        ("rank_normalise", "rankdata(matrix[rows], axis=0) - 0.5", "rankdata(matrix[rows], axis=0) - 1.0", "ranks begin at zero"),
    ),
    *_in(
        "features/envelope",
        FEATURES,
        (
            "target_energy",
            "inside - gate_energies(floor, processed.range_m, target_m)[0]",
            "inside + gate_energies(floor, processed.range_m, target_m)[0]",
            "noise is added to the target's energy",
        ),
        ("harmonic_ratio", "harmonics(envelope, high)[low - 1 :] ** 2", "harmonics(envelope, high)[low - 1 :]", "amplitudes are summed"),
        ("crest_factor", "np.sqrt(np.mean(envelope**2))", "np.mean(envelope**2)", "the crest factor divides by a power"),
        (
            "without_range_law",
            "np.asarray(distance_m, dtype=np.float64) ** 4",
            "np.asarray(distance_m, dtype=np.float64) ** 2",
            "the range law covers one direction only",
        ),
    ),
    *_in("features/doppler", FEATURES, ("radial_velocity", "limit / np.pi", "-limit / np.pi", "receding reads as approaching")),
    *_in("features/extent", FEATURES, ("gate_spectrum", "spectrum - noise", "spectrum", "noise widens the target")),
    *_in(
        "features/window",
        FEATURES,
        ("energies", "np.arange(BINS + 1) - BINS / 2", "np.arange(BINS + 1)", "the window starts at the target"),
    ),
    *_in(
        "features/track",
        FEATURES,
        ("_weighted", "np.maximum(processed.power - processed.noise_floor, 0.0) * near", "near * 1.0", "the track ignores power"),
    ),
    *_in(
        "features/signature",
        FEATURES,
        (
            "signature",
            "np.fft.fftshift(1 + decibels / FLOOR_DB, axes=0)",
            "1 + decibels / FLOOR_DB",
            "zero Doppler lies at the edge of the signature",
        ),
    ),
    *_in(
        "features/processed",
        FEATURES,
        ("process", "radar.num_chirps * np.sum(taps**2)", "np.sum(taps**2)", "the noise floor is that of a single chirp"),
    ),
    *_in(
        "features/processed",
        PROCESSED,
        (
            "process",
            "(np.abs(coherent) ** 2).mean(axis=1, dtype=np.float64)",
            "np.abs(coherent.mean(axis=1)) ** 2",
            "channels are summed coherently",
        ),
    ),
)

FAULTS = (*MATERIAL_FAULTS, *TRACER_FAULTS, *SIGNAL_FAULTS, *FEATURE_FAULTS)
