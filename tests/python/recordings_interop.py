"""ROS 1 bags and Parquet of independent programs, imported by `tactile-data`: frames, poses, names and times.

    pip install numpy pillow rosbags==0.11.9 pyarrow==26.0.1 datasets==5.2.0
    cargo build --release --package tactile-data --features ros1,parquet
    python tests/python/recordings_interop.py target/release/tactile-data [scratch folder]

Bags are written by `rosbags` in each compression and encoding, with poses on a topic and as transforms, whole and cut
off. Parquet is written by `pyarrow` in each codec, page version and width of numbers, and by `datasets`. Ends with exit
code 1 at a difference.
"""

import hashlib
import io
import json
import math
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from datasets import Dataset, Features, Value
from datasets import Image as ImageFeature
from PIL import Image
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

STORE = get_typestore(Stores.ROS1_NOETIC)
STORE.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage"))
TYPES = STORE.types
HEIGHT, WIDTH = 60, 80
N_REST, N_TOUCHES = 15, 60
N = N_REST + N_TOUCHES


def frames():
    """Frames at rest, all the same, then touches of noise over a gradient: u8 [n, height, width, 3]."""
    x = np.arange(WIDTH)[None, :, None]
    rest = np.broadcast_to(70 + x + 10 * np.arange(3), (HEIGHT, WIDTH, 3)).astype(np.uint8)
    noise = np.random.default_rng(7).integers(0, 60, (N_TOUCHES, HEIGHT, WIDTH, 3))
    return np.concatenate([np.repeat(rest[None], N_REST, 0), (rest + noise).astype(np.uint8)])


FRAMES = frames()
START = 1_700_000_000_123_456_789
TIMES_NS = [START + 40_000_000 * i + (1_000_000_000 if i >= N_REST else 0) for i in range(N)]


def plane(i):
    """Pose of touch i, mm and degrees."""
    return 0.25 * i - 7, 3.5 - 0.1 * i, (7 * i) % 360 - 180


def encoded(rgb, name):
    file = io.BytesIO()
    Image.fromarray(rgb).save(file, name, **({"quality": 95, "subsampling": 0} if name == "jpeg" else {}))
    return file.getvalue()


