"""ROS 2 bags between `tactile-data` and independent programs, byte for byte.

    pip install numpy pillow rosbags==0.11.9 mcap-ros2-support==0.6.0
    python tests/python/mcap_interop.py target/release/tactile-data [scratch folder]

In: bags from three writers (rosbags, mcap_ros2, mcap without chunks), in every compression and encoding, are imported;
the frames, poses and times of the dataset are compared with what was written. Out: the dataset is exported and read
with three readers (rosbags, mcap_ros2, mcap with a decoder of our own below). Ends with exit code 1 at a difference.
"""

import dataclasses
import io
import json
import math
import shutil
import struct
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from mcap.writer import CompressionType
from mcap.writer import Writer as PlainWriter
from mcap_ros2.reader import read_ros2_messages
from mcap_ros2.writer import Writer as Ros2Writer
from PIL import Image
from rosbags.rosbag2 import CompressionFormat, CompressionMode, Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.ROS2_HUMBLE)
TYPES = STORE.types
HEIGHT, WIDTH = 60, 80
N_REST, N_TOUCHES = 15, 60
IMAGE, COMPRESSED, POSE = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage", "geometry_msgs/msg/PoseStamped"


def frames():
    """Frames at rest, all the same, then touches of noise over a gradient: u8 [n, height, width, 3]."""
    rng = np.random.default_rng(7)
    x = np.arange(WIDTH)[None, :, None]
    rest = np.broadcast_to(70 + x + 10 * np.arange(3), (HEIGHT, WIDTH, 3)).astype(np.uint8)
    noise = rng.integers(0, 60, (N_TOUCHES, HEIGHT, WIDTH, 3))
    return np.concatenate([np.repeat(rest[None], N_REST, 0), (rest + noise).astype(np.uint8)])


def times_ns():
    """Rest, a pause of a second, touches; on a clock as ROS has it."""
    start = 1_700_000_000_123_456_789
    return [start + 40_000_000 * i + (1_000_000_000 if i >= N_REST else 0) for i in range(N_REST + N_TOUCHES)]


def plane(i):
    """Pose of touch i, mm and radians."""
    return 0.25 * i - 7, 3.5 - 0.1 * i, math.remainder(0.17 * i, 2 * math.pi)


