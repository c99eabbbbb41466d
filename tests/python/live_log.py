"""A live node's log read by two independent programs: every message decodes, and says what `replay` says.

    python live_log.py live.mcap decisions.jsonl
"""

import json
import sys
from collections import Counter
from pathlib import Path

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore


def by_mcap(log):
    """Messages by topic as mcap_ros2 decodes them."""
    with open(log, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        return [(channel.topic, message) for _, channel, _, message in reader.iter_decoded_messages()]


def by_rosbags(log):
    """Messages by topic as rosbags decodes them."""
    with AnyReader([Path(log)], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        return [(c.topic, reader.deserialize(raw, c.msgtype)) for c, _, raw in reader.messages()]


def main(log, decisions):
    expected = [json.loads(line) for line in Path(decisions).read_text().splitlines()]
    for name, messages in [("mcap_ros2", by_mcap(log)), ("rosbags", by_rosbags(log))]:
        counts = Counter(topic for topic, _ in messages)
        found = [json.loads(m.data) for topic, m in messages if topic.endswith("/decision")]
        assert found == expected, f"{name}: {len(found)} decisions, {len(expected)} expected"
        for topic, message in messages:
            if topic.endswith("/belief"):
                assert max(message.data) == 100 and len(message.data) == message.info.width * message.info.height
            if topic.endswith("/particle_cloud"):
                assert message.width * message.point_step == len(message.data)
            if topic.endswith("/particles"):
                assert abs(sum(v * v for v in vars_of(message.poses[0].orientation)) - 1.0) < 1e-9
            if topic.endswith("/pose"):
                assert message.pose.covariance[0] > 0.0
        print(f"{name}: {len(messages)} messages on {len(counts)} topics decode; {len(found)} decisions are equal")


def vars_of(quaternion):
    return quaternion.x, quaternion.y, quaternion.z, quaternion.w


main(*sys.argv[1:])