def imported(program, source, out, *flags):
    """Frames, touches and what was said."""
    command = [program, "import", source, "--out", out, *flags]
    run = subprocess.run([str(word) for word in command], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    rows = [json.loads(line) for line in (out / "index.jsonl").read_text().splitlines()]
    files = [source] if source.is_file() else sorted(source.glob("*.parquet"))
    sha256 = hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()
    assert json.loads((out / "meta.json").read_text())["recording"]["source_sha256"] == sha256
    return np.load(out / "frames.npy", mmap_mode="r"), rows, run.stderr


def off(pose, expected):
    """How far a pose of a dataset is from `expected` (mm, degrees), mm or radians."""
    x, y, degrees = expected
    turned = math.remainder(pose["theta_rad"] - math.radians(degrees), 2 * math.pi)
    return max(abs(pose["x_mm"] - x), abs(pose["y_mm"] - y), abs(turned))


def header(time_ns, frame_id):
    stamp = TYPES["builtin_interfaces/msg/Time"](sec=time_ns // 10**9, nanosec=time_ns % 10**9)
    return TYPES["std_msgs/msg/Header"](seq=3, stamp=stamp, frame_id=frame_id)


def picture_message(kind, time_ns, rgb):
    if kind in ("png", "jpeg"):
        data = np.frombuffer(encoded(rgb, kind), np.uint8)
        return TYPES["sensor_msgs/msg/CompressedImage"](header(time_ns, "gel"), kind, data)
    rows = (rgb if kind == "rgb8" else rgb[..., ::-1]).reshape(HEIGHT, -1)
    rows = np.concatenate([rows, np.full((HEIGHT, 7), 99, np.uint8)], 1)
    return TYPES["sensor_msgs/msg/Image"](header(time_ns, "gel"), HEIGHT, WIDTH, kind, 0, rows.shape[1], rows.ravel())


def place(x_mm, y_mm, degrees, kind, vector):
    half = math.radians(degrees) / 2
    rotation = TYPES["geometry_msgs/msg/Quaternion"](0.0, 0.0, math.sin(half), math.cos(half))
    return TYPES[kind](TYPES[vector](x_mm / 1000, y_mm / 1000, 0.0), rotation)


def pose_message(time_ns, frame_id, pose):
    body = place(*pose, "geometry_msgs/msg/Pose", "geometry_msgs/msg/Point")
    return TYPES["geometry_msgs/msg/PoseStamped"](header(time_ns, frame_id), body)


def transform_message(time_ns, parent, child, pose):
    body = place(*pose, "geometry_msgs/msg/Transform", "geometry_msgs/msg/Vector3")
    transform = TYPES["geometry_msgs/msg/TransformStamped"](header(time_ns, parent), child, body)
    return TYPES["tf2_msgs/msg/TFMessage"]([transform])


def messages(kind):
    """What is recorded: (topic, message, time)."""
    yield "/tf_static", transform_message(TIMES_NS[0], "tool0", "gelsight", (0.0, 5.0, 0.0)), TIMES_NS[0]
    for i, (rgb, time_ns) in enumerate(zip(FRAMES, TIMES_NS)):
        yield "/gelsight/image_raw", picture_message(kind, time_ns, rgb), time_ns
        if i >= N_REST:
            touch = i - N_REST
            frame_id = f"{'hole' if touch % 2 else 'peg'}/P{touch // 10}"
            yield "/tool_pose", pose_message(time_ns + 3_000_000, frame_id, plane(touch)), time_ns + 3_000_000
            transform = transform_message(time_ns - 1_000_000, "base", "tool0", plane(touch))
            yield "/tf", transform, time_ns - 1_000_000


def write_bag(path, compression, kind):
    writer = Writer(path)
    if compression != "none":
        writer.set_compression(Writer.CompressionFormat[compression.upper()])
    writer.chunk_threshold = 200_000
    with writer:
        topics = {}
        for topic, message, time_ns in sorted(messages(kind), key=lambda sent: sent[2]):
            if topic not in topics:
                topics[topic] = writer.add_connection(topic, message.__msgtype__, typestore=STORE)
            writer.write(topics[topic], time_ns, STORE.serialize_ros1(message, message.__msgtype__))


def check_bag(program, bag, kind, with_transforms):
    name = "transforms" if with_transforms else "poses"
    flags = ["--frames", "base,gelsight", "--max-gap-ms", "20"] if with_transforms else []
    flags += ["--touches", "poses", "--no-contact", N_REST]
    found, rows, _ = imported(program, bag, bag.with_suffix(f".{name}"), *flags)
    assert len(found) == N_TOUCHES
    worst = 0
    for i, (frame, row) in enumerate(zip(found, rows)):
        rgb = FRAMES[N_REST + i]
        if kind == "jpeg":
            rgb = np.asarray(Image.open(io.BytesIO(encoded(rgb, kind)))).astype(int)
            assert np.abs(rgb - frame).max() <= 3
        else:
            assert (frame == rgb).all()
        x, y, degrees = plane(i)
        if with_transforms:
            x, y = x - 5 * math.sin(math.radians(degrees)), y + 5 * math.cos(math.radians(degrees))
        else:
            assert (row["part"], row["side"]) == (f"P{i // 10}", "hole" if i % 2 else "peg")
        worst = max(worst, off(row["part_from_sensor"], (x, y, degrees)))
        assert row["time_s"] == TIMES_NS[N_REST + i] / 10**9
    assert worst < 1e-9
    print(f"{bag.name}: {len(found)} frames and {name} arrive, to {worst:.0e} mm or radians")


def bags(program, folder):
    for compression in ("none", "bz2", "lz4"):
        for kind in ("rgb8", "bgr8", "png", "jpeg"):
            bag = folder / f"{compression}-{kind}.bag"
            write_bag(bag, compression, kind)
            check_bag(program, bag, kind, with_transforms=False)
        check_bag(program, folder / f"{compression}-rgb8.bag", "rgb8", with_transforms=True)
        cut = folder / f"{compression}-cut.bag"
        whole = (folder / f"{compression}-rgb8.bag").read_bytes()
        cut.write_bytes(whole[: len(whole) * 2 // 3])
        flags = ["--touches", "poses", "--no-contact", N_REST]
        found, _, said = imported(program, cut, cut.with_suffix(".out"), *flags)
        assert len(found) > 0 and "cut off at byte" in said
        print(f"{cut.name}: {len(found)} frames before the cut")


def columns(number, integer, dictionary):
    """The columns of a table, and of each row the touch that it is; every 20th row knows nothing but its time."""
    known = [i % 20 != 19 for i in range(N)]
    text = pa.dictionary(pa.int32(), pa.string()) if dictionary else pa.string()
    picked = lambda value: [value(i) if known[i] else None for i in range(N)]
    of = {
        "image": pa.StructArray.from_arrays(
            [pa.array([encoded(rgb, "png") for rgb in FRAMES], pa.binary()), pa.array(["a.png"] * N)], ["bytes", "path"]
        ),
        "part": pa.array(picked(lambda i: f"P{i // 20}"), pa.string()).cast(text),
        "side": pa.array(picked(lambda i: "hole" if i % 2 else "peg"), pa.string()).cast(text),
        "x_mm": pa.array(picked(lambda i: plane(i)[0]), number),
        "y_mm": pa.array(picked(lambda i: plane(i)[1]), number),
        "theta_deg": pa.array(picked(lambda i: plane(i)[2]), integer),
        "episode": pa.array([i // 20 for i in range(N)], pa.uint32()),
        "time_s": pa.array([time_ns / 10**9 for time_ns in TIMES_NS], pa.float64()),
    }
    return pa.table(of)


def check_table(program, source, number=np.float64):
    found, rows, said = imported(program, source, source.with_suffix(".out"), "--no-contact", N_REST)
    assert (found == FRAMES).all() and "warning" not in said, said
    worst = 0
    for i, row in enumerate(rows):
        assert (row["episode"], row["time_s"]) == (str(i // 20), TIMES_NS[i] / 10**9)
        if i % 20 == 19:
            assert "part" not in row and "side" not in row and "part_from_sensor" not in row, row
            continue
        assert (row["part"], row["side"]) == (f"P{i // 20}", "hole" if i % 2 else "peg")
        x, y, degrees = plane(i)
        pose = row["part_from_sensor"]
        assert (pose["x_mm"], pose["y_mm"]) == (float(number(x)), float(number(y)))
        worst = max(worst, off(pose, (pose["x_mm"], pose["y_mm"], degrees)))
    assert worst < 1e-12
    print(f"{source.name}: {len(found)} frames and rows arrive, angles to {worst:.0e}")


def tables(program, folder):
    plain = columns(pa.float64(), pa.int32(), dictionary=False)
    for codec in ("none", "snappy", "gzip", "lz4"):
        for page in ("1.0", "2.0"):
            path = folder / f"{codec}-pages-{page}.parquet"
            pq.write_table(plain, path, compression=codec, data_page_version=page, row_group_size=32)
            check_table(program, path)
    path = folder / "narrow-dictionary.parquet"
    pq.write_table(columns(pa.float32(), pa.int16(), dictionary=True), path)
    check_table(program, path, np.float32)
    path = folder / "other-encodings.parquet"
    encodings = {"x_mm": "BYTE_STREAM_SPLIT", "episode": "DELTA_BINARY_PACKED", "part": "DELTA_BYTE_ARRAY"}
    pq.write_table(plain, path, use_dictionary=False, write_page_checksum=True, column_encoding=encodings)
    check_table(program, path)
    shards = folder / "shards"
    shards.mkdir()
    for i in range(3):
        pq.write_table(plain.slice(25 * i, 25), shards / f"train-0000{i}-of-00003.parquet")
    check_table(program, shards)
    features = {field.name: Value(str(field.type)) for field in plain.schema if field.name != "image"}
    hub = Dataset.from_dict(plain.to_pydict(), features=Features({"image": ImageFeature(), **features}))
    hub.to_parquet(folder / "hub.parquet")
    check_table(program, folder / "hub.parquet")
    path = folder / "zstd.parquet"
    pq.write_table(plain, path, compression="zstd")
    refused = subprocess.run([program, "import", path, "--out", folder / "zstd.out"], capture_output=True, text=True)
    assert refused.returncode == 1 and "ZSTD" in refused.stderr and "write_table" in refused.stderr
    print("zstd.parquet: refused with the command that packs it again")


def main():
    program = Path(sys.argv[1]).resolve()
    with tempfile.TemporaryDirectory(dir=sys.argv[2] if len(sys.argv) > 2 else None) as folder:
        bags(program, Path(folder))
        tables(program, Path(folder))


main()
