"""Predictions from physics for each gap (known difference between virtual measurement and simulation) when it is the only gap that is on.

A prediction bounds the change of a feature for a group of recordings, at the gap's strength s, and gives the reason. docs/findings.md says
when bounds were written; one was tightened after the first run, as its comment says. A brightness that "stays" changes by at most 0.5 dB
for a metal target, or by 1 dB if echoes of other objects fall into the target gate.
"""

from dataclasses import replace

import numpy as np

from experiments.verdicts import BELOW, Claim, within

Expected = tuple[str, str, Claim]  # group of cases, feature, claim about its change
LINES_DB = -5.2  # two-way loss of the hardware's lines (radartwin/radar/hardware.py)
# gain of the IF filter for a target at 1 m (beat frequency 467 kHz): two first-order high-pass stages of 175 and 350 kHz
FILTER_DB = -10 * float(np.log10((1 + (175 / 467) ** 2) * (1 + (350 / 467) ** 2)))
RIPPLE_DB = -17.0  # ripples of a transmit and a receive antenna together; each has -20 dB (radartwin/radar/antenna_errors.py)
# thermal noise kTBF (-91.8 dBm at 5.21 MHz) over the transmitted power (12 dBm); Hann window over 256 samples, 16 coherent chirps
THERMAL_DB = -103.8 + 10 * float(np.log10(1.5 / 256 / 16))
BOTH, FIRM = ("turntable", "drive"), ("turntable, metal", "drive")
TARGET, ROOM, CHANGED, ROOM_CHANGED = "target brightness (dB)", "room level (dB)", "target change (dB)", "room change (dB)"
TRACK, PROFILE = "track rms (mm)", "profile correlation"
STAYS, SAME_ROOM = within("the target stays", -1.0, 1.0), within("the room is the same", -0.5, 0.5)
STOOD = Claim("the target stands where it stood", bound=10.0, direction=BELOW)
STILL = Claim("no object changes its position", bound=10.0, direction=BELOW)
PEAKS = Claim("peaks stay where they were", bound=0.9)
MORE_SHARE = Claim("more of the energy is not the target's", bound=0.0)


def expected(gap: str, strength: float) -> list[Expected]:
    """Return the predicted bounds on feature changes for one gap at a strength."""
    return [
        (group, feature, replace(claim, least=1))
        for groups, feature, claim in predictions(strength).get(gap, ())
        for group in ((groups,) if isinstance(groups, str) else groups)
    ]


