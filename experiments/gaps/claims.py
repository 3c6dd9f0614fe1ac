"""Predictions from physics for each gap (known difference between virtual measurement and simulation) when it is the only gap that is on.

A prediction bounds the change of a feature and gives the reason. docs/findings.md says when bounds were written; one bound was tightened
after the first run, as its comment says. A bound may depend on the gap's strength s (default 1) and holds for the group of recordings
that the prediction names. The prediction that a brightness "stays" means that the echo power of the target changes by at most 0.5 dB for a
metal target, or by 1 dB if echoes of other objects fall into the target gate.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from experiments.claims import BELOW, Claim, within

Expected = tuple[str, str, Claim]  # group of cases, feature, claim about its change
LINES_DB = -5.2  # two-way loss of the hardware's lines (radartwin/radar/hardware.py)
# gain of the IF filter for a target at 1 m (beat frequency 467 kHz): two first-order high-pass stages of 175 and 350 kHz
FILTER_DB = -10 * float(np.log10((1 + (175 / 467) ** 2) * (1 + (350 / 467) ** 2)))
RIPPLE_DB = -17.0  # ripples of a transmit and a receive antenna together; each has -20 dB (radartwin/radar/antenna_errors.py)
# thermal noise kTBF (-91.8 dBm at 5.21 MHz) over the transmitted power (12 dBm); Hann window over 256 samples, 16 coherent chirps
THERMAL_DB = -103.8 + 10 * float(np.log10(1.5 / 256 / 16))


def expected(gap: str, strength: float) -> list[Expected]:
    """Return the predicted bounds on feature changes for one gap at a strength."""
    return [(group, feature, replace(claim, least=1)) for group, feature, claim in [*EXPECTED.get(gap, ()), *_scaled(gap, strength)]]


EXPECTED: dict[str, tuple[Expected, ...]] = {
    "geometry": (
        ("turntable", "room change (dB)",
         Claim("a wall position error of a quarter wavelength changes the phase by 180 degrees", bound=-3.0)),
        ("drive", "room change (dB)", Claim("a wall position error of a quarter wavelength changes the phase by 180 degrees", bound=-3.0)),
        ("turntable, metal", "target brightness (dB)", within("the target stays", -1.0, 1.0)),
        ("drive", "target brightness (dB)", within("the target stays", -1.0, 1.0)),
    ),
    "materials": (
        ("turntable", "room change (dB)", Claim("other layer thicknesses change the echoes of the room", bound=-20.0)),
        ("turntable", "track rms (mm)", Claim("no object changes its position", bound=10.0, direction=BELOW)),
        ("turntable", "profile correlation", Claim("peaks stay where they were", bound=0.9)),
        ("turntable, metal", "target brightness (dB)", within("metal stays as it was", -0.5, 0.5)),
    ),
    "roughness": (
        ("turntable", "room level (dB)",
         Claim("random heights around the median have a larger mean square, so the specular echoes of walls become weaker", bound=0.0,
               direction=BELOW)),
        ("turntable", "track rms (mm)", Claim("no object changes its position", bound=10.0, direction=BELOW)),
        # Ament: a roughness of 0.1 mm costs 0.45 dB at normal incidence, and 0.15 dB at each of the reflector's three bounces. A smoother
        # surface gains at most this loss.
        ("turntable, metal", "target brightness (dB)",
         Claim("the echo of metal rises by at most its roughness loss", bound=0.5, direction=BELOW)),
    ),
    "contents": (
        ("turntable, metal", "target change (dB)", Claim("objects without liquid do not change", bound=-80.0, direction=BELOW)),
        ("drive", "target change (dB)", Claim("objects without liquid do not change", bound=-80.0, direction=BELOW)),
        ("turntable, filled bottle", "target change (dB)", Claim("a bottle that is not full has another echo", bound=-40.0)),
        # only the upper tenth of the bottle is empty, and the radar sees the middle
        ("turntable, filled bottle", "target brightness (dB)", within("most of the bottle is still full", -6.0, 3.0)),
        ("turntable", "room level (dB)", within("the room is the same", -0.5, 0.5)),
    ),
    "object_shape": (
        ("turntable, metal", "target brightness (dB)", within("dents and seams move some decibels on some sides", -3.0, 3.0)),
        ("turntable", "target change (dB)", Claim("a tenth of a millimetre turns the phase by 0.3 rad", bound=-15.0)),
        ("turntable", "track rms (mm)", Claim("the target stands where it stood", bound=10.0, direction=BELOW)),
        ("turntable", "room level (dB)", within("the room is the same", -0.5, 0.5)),
    ),
    "object_material": (
        ("turntable, metal", "target change (dB)",
         Claim("the wall thickness of sheet metal does not change the echo", bound=-80.0, direction=BELOW)),
        ("turntable, filled bottle", "target change (dB)", Claim("a thicker wall shifts phase and level", bound=-40.0)),
        ("turntable, filled bottle", "target brightness (dB)", within("a wall of 0.8 mm moves the level little", -3.0, 3.0)),
        ("turntable", "room level (dB)", within("the room is the same", -0.5, 0.5)),
    ),
    "person": (
        ("turntable", "room level (dB)", Claim("a person adds echo power", bound=0.0)),
        ("turntable", "multipath share", Claim("more of the energy is not the target's", bound=0.0)),
        ("turntable, metal", "target brightness (dB)", within("the target stays", -1.0, 1.0)),
        ("drive", "target brightness (dB)", within("the target stays", -1.0, 1.0)),
        ("drive", "room level (dB)", Claim("a person adds echo power", bound=0.0)),  # the bound was -0.5 dB in the first run
    ),
    "clutter": (
        ("turntable", "room level (dB)", Claim("more objects return more power", bound=0.0)),
        ("drive", "room level (dB)", Claim("more objects return more power", bound=0.0)),
        ("turntable", "multipath share", Claim("more of the energy is not the target's", bound=0.0)),
        ("turntable, metal", "target brightness (dB)", within("the target stays", -1.0, 1.0)),
    ),
    "solver": (
        ("turntable", "target brightness (dB)", within("converged to 0.1 to 0.3 dB", -0.3, 0.3)),
        ("turntable", "room level (dB)", within("converged to 0.1 to 0.3 dB", -0.3, 0.3)),
        ("drive", "target brightness (dB)", within("one more bounce, and interpolation from other track positions", -0.3, 0.3)),
        ("drive", "room level (dB)", within("one more bounce, and interpolation from other track positions", -0.3, 0.3)),
    ),
}  # fmt: skip


def _scaled(gap: str, s: float) -> tuple[Expected, ...]:
    """Return the predictions for a gap whose bounds depend on the gap's strength `s`."""
    level = s * LINES_DB + FILTER_DB
    ripple = RIPPLE_DB + 20 * float(np.log10(s)) if s else -np.inf
    more = 10 * float(np.log10(1 + s))  # level of the room with the s-fold energy added
    return {
        "antenna": (
            ("turntable", "target change (dB)",
             within(f"ripples of both antennas, {ripple:.0f} dB, of one draw", ripple - 8, ripple + 6)),
            ("drive", "target change (dB)",
             within(f"ripples of both antennas, {ripple:.0f} dB, of one draw", ripple - 8, ripple + 6)),
            ("turntable, metal", "target brightness (dB)",
             within("the mean over eight channels changes by about 0.5 dB", -1.5 * s, 1.5 * s)),
            ("drive", "target brightness (dB)", within("means over eight channels and many angles", -1.5 * s, 1.5 * s)),
            ("turntable", "room change (dB)", within("ripples, and echoes of floor and back lobe", ripple - 8, ripple + 10)),
            ("drive", "room change (dB)", within("ripples, and echoes of floor and back lobe", ripple - 8, ripple + 10)),
            ("turntable", "room level (dB)", within("two-way back lobe and floor are weak", -1.0 * s, 1.0 + s)),
            ("drive", "room level (dB)", within("two-way back lobe and floor are weak", -1.0 * s, 1.0 + s)),
            ("turntable, metal", "track rms (mm)", Claim("the target stands where it stood", bound=10.0, direction=BELOW)),
            ("turntable", "profile correlation", Claim("strong peaks stay", bound=0.9)),
        ),
        "hardware": (
            ("turntable, metal", "target brightness (dB)",
             within(f"lines and filter take {-level:.1f} dB", level - 1, level + 1)),
            ("turntable", "noise floor (dB)",
             within(f"thermal noise, {THERMAL_DB:.1f} dB, or more", THERMAL_DB - 1, THERMAL_DB + 6)),
            ("turntable", "level at zero range, risen by (dB)", Claim("leakage between the antennas appears", bound=20.0)),
            ("turntable, metal", "track rms (mm)", Claim("bright targets stay in their bin", bound=10.0, direction=BELOW)),
            ("turntable", "profile correlation", Claim("peaks stay where they were", bound=0.9)),
        ),
        "trajectory": (
            ("drive", "track rms (mm)", within("the start is off by a centimetre, and wheels slip", 1.0, 100.0 * s)),
            ("drive", "target change (dB)", Claim("phases turn by more than a radian", bound=-3.0)),
            ("drive", "target brightness (dB)", within("levels stay", -1.0, 1.0)),
            ("drive", "room level (dB)", within("levels stay", -1.0, 1.0)),
            ("turntable", "target change (dB)", Claim("phases turn by more than a radian", bound=-3.0)),
            ("turntable", "room level (dB)", within("the room is the same", -0.5, 0.5)),
        ),
        "unscanned_echoes": (
            ("turntable", "room level (dB)",
             within(f"energies of independent echoes add, {more:.1f} dB", more - 2, more + 2)),
            ("turntable", "multipath share", Claim("more of the energy is not the target's", bound=0.0)),
            ("turntable, metal", "target brightness (dB)", within("the target stays", -1.0, 1.0)),
            ("drive", "room level (dB)", Claim("more echoes return more power", bound=0.0)),
        ),
        "placement": (
            ("turntable", "track rms (mm)", within("the target stands millimetres off", 0.3, 20.0 * s)),
            ("drive", "track rms (mm)", within("the target stands millimetres off", 0.3, 20.0 * s)),
            ("turntable, metal", "target brightness (dB)", within("the target stays", -1.0, 1.0)),
            ("turntable", "room level (dB)", within("the room is the same", -0.5, 0.5)),
        ),
    }.get(gap, ())  # fmt: skip
