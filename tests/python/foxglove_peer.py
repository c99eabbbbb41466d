"""A viewer against our live views, by Foxglove's websocket protocol. Run by `cargo xtask views`.

    pip install websockets==17.4
    python tests/python/foxglove_peer.py target/release/examples/foxglove_peer

Checks what is advertised, that each message comes byte for byte, that a viewer that comes late gets the last message of
a topic that is silent, and that one that reads nothing holds nobody up. Ends with exit code 1 at a difference.
"""

import contextlib
import json
import struct
import subprocess
import sys
import time

from websockets.sync.client import connect

PROTOCOLS = ["foxglove.sdk.v1", "foxglove.websocket.v1"]
MESSAGE = 1


def check(is_right, what):
    if not is_right:
        sys.exit(f"FAILED: {what}")


def viewer(stack, port, topics):
    """A connection that has asked for topics, and what was advertised."""
    connection = stack.enter_context(connect(f"ws://127.0.0.1:{port}", subprotocols=PROTOCOLS, max_size=None))
    channels, schemas = {}, {}
    while len(channels) < 3:
        text = connection.recv(timeout=10)
        if isinstance(text, str) and json.loads(text)["op"] == "advertise":
            channels.update({channel["topic"]: channel for channel in json.loads(text)["channels"]})
    wanted = [{"id": number, "channelId": channels[topic]["id"]} for number, topic in enumerate(topics)]
    connection.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
    return connection, channels


def messages(connection, seconds):
    """Subscription, time and bytes of each message of some seconds."""
    deadline = time.monotonic() + seconds
    while (left := deadline - time.monotonic()) > 0:
        try:
            packet = connection.recv(timeout=left)
        except TimeoutError:
            return
        if isinstance(packet, bytes) and packet[0] == MESSAGE:
            subscription, time_ns = struct.unpack_from("<IQ", packet, 1)
            yield subscription, time_ns, packet[13:]


def expected(number):
    body = bytes(((i * 31 + number) & 0xFFFFFFFF) >> 3 & 0xFF for i in range(20_000))
    return bytes([0, 1, 0, 0]) + number.to_bytes(4, "little") + body


def main():
    with contextlib.ExitStack() as stack:
        watch(stack)


def watch(stack):
    program = subprocess.Popen([sys.argv[1], "9"], stdout=subprocess.PIPE, text=True)
    port = int(program.stdout.readline())
    topics = ["/gelsight/image", "/tool_pose", "/tactile_filter/label"]
    # One that reads nothing.
    viewer(stack, port, topics[:1])
    time.sleep(1)
    connection, channels = viewer(stack, port, topics)
    print(f"protocol {connection.subprotocol}")
    for topic, name, field in (
        ("/gelsight/image", "sensor_msgs/msg/CompressedImage", "uint8[] data\n"),
        ("/tool_pose", "geometry_msgs/msg/PoseStamped", "geometry_msgs/Pose pose\n"),
        ("/tactile_filter/label", "std_msgs/msg/String", "string data\n"),
    ):
        channel = channels[topic]
        got = [channel["encoding"], channel["schemaName"], channel["schemaEncoding"]]
        check(got == ["cdr", name, "ros2msg"], f"{topic}: {got}")
        check(field in channel["schema"], f"{topic}: {channel['schema']!r}")
    numbers, labels = [], []
    for subscription, time_ns, message in messages(connection, 4):
        number = int.from_bytes(message[4:8], "little")
        if subscription == 2:
            labels.append((time_ns, message))
        elif subscription == 1:
            check(message == expected(number)[:64], f"pose {number} differs")
        else:
            check(message == expected(number), f"image {number} differs")
            check(time_ns == 1_000_000 * number, f"image {number} at {time_ns}")
            numbers.append(number)
    check(labels == [(7, bytes([0, 1, 0, 0, 2, 0, 0, 0]) + b"A\0")], f"the late viewer got {labels}")
    gaps = [b - a for a, b in zip(numbers, numbers[1:]) if b != a + 1]
    # The first may come twice: as the last one before, and as it is shown.
    check(set(gaps) <= {0} and len(numbers) > 80, f"{len(numbers)} images, steps {gaps}")
    print(f"{len(numbers)} images and their poses, byte for byte; the silent label came late")
    print(program.communicate(timeout=30)[0].strip())
    check(program.returncode == 0, "the server failed")


if __name__ == "__main__":
    main()
