"""Threads, memory and time.

    python tests/load.py FOLDER        (of the same folder as bits.py)

Fails where threads change a number or memory grows; times are printed, not judged.
"""

import gc
import json
import resource
import sys
import threading
import time
from pathlib import Path

import numpy as np
import tactile_filter as tf


def rss_kib():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * resource.getpagesize() // 1024


def play(sensor, bank, config, frames, reach):
    """An episode over recorded frames; its record and the last belief."""
    episode = tf.Episode.begin(config, bank, sensor.observe(frames[0]))
    for frame in frames[1:]:
        episode.decide(reach)
        episode.observe((2.0, -1.0, 0.1), sensor.observe(frame))
    return episode.record(), episode.belief().probabilities.tobytes()


def threads(sensor, bank, config, frames, reach):
    expected = play(sensor, bank, config, frames, reach)
    got = []

    def work():
        got.extend(play(sensor, bank, config, frames, reach) for _ in range(5))

    workers = [threading.Thread(target=work) for _ in range(2)]
    for thread in workers:
        thread.start()
    for thread in workers:
        thread.join()
    assert len(got) == 10 and all(one == expected for one in got), "threads changed a number"

    # While one thread computes, this one runs: a call that kept Python's lock would let it run before and after only.
    episode = tf.Episode.begin(config, bank, sensor.observe(frames[0]))
    many = np.vstack([reach + [0.001 * n, 0.0, 0.0] for n in range(60)])
    state, n_turns = [], 0

    def long_call():
        state.append("computing")
        episode.decide(many)
        state.append("done")

    thread = threading.Thread(target=long_call)
    thread.start()
    while len(state) < 2:
        n_turns += len(state)
        time.sleep(0.0001)
    thread.join()
    assert n_turns >= 10, f"this thread ran {n_turns} times while another computed"

    # One episode shared by threads: each touch is taken in whole, whatever the order.
    shared = tf.Episode.begin(config, bank, sensor.observe(frames[0]))
    touch = sensor.observe(frames[1])

    def touch_it():
        for _ in range(10):
            shared.observe((0.0, 0.0, 0.0), touch)
            shared.decide(reach)
            shared.belief()
            repr(shared)

    workers = [threading.Thread(target=touch_it) for _ in range(4)]
    for thread in workers:
        thread.start()
    for thread in workers:
        thread.join()
    assert shared.n_touches == 41, shared
    print("threads: two episodes in parallel and one shared by four, every number as in one thread")


def leaks(sensor, bank, config, frames, reach):
    """Memory before and after each kind of call, many times."""
    episode = tf.Episode.begin(config, bank, sensor.observe(frames[0]))
    fortran, few = np.asfortranarray(frames[0]), reach[:9]
    wrong = frames[0].astype(np.float32)

    def fail():
        for call in [lambda: sensor.observe(wrong), lambda: sensor.observe(frames[0] * 0), lambda: episode.decide([])]:
            try:
                call()
            except (TypeError, tf.Error):
                pass

    def whole():
        short = tf.Episode.begin(config, bank, sensor.observe(frames[0]))
        short.observe((1.0, 0.0, 0.0), sensor.observe(frames[1]))

    calls = {
        "Sensor.observe": (10_000, lambda: sensor.observe(frames[0])),
        "Sensor.observe, strided": (10_000, lambda: sensor.observe(fortran)),
        "three errors": (10_000, fail),
        "EpisodeConfig": (10_000, lambda: config.replace(seed=3).settings),
        "decide": (2_000, lambda: episode.decide(few)),
        "belief as arrays": (2_000, lambda: (episode.belief().probabilities, episode.belief().poses)),
        "estimate": (2_000, lambda: (episode.estimate().modes, episode.estimate().covariance)),
        "begin and observe": (500, whole),
    }
    for name, (n, call) in calls.items():
        for _ in range(n // 10):
            call()
        gc.collect()
        before = rss_kib()
        for _ in range(n):
            call()
        gc.collect()
        after = rss_kib()
        print(f"memory: {n} x {name}: {before} KiB before, {after} KiB after")
        # A leak of one small object a call would be 0.5 MiB and more.
        assert after - before < 512, f"{name} leaks"


def times(sensor, bank, config, frames, reach, rust_us):
    """Microseconds of one touch: observe a frame, take it in, decide; the least of many, as Rust measured them."""
    took = []
    moved = tf.Pose(3.0, 1.0, 0.2).inverse() * tf.Pose(2.0, 1.0, 0.2)
    for _ in range(101):
        episode = tf.Episode.begin(config, bank, sensor.observe(frames[0]))
        start = time.perf_counter()
        episode.observe(moved, sensor.observe(frames[1]))
        episode.decide(reach)
        took.append(1e6 * (time.perf_counter() - start))
    print(f"time: observe and decide: {min(took):.0f} us in Python, {rust_us:.0f} us in Rust")
    pose = tf.Pose(1.0, 2.0, 3.0)
    start = time.perf_counter()
    for _ in range(100_000):
        pose.x_mm
    print(f"time: a property: {1e9 * (time.perf_counter() - start) / 100_000:.0f} ns")


def main(folder):
    with open(folder / "expected.json") as file:
        written = json.load(file)
    model = tf.Model.load(written["model"])
    sensor = tf.Sensor(model, np.load(folder / "rest.npy"))
    frames = [np.load(folder / touch["frame"]) for touch in written["episodes"][0]["touches"]]
    bank = tf.Bank.load(folder / "fine.bank", model)
    reach = np.array([np.array(motion, np.uint64).view(np.float64) for motion in written["episodes"][0]["reach"]])
    config = tf.EpisodeConfig.of(model, seed=3)
    # As many of them as four touches, whatever the episode was.
    frames = (4 * frames)[:4] if len(frames) < 4 else frames[:4]
    threads(sensor, bank, config, frames, reach)
    timed = [np.load(folder / f"time-{n}.npy") for n in range(2)]
    times(sensor, bank, config, timed, reach, written["rust_us"])
    leaks(sensor, bank, config, frames, reach)


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(Path(sys.argv[1]))
