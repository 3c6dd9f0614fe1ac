"""Read timelines back with MCAP's own reader and the schemas in the file, and compare their values with the processing of the recording."""

import base64
import functools
import json
import shutil
import sys
import tracemalloc
from typing import Any

import jsonschema
import numpy as np
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, json_format, message_factory
from made_files import refused
from mcap.reader import make_reader

import radartwin as rt
from radartwin.errors import BackendError, InputError, OutputError
from radartwin.radar.detection import point_clouds
from radartwin.radar.power_maps import power_maps
from radartwin.recordings.camera_pictures import read_pictures
from radartwin.recordings.timeline import frame_time_ns, write_timeline

C = 299_792_458.0
RADAR = rt.Radar.iwr1843("isotropic")
START_NS = 1_709_294_400_250_000_001  # odd in the last digit, which a float of seconds or nanoseconds would lose
JPEG, PNG = b"\xff\xd8\xff\xe0 a picture", b"\x89PNG\r\n\x1a\n a picture"


@functools.cache
def samples(frames, radar):
    rng = np.random.default_rng(0)
    frame, chirp, tx, rx, _ = np.ogrid[:frames, : radar.num_chirps, : radar.num_tx, : radar.num_rx, :1]
    time = frame / radar.frame_rate_hz + (chirp * radar.num_tx + tx) * radar.chirp_interval
    y = (radar.tx_positions[:, 1][:, None] + radar.rx_positions[:, 1])[tx, rx]
    frequency = radar.start_frequency_hz + radar.slope_hz_per_s * np.arange(radar.num_samples) / radar.sample_rate_hz
    iq = 1e-9 * (rng.standard_normal((*time.shape[:3], radar.num_rx, radar.num_samples)) + 0j)
    for range_m, speed, azimuth_deg in ((2.0, 0.0, 20.0), (4.0, 0.5, -30.0)):
        length = 2 * (range_m + speed * time) - y * np.sin(np.radians(azimuth_deg))
        iq = iq + 1e-6 * np.exp(2j * np.pi * frequency * length / C)
    return iq.astype(np.complex64)


def recording(frames=3, radar=RADAR, **fields):
    """Return echoes at 2 m on the left and at 4 m on the right, the second of which recedes at 0.5 m/s, with noise 60 dB below them."""
    return rt.Recording(samples(frames, radar).copy(), radar, **fields)


def decoded(schema, data: bytes) -> dict[str, Any]:
    """Return the content of a message by the schema in its file alone. Bytes are base64 text, and times in Protobuf are ISO 8601 text."""
    if schema.encoding == "jsonschema":
        content = json.loads(data)
        jsonschema.validate(content, json.loads(schema.data))
        return content
    pool = descriptor_pool.DescriptorPool()
    for file in descriptor_pb2.FileDescriptorSet.FromString(schema.data).file:
        pool.Add(file)
    message = message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name)).FromString(data)
    return json_format.MessageToDict(message, preserving_proto_field_name=True, always_print_fields_with_no_presence=True)


def messages(path):
    """Return the messages by topic, as pairs (log time, content), in the order of time."""
    out = {}
    with path.open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages(log_time_order=True):
            assert schema is not None
            expected = ("jsonschema", "json") if schema.name == "radartwin.RangeProfile" else ("protobuf", "protobuf")
            assert (schema.encoding, channel.message_encoding) == expected
            assert message.publish_time == message.log_time
            out.setdefault(channel.topic, []).append((message.log_time, decoded(schema, message.data)))
    return out


def written(folder, kept, **options):
    counts = write_timeline(kept, folder / "a.mcap", **options)
    content = messages(folder / "a.mcap")
    assert counts == {topic: len(entries) for topic, entries in content.items()}
    return content


@pytest.fixture(scope="module")
def timeline(tmp_path_factory):
    """Return the messages of `recording()` by topic."""
    return written(tmp_path_factory.mktemp("timeline"), recording(), start_ns=START_NS)


def pixels(image):
    values = np.frombuffer(base64.b64decode(image["data"]), "<u2")
    assert image["step"] == 2 * image["width"]
    return values.reshape(image["height"], image["width"])


