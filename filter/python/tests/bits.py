"""Plays the episodes that `cargo run --release -p tactile-py --example fixture` wrote, and compares every bit.

    python tests/bits.py FOLDER
"""

import json
import sys
from pathlib import Path

import numpy as np
import tactile_filter as tf


def floats(bits):
    return np.array(bits, np.uint64).view(np.float64)


def pose(bits):
    return tf.Pose(*floats(bits))


def same(what, got, expected):
    """Equal to the bit: what is compared are the bytes."""
    got, expected = np.ascontiguousarray(got), np.ascontiguousarray(expected)
    if got.dtype != expected.dtype or got.shape != expected.shape or got.tobytes() != expected.tobytes():
        sys.exit(f"error: {what}: expected {expected}, got {got}")


def same_estimate(what, got, expected):
    if got.part != expected["part"] or got.n_touches != expected["n_touches"]:
        sys.exit(f"error: {what}: expected {expected['part']}, got {got}")
    if (got.fit is None) != (expected["fit"] is None):
        sys.exit(f"error: {what}: fit: expected {expected['fit']}, got {got.fit}")
    same(f"{what} fit", [got.fit or 0.0], floats([expected["fit"] or 0]))
    for name in ["probability", "entropy_nats", "log_evidence"]:
        same(f"{what} {name}", [getattr(got, name)], floats([expected[name]]))
    other = got.runner_up
    if (other and other.part) != (expected["runner_up"] and expected["runner_up"]["part"]):
        sys.exit(f"error: {what} runner-up: expected {expected['runner_up']}, got {other}")
    if other:
        same(f"{what} runner-up", [other.probability], floats([expected["runner_up"]["probability"]]))
    for name in ["part_from_sensor", "part_from_first"]:
        same(f"{what} {name}", getattr(got, name).as_tuple(), floats(expected[name]))
    same(f"{what} twins", [twin.as_tuple() for twin in got.twins], floats(expected["twins"]))
    same(f"{what} covariance", got.covariance.ravel(), floats(expected["covariance"]))
    if len(got.modes) != len(expected["modes"]):
        sys.exit(f"error: {what} modes: expected {len(expected['modes'])}, got {len(got.modes)}")
    for mode, wanted in zip(got.modes, expected["modes"]):
        same(f"{what} mode", [mode.probability], floats([wanted["probability"]]))
        same(f"{what} mode", mode.part_from_sensor.as_tuple(), floats(wanted["part_from_sensor"]))
        same(f"{what} mode", mode.covariance.ravel(), floats(wanted["covariance"]))


def config(model, expected):
    """The same settings, given one by one as a user gives them."""
    if expected["name"] == "paper":
        return tf.EpisodeConfig.paper(**expected["settings"])
    return tf.EpisodeConfig.of(model, **expected["settings"])


def play(folder, model, sensor, expected):
    bank = tf.Bank.load(folder / expected["bank"], model)
    reach = np.array([floats(motion) for motion in expected["reach"]])
    settings, episode = config(model, expected), None
    for n, touch in enumerate(expected["touches"]):
        what = f"{expected['name']}, touch {n + 1}:"
        observation = sensor.observe(np.load(folder / touch["frame"]))
        same(f"{what} query", observation.query, np.array(touch["query"], np.uint32).view(np.float32))
        same(f"{what} edge share", [np.float32(observation.edge_share)], np.array([touch["edge_share"]], np.uint32).view(np.float32))
        if episode is None:
            episode = tf.Episode.begin(settings, bank, observation)
        else:
            episode.observe(pose(touch["moved"]), observation)
        belief = episode.belief()
        same(f"{what} belief", belief.probabilities, np.load(folder / touch["belief"]))
        same(f"{what} class posterior", episode.class_posterior(), floats(touch["class_posterior"]))
        same(f"{what} class posterior", belief.class_posterior, floats(touch["class_posterior"]))
        same_estimate(f"{what} estimate", episode.estimate(), touch["estimate"])
        decision = episode.decide(reach)
        if isinstance(decision, tf.Touch):
            same(f"{what} motion", decision.motion.as_tuple(), floats(touch["decision"]["motion"]))
            assert episode.decide([tuple(motion) for motion in reach]) == decision
        else:
            assert decision.reason == touch["decision"]["reason"], (decision, touch["decision"])
            same_estimate(f"{what} decision", decision.estimate, touch["decision"]["estimate"])
    record = episode.record()
    assert json.loads(record) == json.loads(expected["record"]), what
    again = tf.Episode.restore(expected["record"], bank)
    same(f"{what} restored", again.belief().probabilities, episode.belief().probabilities)
    assert again.estimate() == episode.estimate() and again.record() == record
    assert episode.felt_map() is None, what
    return len(expected["touches"])


def main(folder):
    with open(folder / "expected.json") as file:
        written = json.load(file)
    model = tf.Model.load(written["model"])
    sensor = tf.Sensor(model, np.load(folder / "rest.npy"))
    n_touches = sum(play(folder, model, sensor, episode) for episode in written["episodes"])
    print(f"bits: {len(written['episodes'])} episodes of {n_touches} touches, every number as in Rust")


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(Path(sys.argv[1]))