def predictions(s: float) -> dict[str, tuple[tuple[str | tuple[str, ...], str, Claim], ...]]:
    """Return the predictions (groups of cases, feature, claim) of each gap at the strength `s`."""
    level = s * LINES_DB + FILTER_DB
    ripple = RIPPLE_DB + 20 * float(np.log10(s)) if s else -np.inf
    more = 10 * float(np.log10(1 + s))  # level of the room with the s-fold energy added
    return {
        "geometry": (
            (BOTH, ROOM_CHANGED, Claim("a wall position error of a quarter wavelength changes the phase by 180 degrees", bound=-3.0)),
            (FIRM, TARGET, STAYS),
        ),
        "materials": (
            ("turntable", ROOM_CHANGED, Claim("other layer thicknesses change the echoes of the room", bound=-20.0)),
            ("turntable", TRACK, STILL),
            ("turntable", PROFILE, PEAKS),
            ("turntable, metal", TARGET, within("metal stays as it was", -0.5, 0.5)),
        ),
        "roughness": (
            ("turntable", ROOM,
             Claim("random heights around the median have a larger mean square, so the specular echoes of walls become weaker", bound=0.0,
                   direction=BELOW)),
            ("turntable", TRACK, STILL),
            # Ament: a roughness of 0.1 mm costs 0.45 dB at normal incidence, and 0.15 dB at each of the reflector's three bounces. A
            # smoother surface gains at most this loss.
            ("turntable, metal", TARGET, Claim("the echo of metal rises by at most its roughness loss", bound=0.5, direction=BELOW)),
        ),
        "contents": (
            (FIRM, CHANGED, Claim("objects without liquid do not change", bound=-80.0, direction=BELOW)),
            ("turntable, filled bottle", CHANGED, Claim("a bottle that is not full has another echo", bound=-40.0)),
            # only the upper tenth of the bottle is empty, and the radar sees the middle
            ("turntable, filled bottle", TARGET, within("most of the bottle is still full", -6.0, 3.0)),
            ("turntable", ROOM, SAME_ROOM),
        ),
        "object_shape": (
            ("turntable, metal", TARGET, within("dents and seams move some decibels on some sides", -3.0, 3.0)),
            ("turntable", CHANGED, Claim("a tenth of a millimetre turns the phase by 0.3 rad", bound=-15.0)),
            ("turntable", TRACK, STOOD),
            ("turntable", ROOM, SAME_ROOM),
        ),
        "object_material": (
            ("turntable, metal", CHANGED,
             Claim("the wall thickness of sheet metal does not change the echo", bound=-80.0, direction=BELOW)),
            ("turntable, filled bottle", CHANGED, Claim("a thicker wall shifts phase and level", bound=-40.0)),
            ("turntable, filled bottle", TARGET, within("a wall of 0.8 mm moves the level little", -3.0, 3.0)),
            ("turntable", ROOM, SAME_ROOM),
        ),
        "person": (
            (BOTH, ROOM, Claim("a person adds echo power", bound=0.0)),  # the bound of drives was -0.5 dB in the first run
            ("turntable", "multipath share", MORE_SHARE),
            (FIRM, TARGET, STAYS),
        ),
        "clutter": (
            (BOTH, ROOM, Claim("more objects return more power", bound=0.0)),
            ("turntable", "multipath share", MORE_SHARE),
            ("turntable, metal", TARGET, STAYS),
        ),
        "solver": tuple(
            (group, feature, within(text, -0.3, 0.3))
            for group, text in zip(
                BOTH, ("converged to 0.1 to 0.3 dB", "one more bounce, and interpolation from other track positions"), strict=True
            )
            for feature in (TARGET, ROOM)
        ),
        "antenna": (
            (BOTH, CHANGED, within(f"ripples of both antennas, {ripple:.0f} dB, of one draw", ripple - 8, ripple + 6)),
            ("turntable, metal", TARGET, within("the mean over eight channels changes by about 0.5 dB", -1.5 * s, 1.5 * s)),
            ("drive", TARGET, within("means over eight channels and many angles", -1.5 * s, 1.5 * s)),
            (BOTH, ROOM_CHANGED, within("ripples, and echoes of floor and back lobe", ripple - 8, ripple + 10)),
            (BOTH, ROOM, within("two-way back lobe and floor are weak", -1.0 * s, 1.0 + s)),
            ("turntable, metal", TRACK, STOOD),
            ("turntable", PROFILE, Claim("strong peaks stay", bound=0.9)),
        ),
        "hardware": (
            ("turntable, metal", TARGET, within(f"lines and filter take {-level:.1f} dB", level - 1, level + 1)),
            ("turntable", "noise floor (dB)",
             within(f"thermal noise, {THERMAL_DB:.1f} dB, or more", THERMAL_DB - 1, THERMAL_DB + 6)),
            ("turntable", "level at zero range, risen by (dB)", Claim("leakage between the antennas appears", bound=20.0)),
            ("turntable, metal", TRACK, Claim("bright targets stay in their bin", bound=10.0, direction=BELOW)),
            ("turntable", PROFILE, PEAKS),
        ),
        "trajectory": (
            ("drive", TRACK, within("the start is off by a centimetre, and wheels slip", 1.0, 100.0 * s)),
            (BOTH, CHANGED, Claim("phases turn by more than a radian", bound=-3.0)),
            *(("drive", feature, within("levels stay", -1.0, 1.0)) for feature in (TARGET, ROOM)),
            ("turntable", ROOM, SAME_ROOM),
        ),
        "unscanned_echoes": (
            ("turntable", ROOM, within(f"energies of independent echoes add, {more:.1f} dB", more - 2, more + 2)),
            ("turntable", "multipath share", MORE_SHARE),
            ("turntable, metal", TARGET, STAYS),
            ("drive", ROOM, Claim("more echoes return more power", bound=0.0)),
        ),
        "placement": (
            (BOTH, TRACK, within("the target stands millimetres off", 0.3, 20.0 * s)),
            ("turntable, metal", TARGET, STAYS),
            ("turntable", ROOM, SAME_ROOM),
        ),
    }  # fmt: skip