def test_maps_hold_the_levels_of_the_processing(timeline):
    assert set(timeline) == {"/radar/range_profile", "/radar/range_doppler", "/radar/range_azimuth", "/radar/points"}
    for frame in range(3):
        maps = power_maps(recording().iq[frame : frame + 1], RADAR)
        profile = timeline["/radar/range_profile"][frame][1]
        axis = profile["range_start_m"] + profile["range_step_m"] * np.arange(len(profile["power_db"]))
        np.testing.assert_allclose(axis, maps.range_m, atol=1e-9)
        np.testing.assert_allclose(profile["power_db"], 10 * np.log10(maps.range_time.mean(axis=0)), atol=6e-4)  # written to 0.001 dB
        for topic, power in (("range_doppler", maps.range_doppler), ("range_azimuth", maps.range_azimuth[::-1])):
            image = pixels(timeline[f"/radar/{topic}"][frame][1])
            level = 10 * np.log10(power.T[::-1])
            assert image.shape == level.shape
            # A pixel is a hundredth of a decibel above -200 dB, so that rounding leaves 0.005 dB; weaker levels are black.
            np.testing.assert_allclose(image / 100 - 200, np.maximum(level, -200), atol=0.0051)


def test_pictures_have_near_ranges_below_and_the_left_on_the_left(timeline):
    """The strongest pixel of each half of the azimuth map: the echo at 2 m and 20 degrees to the left, and that at 4 m to the right."""
    image = pixels(timeline["/radar/range_azimuth"][0][1])
    height = len(image)
    bin_m = C * RADAR.sample_rate_hz / (2 * RADAR.slope_hz_per_s) / height
    for half, range_m, azimuth_deg in ((slice(0, 90), 2.0, 20.0), (slice(91, None), 4.0, -30.0)):
        part = image[:, half]
        row, column = np.unravel_index(part.argmax(), part.shape)
        assert (height - 1 - row) * bin_m == pytest.approx(range_m, abs=bin_m)
        assert 90 - (column + (half.start or 0)) == pytest.approx(azimuth_deg, abs=2)  # a pixel is a degree, the beam is 13 degrees wide


def test_points_are_the_detections_in_metres(timeline):
    for frame, (_, cloud) in enumerate(timeline["/radar/points"]):
        fields = [(field["name"], "<f4") for field in cloud["fields"]]
        assert {field["type"] for field in cloud["fields"]} == {"FLOAT32"}
        assert [field["offset"] for field in cloud["fields"]] == [0, 4, 8, 12, 16]
        assert cloud["point_stride"] == 20
        assert [name for name, _ in fields] == ["x", "y", "z", "velocity", "intensity"]
        points = np.frombuffer(base64.b64decode(cloud["data"]), fields)
        (peaks,) = point_clouds(recording().iq[frame : frame + 1], RADAR)
        assert len(points) == len(peaks) == 2
        np.testing.assert_allclose(points["intensity"], 10 * np.log10(peaks.power / peaks.noise), rtol=1e-6)
        # The echoes as they were made: x is forward and y is left. The azimuth of the beam of 13 degrees is exact to a degree.
        for point in points:
            range_m, speed, azimuth_deg = (2.0, 0.0, 20.0) if point["y"] > 0 else (4.0 + 0.05 * frame, 0.5, -30.0)
            assert np.hypot(point["x"], point["y"]) == pytest.approx(range_m, abs=0.02)
            assert np.degrees(np.arctan2(point["y"], point["x"])) == pytest.approx(azimuth_deg, abs=1.0)
            assert point["velocity"] == pytest.approx(speed, abs=0.05)
            assert point["z"] == 0, "the antennas of this radar have equal heights"


def test_times_are_exact_nanoseconds(timeline):
    for entries in timeline.values():
        assert [time for time, _ in entries] == [START_NS, START_NS + 100_000_000, START_NS + 200_000_000]
        for time, content in entries:
            stamp = content["timestamp"]
            assert time == (
                np.datetime64(stamp.rstrip("Z"), "ns").astype(int)
                if isinstance(stamp, str)
                else stamp["sec"] * 1_000_000_000 + stamp["nsec"]
            )
    slow = rt.Radar.from_dict({**RADAR.to_dict(), "frame_rate_hz": 3.0})
    assert [frame_time_ns(slow, frame, 5) for frame in range(4)] == [5, 333_333_338, 666_666_672, 1_000_000_005]


def test_poses_turn_the_sensor_frame_into_the_world(tmp_path):
    """The transform of a quarter turn to the left at (1, 2, 3): a point 1 m ahead of the sensor lies at (1, 3, 3)."""
    poses = np.repeat(np.eye(4)[None], 3, axis=0)
    poses[:, :3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    poses[:, :3, 3] = [(1, 2, 3), (1, 2.5, 3), (1, 3, 3)]
    content = written(tmp_path, recording(sensor_poses=poses))
    for frame, ((_, transform), (_, pose)) in enumerate(zip(content["/tf"], content["/radar/pose"], strict=True)):
        assert (transform["parent_frame_id"], transform["child_frame_id"], pose["frame_id"]) == ("world", "radar", "world")
        assert pose["pose"] == {"position": transform["translation"], "orientation": transform["rotation"]}
        assert list(transform["translation"].values()) == pytest.approx(poses[frame, :3, 3])
        x, y, z, w = (transform["rotation"][name] for name in "xyzw")
        # The first column of the rotation matrix of a quaternion, which is where the x axis of the sensor points.
        ahead = [1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)]
        assert ahead == pytest.approx([0, 1, 0], abs=1e-12)
    assert {entry["frame_id"] for topic in ("/radar/points", "/radar/range_profile") for _, entry in content[topic]} == {"radar"}


