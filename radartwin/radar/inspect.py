"""What `radartwin process` does: a recording to peaks.csv and three pictures, and the peak table to print."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import TYPE_CHECKING

from radartwin.errors import OutputError
from radartwin.io import files
from radartwin.radar.captures import capture_name, load_capture
from radartwin.radar.chirp import Radar
from radartwin.radar.detection import Detector, detect
from radartwin.radar.maps import Chain, survey
from radartwin.radar.pictures import PICTURES, draw, write

if TYPE_CHECKING:
    import pandas as pd

PEAKS_FILE = "peaks.csv"


def inspect(
    path: str | Path,
    out: str | Path | None = None,
    radar: Radar | str | Path | None = None,
    *,
    iq_swapped: bool | None = None,
    chain: Chain | None = None,
    detector: Detector | None = None,
) -> pd.DataFrame:
    """Process a recording and write what it shows.

    Args:
        path: a recording of this package (stem, .bin or .json), a mmWave Studio .bin, or a .npy cube.
        out: folder for peaks.csv, range_time.png, range_doppler.png and range_azimuth.png; None writes nothing. A
            single channel has no azimuth, hence no range_azimuth.png.
        radar: a Radar or the path of its file; only a .npy needs it.
        iq_swapped: Q before I in a foreign capture; None reads it off the data.
        chain: window, padding, and whether what does not move is removed.
        detector: how peaks are told from noise.
    Returns:
        range_m, doppler_mps, azimuth_deg, power_db of every peak, strongest first. The power is relative to the
        transmitted power, or to one squared ADC count in a capture from elsewhere.
    Raises:
        UserError: as load_capture, and OutputError where `out` cannot be written; then nothing new is left in it.
    """
    recording = load_capture(path, _radar(radar), iq_swapped=iq_swapped)
    chain = chain or Chain()
    maps = survey(recording.iq, recording.radar, chain)
    peaks = detect(recording.iq, recording.radar, detector, chain, maps=maps)
    table = peaks.table()
    if out is None:
        return table
    in_counts = recording.provenance.get("unit") == "counts"
    unit = "dB of one squared ADC count" if in_counts else "dB of transmitted power"
    multichannel = recording.radar.num_tx * recording.radar.num_rx > 1
    names = [name for name in PICTURES if multichannel or name != "range_azimuth"]
    folder, written = files.make_folder(Path(out)), []
    try:
        for name in names:
            written.append(files.unfinished(folder / f"{name}.png"))
            write(
                draw(maps, name, peaks=peaks, unit=unit, title=f"{capture_name(path)}: {name.replace('_', '-')}"),
                written[-1],
            )
        written.append(files.unfinished(folder / PEAKS_FILE))
        table.to_csv(written[-1], index=False, float_format="%.6g", lineterminator="\n")
        for temporary, name in zip(written, [*(f"{n}.png" for n in names), PEAKS_FILE], strict=True):
            temporary.replace(folder / name)
    except OSError as error:
        raise OutputError(f"cannot write {folder}: {error.strerror or error}; choose another output folder") from error
    finally:
        for temporary in written:
            with contextlib.suppress(OSError):
                temporary.unlink(missing_ok=True)
    return table


def _radar(radar: Radar | str | Path | None) -> Radar | None:
    if radar is None or isinstance(radar, Radar):
        return radar
    return Radar.from_file(radar)