def header(time_ns, frame_id):
    stamp = TYPES["builtin_interfaces/msg/Time"](sec=time_ns // 10**9, nanosec=time_ns % 10**9)
    return TYPES["std_msgs/msg/Header"](stamp=stamp, frame_id=frame_id)


def pose_message(time_ns, frame_id, x_mm, y_mm, theta):
    position = TYPES["geometry_msgs/msg/Point"](x=x_mm / 1000, y=y_mm / 1000, z=0.0)
    rotation = TYPES["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=math.sin(theta / 2), w=math.cos(theta / 2))
    pose = TYPES["geometry_msgs/msg/Pose"](position=position, orientation=rotation)
    return TYPES[POSE](header=header(time_ns, frame_id), pose=pose)


def picture_message(kind, time_ns, rgb):
    """A message of an encoding, `png` or `jpeg`; `+pad` puts 7 bytes behind every row."""
    name, _, pad = kind.partition("+")
    if name in ("png", "jpeg"):
        file = io.BytesIO()
        Image.fromarray(rgb).save(file, name, **({"quality": 95, "subsampling": 0} if name == "jpeg" else {}))
        data = np.frombuffer(file.getvalue(), np.uint8)
        return TYPES[COMPRESSED](header=header(time_ns, "gel"), format=f"bgr8; {name} compressed bgr8", data=data)
    alpha = np.full((HEIGHT, WIDTH, 1), 200, np.uint8)
    pixels = {
        "rgb8": rgb,
        "bgr8": rgb[..., ::-1],
        "rgba8": np.concatenate([rgb, alpha], -1),
        "bgra8": np.concatenate([rgb[..., ::-1], alpha], -1),
        "mono8": rgb[..., :1],
        "passthrough": rgb,
    }[name]
    rows = pixels.reshape(HEIGHT, -1)
    if pad:
        rows = np.concatenate([rows, np.full((HEIGHT, 7), 99, np.uint8)], 1)
    data = np.ascontiguousarray(rows).reshape(-1)
    return TYPES[IMAGE](header(time_ns, "gel"), HEIGHT, WIDTH, name, 0, rows.shape[1], data)


def messages(kind, rgb, with_poses):
    """What is recorded: (topic, message, time)."""
    for i, (frame, time_ns) in enumerate(zip(rgb, times_ns())):
        yield "/gelsight/image_raw", picture_message(kind, time_ns, frame), time_ns
        if with_poses and i >= N_REST:
            touch = i - N_REST
            frame_id = f"{'hole' if touch % 2 else 'peg'}/P{touch // 10}"
            # Between two frames, 3 ms behind its own.
            yield "/tool_pose", pose_message(time_ns + 3_000_000, frame_id, *plane(touch)), time_ns + 3_000_000


def write_rosbags(path, compression, sent):
    with_compression = {"none": None, "zstd": CompressionMode.STORAGE, "message-zstd": CompressionMode.MESSAGE}
    writer = Writer(path, version=9, storage_plugin=StoragePlugin.MCAP)
    if with_compression[compression]:
        writer.set_compression(with_compression[compression], CompressionFormat.ZSTD)
    with writer:
        topics = {}
        for topic, message, time_ns in sent:
            if topic not in topics:
                topics[topic] = writer.add_connection(topic, message.__msgtype__, typestore=STORE)
            writer.write(topics[topic], time_ns, STORE.serialize_cdr(message, message.__msgtype__))


def definition(msgtype):
    return STORE.generate_msgdef(msgtype, ros_version=2)[0]


def write_mcap_ros2(path, compression, sent):
    kinds = {"none": CompressionType.NONE, "zstd": CompressionType.ZSTD, "lz4": CompressionType.LZ4}
    with open(path, "wb") as file:
        writer = Ros2Writer(file, chunk_size=200_000, compression=kinds[compression])
        schemas = {}
        for topic, message, time_ns in sent:
            kind = message.__msgtype__
            if hasattr(message, "data"):
                message = dataclasses.replace(message, data=message.data.tobytes())
            if kind not in schemas:
                schemas[kind] = writer.register_msgdef(kind, definition(kind))
            writer.write_message(topic, schemas[kind], message, time_ns)
        writer.finish()


def write_unchunked(path, _compression, sent):
    with open(path, "wb") as file:
        writer = PlainWriter(file, use_chunking=False)
        writer.start(profile="ros2")
        channels = {}
        for topic, message, time_ns in sent:
            kind = message.__msgtype__
            if topic not in channels:
                schema = writer.register_schema(kind, "ros2msg", definition(kind).encode())
                channels[topic] = writer.register_channel(topic, "cdr", schema)
            cdr = bytes(STORE.serialize_cdr(message, kind))
            writer.add_message(channels[topic], log_time=time_ns, publish_time=time_ns, data=cdr)
        writer.finish()


WRITERS = [
    ("rosbags", write_rosbags, ["none", "zstd", "message-zstd"]),
    ("mcap_ros2", write_mcap_ros2, ["none", "zstd", "lz4"]),
    ("mcap, no chunks", write_unchunked, ["none"]),
]
KINDS = ["rgb8", "bgr8+pad", "rgba8", "bgra8+pad", "mono8", "passthrough", "png", "jpeg"]


def run(program, *arguments):
    done = subprocess.run([program, *map(str, arguments)], capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"{' '.join(map(str, arguments))}\n{done.stdout}{done.stderr}")
    return done.stdout + done.stderr


def check_touches(dataset):
    """Poses, parts and times of the touches; returns the largest error of a pose, mm and radians."""
    worst = 0.0
    touches = [json.loads(line) for line in (dataset / "index.jsonl").read_text().splitlines()]
    assert len(touches) == N_TOUCHES, len(touches)
    for i, touch in enumerate(touches):
        assert (touch["part"], touch["side"]) == (f"P{i // 10}", "hole" if i % 2 else "peg"), touch
        assert touch["time_s"] == times_ns()[N_REST + i] / 10**9, touch
        found = touch["part_from_sensor"]
        errors = np.abs(np.subtract([found["x_mm"], found["y_mm"], found["theta_rad"]], plane(i)))
        worst = max(worst, errors.max())
    assert worst < 1e-9, worst
    return worst


def bags_in(program, scratch, rgb):
    n_bags, n_frames, worst = 0, 0, 0.0
    for writer, write, compressions in WRITERS:
        for compression in compressions:
            for kind in KINDS:
                path, posed = scratch / f"{n_bags}.mcap", scratch / f"{n_bags}-posed.mcap"
                write(path, compression, messages(kind, rgb, False))
                write(posed, compression, messages(kind, rgb, True))
                out, poses = scratch / f"{n_bags}-each", scratch / f"{n_bags}-poses"
                run(program, "import", path, "--touches", "each", "--no-contact", N_REST, "--out", out)
                run(program, "import", posed, "--touches", "poses", "--no-contact", N_REST, "--out", poses)
                got, expected = np.load(out / "frames.npy"), rgb
                if kind == "mono8":
                    expected = np.repeat(expected[..., :1], 3, -1)
                assert got.shape == expected.shape, (got.shape, expected.shape)
                difference = np.abs(got.astype(int) - expected)
                if kind == "jpeg":
                    # With another decoder of the same file; decoders differ by up to 3 counts.
                    decoded = [np.asarray(Image.open(io.BytesIO(picture_message(kind, 0, f).data.tobytes()))) for f in expected]
                    difference = np.abs(got.astype(int) - np.stack(decoded))
                    assert difference.max() <= 3, difference.max()
                else:
                    assert not difference.any(), (writer, compression, kind, difference.max())
                assert (np.load(poses / "frames.npy") == got[N_REST:]).all()
                worst = max(worst, check_touches(poses))
                n_frames += len(got) + N_TOUCHES
                n_bags += 2
                for done in (out, poses, path, posed):
                    shutil.rmtree(done) if done.is_dir() else done.unlink()
            print(f"in   {writer}, {compression}: {', '.join(KINDS)}")
    print(f"in   {n_bags} bags, {n_frames} frames, all bytes equal (JPEG: at most 3 counts from Pillow's)")
    print(f"in   poses within {worst:.1e} mm and radians, every time to the last bit")


def decode_by_hand(cdr):
    """An Image or the bytes of a CompressedImage in little endian CDR, without a library."""
    at = 4

    def number(kind):
        nonlocal at
        size = struct.calcsize(kind)
        at += -(at - 4) % size
        (value,) = struct.unpack_from("<" + kind, cdr, at)
        at += size
        return value

    def data():
        nonlocal at
        n = number("I")
        at += n
        return cdr[at - n:at]

    time_ns = number("i") * 10**9 + number("I")
    data()
    return time_ns, number, data


def read_by_hand(path):
    with open(path, "rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            time_ns, number, data = decode_by_hand(message.data)
            if schema.name == IMAGE:
                height, width = number("I"), number("I")
                assert (data(), number("B"), number("I")) == (b"rgb8\0", 0, 3 * width)
                yield channel.topic, time_ns, np.frombuffer(data(), np.uint8).reshape(height, width, 3)
            elif schema.name == COMPRESSED:
                assert data() == b"jpeg\0"
                yield channel.topic, time_ns, data()
            else:
                yield channel.topic, time_ns, [number("d") for _ in range(7)]


def values(topic, message):
    """A decoded message of a library as `read_by_hand` gives it."""
    time_ns = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
    if hasattr(message, "pose"):
        p, q = message.pose.position, message.pose.orientation
        return topic, time_ns, [p.x, p.y, p.z, q.x, q.y, q.z, q.w]
    if hasattr(message, "encoding"):
        assert message.encoding == "rgb8" and message.step == 3 * message.width
        return topic, time_ns, np.frombuffer(bytes(message.data), np.uint8).reshape(message.height, message.width, 3)
    return topic, time_ns, bytes(message.data)


def read_rosbags(path):
    with Reader(path) as reader:
        for connection, _, cdr in reader.messages():
            yield values(connection.topic, STORE.deserialize_cdr(cdr, connection.msgtype))


def read_mcap_ros2(path):
    for item in read_ros2_messages(path):
        yield values(item.channel.topic, item.ros_msg)


READERS = [("rosbags", read_rosbags), ("mcap_ros2", read_mcap_ros2), ("mcap, own decoder", read_by_hand)]


def bags_out(program, scratch, rgb):
    bag = scratch / "source.mcap"
    write_mcap_ros2(bag, "none", messages("rgb8", rgb, True))
    dataset = scratch / "dataset"
    run(program, "import", bag, "--touches", "poses", "--no-contact", N_REST, "--out", dataset)
    poses = [json.loads(line)["part_from_sensor"] for line in (dataset / "index.jsonl").read_text().splitlines()]
    for jpeg in [[], ["--jpeg", 90]]:
        out = scratch / f"out{len(jpeg)}.mcap"
        run(program, "export", dataset, "--to", "mcap", "--out", out, *jpeg)
        contents = []
        for reader, read in READERS:
            found = list(read(out))
            pictures = [(time, value) for topic, time, value in found if topic == "/gelsight/image"]
            sent = [(time, value) for topic, time, value in found if topic == "/tool_pose"]
            assert (len(pictures), len(sent)) == (N_REST + N_TOUCHES, N_TOUCHES), (len(pictures), len(sent))
            assert [time for time, _ in pictures[N_REST:]] == [time for time, _ in sent]
            # A time in seconds has 53 bits.
            assert all(abs(a - b) < 300 for a, (b, _) in zip(times_ns()[N_REST:], sent))
            for pose, (_, [x, y, z, qx, qy, qz, qw]) in zip(poses, sent):
                theta = 2 * math.atan2(qz, qw)
                errors = np.subtract([1000 * x, 1000 * y, z, qx, qy, theta], [pose["x_mm"], pose["y_mm"], 0, 0, 0, pose["theta_rad"]])
                assert np.abs(errors).max() < 1e-12, errors
            if jpeg:
                contents.append([bytes(value) for _, value in pictures])
                decoded = np.stack([np.asarray(Image.open(io.BytesIO(bytes(value)))) for _, value in pictures])
                mean = np.abs(decoded.astype(int) - rgb).mean()
                assert decoded.shape == rgb.shape and mean < 12, mean
                print(f"out  {reader}: {len(pictures)} JPEGs, {mean:.1f} counts from the frames on average (noise)")
            else:
                assert (np.stack([value for _, value in pictures]) == rgb).all()
                print(f"out  {reader}: {len(pictures)} frames equal to the last bit, {len(sent)} poses to 1e-12")
        assert all(content == contents[0] for content in contents)
    arrays = scratch / "arrays"
    run(program, "export", dataset, "--to", "npy", "--out", arrays)
    assert (np.load(arrays / "frames.npy") == rgb[N_REST:]).all() and (np.load(arrays / "no_contact.npy") == rgb[0]).all()
    expected = [[pose["x_mm"], pose["y_mm"], pose["theta_rad"]] for pose in poses]
    assert np.load(arrays / "poses.npy").tolist() == expected
    pictures = scratch / "pictures"
    run(program, "export", dataset, "--to", "folder", "--out", pictures)
    assert all((np.asarray(Image.open(pictures / f"{i:06}.png")) == rgb[N_REST + i]).all() for i in range(N_TOUCHES))
    print(f"out  numpy.load: {N_TOUCHES} frames and poses equal to the last bit; Pillow: {N_TOUCHES} PNGs equal")


def main():
    program = str(Path(sys.argv[1]).resolve())
    scratch = Path(sys.argv[2]) if len(sys.argv) > 2 else Path(tempfile.mkdtemp(prefix="mcap_interop_"))
    scratch.mkdir(parents=True, exist_ok=True)
    rgb = frames()
    bags_in(program, scratch, rgb)
    bags_out(program, scratch, rgb)
    shutil.rmtree(scratch)


if __name__ == "__main__":
    main()