def test_metadata_name_radar_version_and_scale(tmp_path):
    write_timeline(recording(provenance={"kind": "made by hand"}), tmp_path / "a.mcap", start_ns=START_NS)
    with (tmp_path / "a.mcap").open("rb") as stream:
        reader = make_reader(stream)
        (record,) = reader.iter_metadata()
    values = record.metadata
    assert rt.Radar.from_dict(json.loads(values["radar"])) == RADAR
    assert (values["version"], values["frames"], values["start_ns"]) == (rt.__version__, "3", str(START_NS))
    assert (values["unit"], values["floor_db"], values["pixels_per_db"]) == ("dB of transmitted power", "-200.0", "100.0")
    assert json.loads(values["provenance"]) == {"kind": "made by hand"}
    axes, maps = json.loads(values["axes"]), power_maps(recording().iq[:1], RADAR)
    assert (axes["range_m"], axes["azimuth_deg"]) == ([maps.range_m[-1], maps.range_m[0]], [90, -90])
    assert axes["velocity_mps"] == [maps.velocity_mps[0], maps.velocity_mps[-1]]


def test_pictures_of_a_camera_lie_between_the_frames(tmp_path):
    camera = tmp_path / "camera"
    camera.mkdir()
    for name, data in (("0.05.jpg", JPEG), ("0.250.png", PNG), ("0.1.jpeg", JPEG), ("notes.txt", b"")):
        (camera / name).write_bytes(data)
    images = written(tmp_path, recording(), pictures=read_pictures(camera))["/camera/image"]
    assert [time for time, _ in images] == [50_000_000, 100_000_000, 250_000_000]
    contents = [(content["format"], base64.b64decode(content["data"]), content["frame_id"]) for _, content in images]
    assert contents == [("jpeg", JPEG, "camera"), ("jpeg", JPEG, "camera"), ("png", PNG, "camera")]


def test_radars_without_a_map_leave_it_out(tmp_path):
    single = rt.Radar.from_dict({**RADAR.to_dict(), "tx_positions_m": [[0, 0, 0]], "rx_positions_m": [[0, 0, 0]]})
    assert set(written(tmp_path, recording(radar=single))) == {"/radar/range_profile", "/radar/range_doppler"}
    chirp = rt.Radar.from_dict({**RADAR.to_dict(), "num_chirps": 1})
    content = written(tmp_path, recording(radar=chirp))
    assert set(content) == {"/radar/range_profile", "/radar/range_azimuth", "/radar/points"}
    cloud = content["/radar/points"][0][1]
    points = np.frombuffer(base64.b64decode(cloud["data"]), [(field["name"], "<f4") for field in cloud["fields"]])
    assert len(points)
    assert np.isnan(points["velocity"]).all()


def test_silent_frames_are_black_and_counts_have_a_higher_floor(tmp_path):
    silent = rt.Recording(np.zeros((1, 16, 2, 4, 256), np.complex64), RADAR)
    content = written(tmp_path, silent)
    assert not pixels(content["/radar/range_doppler"][0][1]).any()
    assert set(content["/radar/range_profile"][0][1]["power_db"]) == {-3076.527}
    assert content["/radar/points"][0][1]["data"] == ""
    kept = recording(provenance={"unit": "counts"})  # whose levels have a higher floor
    kept.iq *= 1e9
    image = pixels(written(tmp_path, kept)["/radar/range_doppler"][0][1])
    assert image.max() / 100 - 20 == pytest.approx(10 * np.log10(power_maps(kept.iq[:1], RADAR).range_doppler.max()), abs=0.0051)


def test_memory_does_not_grow_with_the_number_of_frames(tmp_path):
    """The frames of both recordings are one view of a single frame, so that only the timeline itself can grow. A frame's messages have
    0.4 MB; twenty frames held in memory would need 8 MB.
    """

    def peak_bytes(frames):
        frame = samples(1, RADAR)
        many = rt.Recording(np.broadcast_to(frame, (frames, *frame.shape[1:])), RADAR)
        tracemalloc.start()
        write_timeline(many, tmp_path / "long.mcap")
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        return peak

    peak_bytes(1)  # loads modules
    assert peak_bytes(24) - peak_bytes(4) < 3e6  # a chunk of MCAP holds 1 MB before it is written


