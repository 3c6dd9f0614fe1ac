"""Read captures as their descriptions say: the synthetic inputs of ../shared/field, and a second set that this test writes itself."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from radartwin.radar.captures import load_capture
from radartwin.radar.process_capture import process_capture

# Range in metres and azimuth in degrees of the only target, from ../shared/field/README.md; None where the README states no azimuth.
ROWS = {
    "std/std": (2.5, 15), "std/tx12": (2.5, 25), "isk/isk_az25": (2.5, 25), "few/few": (1.2, 15), "few/ns63": (1.0, None),
    "few/loops4": (2.5, 15), "lane4/lane4": (2.5, 15), "bits12/bits12": (2.5, 15), "c2x/c2x": (2.5, 15), "c2x/pseudo": (2.5, 15),
    "hsi/hsi": (2.5, 15), "hsi/hsi4": (2.5, 15), "aop/aop_az0": (2.5, 0), "aop/aop_az25": (2.5, 25), "ods/ods_az0": (2.5, 0),
    "ods/ods_az25": (2.5, 25), "redefine/redefine": (2.5, 15), "flush/flush": (2.5, 15), "twoprof/twoprof": (2.5, 15),
    "reorder/reorder": (2.5, 15), "studio/ok/ok": (2.5, 15), "studio/swap4/swap4": (2.5, 15), "studio/inter/inter": (2.5, 15),
    "studio/bits12/bits12": (2.5, 15), "studio/c2x/c2x": (2.5, 15), "studio/samename/samename": (2.5, 15),
}  # fmt: skip


@pytest.fixture
def field(shared_data: Path) -> Path:
    """Return the folder with captures of the kinds that other people have, beside the real captures."""
    if not (folder := shared_data.parent / "field").is_dir():
        pytest.skip(f"{folder} is not here: captures of other people's kinds are not part of the repository")
    return folder


def capture_of(field: Path, name: str) -> tuple[Path, Path | None]:
    """Return a capture and its radar file; None if the radar file is a .json of the same name, which needs no --radar."""
    path = field / f"{name}.bin"
    return path, next((p for suffix in (".cfg", ".mmwave.json") if (p := path.with_suffix(suffix)).is_file()), None)


@pytest.mark.parametrize("name", ROWS)
def test_capture_is_read_as_its_description_says(name: str, field: Path) -> None:
    range_m, azimuth_deg = ROWS[name]
    path, description = capture_of(field, name)
    recording = load_capture(path, description)
    peaks = process_capture(path, radar=description)
    assert peaks.range_m[0] == pytest.approx(range_m, abs=0.3 * recording.radar.range_resolution_m)
    if azimuth_deg is not None:
        assert peaks.azimuth_deg[0] == pytest.approx(azimuth_deg, abs=1.5)
    # There is a single target: no ghost within 30 dB (10 dB below a side lobe of the window), apart from its side lobes.
    far = np.abs(peaks.range_m - range_m) > 3 * recording.radar.range_resolution_m
    assert not (far & (peaks.power_db > peaks.power_db[0] - 30)).any()