def test_missing_package_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "foxglove", None)
    words = ("foxglove-sdk", "pip install 'radartwin[mcap]'")
    refused(words, write_timeline, recording(), tmp_path / "a.mcap", error=BackendError)


def test_broken_pictures_and_targets_are_refused_and_lose_nothing(tmp_path):
    """The picture is removed after its name was read, because a superuser may read a file of any mode."""
    target, camera = tmp_path / "a.mcap", tmp_path / "camera"
    target.write_bytes(b"an older timeline")
    (camera / "0.3.jpg").mkdir(parents=True)  # a folder is no picture
    (camera / "0.1.jpg").write_bytes(JPEG)
    pictures = read_pictures(camera)
    assert [picture.path.name for picture in pictures] == ["0.1.jpg"]
    (camera / "0.1.jpg").unlink()
    words = ["camera/0.1.jpg: cannot read this picture (No such file or directory)"]
    refused(words, write_timeline, recording(), target, pictures=pictures, error=InputError)
    assert target.read_bytes() == b"an older timeline"
    refused(["is a folder"], write_timeline, recording(), tmp_path, error=OutputError)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.mcap", "camera"]


MISTAKES = {
    "no recording": (["--mcap", "a.mcap"], "needs one recording"),
    "two recordings": (["one", "two", "--mcap", "a.mcap"], "one, two"),
    "neither use": (["kept"], "--mcap --out"),
    "both uses": (["kept", "--mcap", "a.mcap", "--out", "set"], "--mcap"),
    "absent recording": (["absent", "--mcap", "a.mcap"], "absent.bin"),
    "target is a folder": (["kept", "--mcap", "camera"], "camera is a folder"),
    "target is the recording": (["kept", "--mcap", "kept.bin"], "kept.bin does not end with .mcap"),
    "target in a file": (["kept", "--mcap", "kept.bin/a.mcap"], "kept.bin"),
    "truncated recording": (["short", "--mcap", "a.mcap"], "truncated"),
    "start is no time": (["kept", "--mcap", "a.mcap", "--start", "noon"], "noon"),
    "start before 1970": (["kept", "--mcap", "a.mcap", "--start=-1"], "--start"),
    "absent pictures": (["kept", "--mcap", "a.mcap", "--pictures", "nowhere"], "nowhere"),
    "pictures without times": (["kept", "--mcap", "a.mcap", "--pictures", "camera"], "front"),
    "file that is no picture": (["kept", "--mcap", "a.mcap", "--pictures", "false"], "not a jpeg"),
    "start beyond 32 bits": (["kept", "--mcap", "a.mcap", "--start", "5e9"], "not from 0 to 4e9 seconds"),
    "option of the campaign": (["kept", "--mcap", "a.mcap", "--config-dir", "conf"], "--config-dir"),
    "option of a timeline": (["--out", "set", "--start", "3"], "--start"),
    "radar of a timeline": (["--out", "set", "--radar", "iwr1843"], "--radar"),
}


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """Return a folder with the recording `kept`, the truncated recording `short`, and two folders without pictures."""
    place = tmp_path_factory.mktemp("place")
    for name in ("kept", "short"):
        recording().save(place / name)
    (place / "short.bin").write_bytes((place / "short.bin").read_bytes()[:-7])
    for folder, name, data in (("camera", "front.jpg", JPEG), ("false", "0.1.jpg", b"GIF89a")):
        (place / folder).mkdir()
        (place / folder / name).write_bytes(data)
    return place


@pytest.mark.parametrize(("words", "word"), MISTAKES.values(), ids=MISTAKES)
def test_mistake_is_one_line_and_leaves_no_file(words, word, inside, place, tmp_path):
    shutil.copytree(place, tmp_path, dirs_exist_ok=True)
    before = {path: path.is_file() and path.read_bytes() for path in tmp_path.rglob("*")}
    done = inside("export", *words)
    lines = [line for line in done.stderr.splitlines() if not line.startswith("frames: ")]
    assert (done.returncode, len(lines)) == (2, 1)
    assert word in lines[0]
    assert {path: path.is_file() and path.read_bytes() for path in tmp_path.rglob("*")} == before


def test_command_writes_the_timeline_of_a_recording(inside, tmp_path):
    recording().save(tmp_path / "kept")
    done = inside("export", "kept", "--mcap", "out/kept.mcap", "--start", "1709294400.250000001")
    assert done.returncode == 0
    assert "/radar/points 3" in done.stdout
    assert "12 messages" in done.stderr
    assert {time for time, _ in messages(tmp_path / "out" / "kept.mcap")["/radar/points"]} == {START_NS + n * 100_000_000 for n in range(3)}
    assert [file.name for file in (tmp_path / "out").iterdir()] == ["kept.mcap"]
