"""Wrong input of every kind: each gives the exception that it should, and an episode stays as it was.

    python tests/hostile.py FOLDER        (of the same folder as bits.py)
"""

import json
import pickle
import sys
import tempfile
from pathlib import Path

import numpy as np
import tactile_filter as tf

N_CHECKED = 0


def refused(kind, words, call, *arguments, **named):
    """The call raises exactly this exception, whose text has all these words, in any case."""
    global N_CHECKED
    N_CHECKED += 1
    try:
        got = call(*arguments, **named)
    except BaseException as error:
        text = str(error)
        if type(error) is not kind or not all(word in text.lower() for word in words.lower().split()):
            sys.exit(f"error: expected {kind.__name__} with '{words}', got {type(error).__name__}: {text}")
        return error
    sys.exit(f"error: expected {kind.__name__} with '{words}', got {got!r}")


def frames(sensor, touch):
    plain = sensor.observe(touch)
    height, width, _ = touch.shape
    # The same picture in other layouts.
    read_only = touch.copy()
    read_only.flags.writeable = False
    wide = np.zeros((height, 2 * width, 3), np.uint8)
    wide[:, ::2] = touch
    four = np.dstack([touch, touch[:, :, :1]])
    odd = np.frombuffer(b"x" + touch.tobytes(), np.uint8, offset=1).reshape(touch.shape)
    same = [
        np.asfortranarray(touch), read_only, wide[:, ::2], four[:, :, :3], odd,
        touch[::-1].copy()[::-1], touch[:, ::-1].copy()[:, ::-1], np.ma.array(touch), touch.view(np.ndarray),
    ]  # fmt: skip
    for n, layout in enumerate(same):
        assert sensor.observe(layout) == plain, f"layout {n}"
    # Red and blue in the other order are another picture, given with or without a copy.
    swapped = sensor.observe(touch[:, :, ::-1])
    assert swapped == sensor.observe(touch[:, :, ::-1].copy()) and swapped != plain

    wanted = "frame expected uint8 [height, width, 3] got"
    for wrong, got in [
        (None, "NoneType"), (7, "int"), ("frame", "str"), (b"frame", "bytes"), (touch.tolist(), "list"),
        (touch.astype(np.float64), "float64"), (touch.astype(np.float32) / 255, "float32"),
        (touch.astype(np.int8), "int8"), (touch.astype(np.uint16), "uint16"), (touch > 9, "bool"),
        (touch.astype(object), "object"), (touch[:, :, 0], "uint8"), (touch[None], "uint8"), (four, "uint8"),
        (touch[:, :, :2], "uint8"), (touch.transpose(2, 0, 1), "uint8"), (np.zeros(0, np.uint8), "uint8"),
        (np.full(touch.shape, np.nan), "float64"), (np.uint8(3), ""), (np.array(3, np.uint8), "uint8"),
    ]:  # fmt: skip
        refused(TypeError, f"{wanted} {got}", sensor.observe, wrong)
        refused(TypeError, f"{wanted} {got}", tf.Sensor, sensor.model, wrong)
    size = f"{width}x{height}"
    for shape in [(0, 0, 3), (0, width, 3), (height, width + 1, 3), (width, height, 3), (1, 1, 3)]:
        error = refused(tf.FrameError, f"frame {size} {shape[1]}x{shape[0]}", sensor.observe, np.zeros(shape, np.uint8))
        assert error.fault == "wrong-size" and isinstance(error, tf.Error)
    # Thirty gigabytes and more that numpy did not allocate: refused before anything is copied.
    for side in [100_000, 2**31, 2**40]:
        huge = np.broadcast_to(np.uint8(100), (side, 2_000, 3))
        refused(tf.FrameError, "frame pixels", sensor.observe, huge)
        refused(ValueError, "frame at most pixels", tf.Sensor, sensor.model, huge)
    for level, fault in [(3, "dark"), (250, "saturated"), (128, "uniform")]:
        error = refused(tf.FrameError, f"frame {fault}", sensor.observe, np.full(touch.shape, level, np.uint8))
        assert error.fault == fault, error.fault
        error = refused(tf.FrameError, fault, tf.Sensor, sensor.model, np.full(touch.shape, level, np.uint8))
        assert error.fault == fault, error.fault
    refused(tf.InvalidError, "no-contact frame pixels", tf.Sensor, sensor.model, touch[:5, :5])
    refused(tf.InvalidError, "frame", tf.Sensor, sensor.model, touch[:0])
    # What came out is a copy: writing to it changes nothing.
    plain.query[:] = 0
    assert plain == sensor.observe(touch)
    return plain


def reaches(episode, reach):
    decision = episode.decide(reach)
    assert isinstance(decision, tf.Touch), decision
    spread = np.zeros((len(reach), 7))
    spread[:, 1:7:2] = reach
    odd = np.frombuffer(b"x" + reach.tobytes(), np.float64, offset=1).reshape(reach.shape)
    read_only = reach.copy()
    read_only.flags.writeable = False
    for same in [np.asfortranarray(reach), spread[:, 1:7:2], odd, read_only, reach.tolist(), [*map(tuple, reach)],
                 [tf.Pose(*motion) for motion in reach], [*reach], tuple(map(tuple, reach))]:  # fmt: skip
        assert episode.decide(same) == decision
    assert episode.decide(reach, None) == decision and episode.decide(reach, time_limit_s=60) == decision
    some = np.vstack([[np.nan, 0, 0], reach, [0, np.inf, 0]])
    assert episode.decide(some) == decision
    for wrong, got in [
        (None, "NoneType"), (3, "int"), (reach.astype(int), "int64"), (reach.astype(np.float32), "float32"),
        (reach.astype(">f8"), "f8"), (reach[:, :2], "float64"), (reach[0], "float64"), (reach[None], "float64"),
        (np.float64(3), ""), (iter(reach), "iterator"),
    ]:  # fmt: skip
        refused(TypeError, f"reach float64 [n, 3] got {got}", episode.decide, wrong)
    for wrong in ["abc", [(1, 2)], [None], [(1, 2, "x")], [(1, 2, 3, 4)], {"a": 1}]:
        refused(TypeError, "pose expected", episode.decide, wrong)
    for empty in [[], (), np.zeros((0, 3)), np.full((5, 3), np.nan), [(np.inf, 0, 0)]]:
        refused(tf.EmptyReachError, "reach", episode.decide, empty)
    refused(ValueError, "reach at most motions", episode.decide, np.broadcast_to(np.zeros(3), (10**12, 3)))
    for wrong in [-1.0, np.nan, np.inf]:
        refused(ValueError, "time_limit_s", episode.decide, reach, time_limit_s=wrong)
    return decision


def motions(episode, observation, other):
    before = episode.record()
    for wrong in [(np.nan, 0, 0), (0, np.inf, 0), (0, 0, -np.inf), (2e6, 0, 0)]:
        refused(tf.MotionError, "motion", episode.observe, wrong, other)
    for wrong in [None, 3, "abc", (1, 2), (1, 2, 3, 4), ("a", "b", "c"), [], np.zeros((3, 3)), {}]:
        refused(TypeError, "pose expected", episode.observe, wrong, other)
    refused(tf.FrozenFrameError, "frame", episode.observe, (1.0, 0, 0), observation)
    other_side = tf.Observation(observation.query, 0.2, "peg")
    refused(tf.WrongSideError, "touch hole peg", episode.observe, (1.0, 0, 0), other_side)
    refused(tf.ConfigError, "side hole peg", tf.Observation, observation.query, 0.2, "pin")
    for wrong in [None, other.query, "touch"]:
        refused(TypeError, "observation", episode.observe, (0, 0, 0), wrong)
    dim = len(other.query)
    bad = [np.full(dim, np.nan), np.zeros(dim), np.ones(dim + 1), np.zeros(0), np.full(dim, np.inf)]
    for query in bad[:1] + bad[2:]:
        refused(tf.ObservationError, "touch", episode.observe, (0, 0, 0), tf.Observation(query.astype(np.float32), 0.2))
    for share in [np.nan, -0.1, 1.1]:
        refused(tf.ObservationError, "touch", episode.observe, (0, 0, 0), tf.Observation(other.query, share))
    refused(TypeError, "query float32", tf.Observation, other.query.astype(np.float64), 0.2)
    refused(TypeError, "query float32", tf.Observation, None, 0.2)
    assert episode.record() == before, "a refused touch changed the episode"


def settings(model):
    for name, value, words in [
        ("max_touches", -1, "whole number, not negative -1"), ("max_touches", 0, "1 to 1000 0"),
        ("max_touches", 2.5, "whole number 2.5"), ("max_touches", 2**64, "whole number"), ("seed", "one", "number str"),
        ("stop_probability", 1.5, "0..=1 1.5"), ("stop_probability", np.nan, "0..=1 NaN"), ("seed", None, "whole number"),
        ("travel_nats_per_mm", np.inf, "not negative inf"), ("max_touchs", 3, "one of max_touches another name"),
        ("seed", True, "number bool"), ("seed", [1], "list"), ("temperature", 0.1, "one of"), ("stop_place_mm", 0, "positive none"),
    ]:  # fmt: skip
        for make in [tf.EpisodeConfig, tf.EpisodeConfig.paper, tf.EpisodeConfig.of(model).replace]:
            refused(tf.ConfigError, f"{name} expected {words}", make, **{name: value})
    refused(TypeError, "", tf.EpisodeConfig, 3)
    refused(TypeError, "model", tf.EpisodeConfig.of, None)
    config = tf.EpisodeConfig.of(model, seed=np.int64(3), stop_place_mm=np.float64(0.1), false_accept=None)
    changed = config.settings
    assert (changed["seed"], changed["stop_place_mm"], changed["false_accept"], changed["stop_probability"]) == (3, 0.1, None, 0.95)
    assert tf.EpisodeConfig.of(model, **changed) == config and tf.EpisodeConfig(**changed) != config
    plain = tf.EpisodeConfig(stop_probability=1, seed=2**64 - 1)
    assert isinstance(plain.settings["stop_probability"], float) and eval(f"tf.{plain!r}") == plain
    with open(Path(tf.__file__).with_name("__init__.pyi")) as types:
        declared = types.read().split("class _Settings", 1)[1].split("class Error", 1)[0]
    assert all(f"    {name}: " in declared for name in changed) and declared.count(": ") == len(changed)


def files(model, bank_path, episode, folder):
    for load in [tf.Model.load, lambda path: tf.Bank.load(path, model)]:
        refused(tf.FileError, "nowhere.file", load, folder / "nowhere.file")
        refused(tf.FileError, "", load, folder)
        refused(TypeError, "", load, None)
        refused(TypeError, "", load, 3)
        for name, content in [("empty", b""), ("text", b"not a model"), ("short", bank_path.read_bytes()[:5000])]:
            (folder / name).write_bytes(content)
            refused(tf.InvalidError, name, load, folder / name)
    damaged = bytearray(bank_path.read_bytes())
    damaged[-9] ^= 1
    (folder / "damaged").write_bytes(damaged)
    refused(tf.InvalidError, "damaged", tf.Bank.load, folder / "damaged", model)
    refused(tf.InvalidError, "bank", tf.Model.load, bank_path)
    refused(TypeError, "model", tf.Bank.load, bank_path, None)
    refused(tf.FileError, "", episode.bank.save, folder / "text" / "bank")
    episode.bank.save(folder / "copy")
    assert tf.Bank.load(str(folder / "copy"), model).sha256 == episode.bank.sha256


def records(episode, bank, other_bank):
    record = json.loads(episode.record())
    for wrong in ["", "{}", "[]", "null", "x" * 1000, '{"version": 1}', "[" * 100_000]:
        refused(tf.InvalidError, "saved episode", tf.Episode.restore, wrong, bank)
    for wrong in [None, record, 3, b"{}"]:
        refused(TypeError, "str", tf.Episode.restore, wrong, bank)
    refused(tf.WrongBankError, "saved episode version", tf.Episode.restore, json.dumps(record | {"version": 1}), bank)
    refused(tf.WrongBankError, "saved episode bank", tf.Episode.restore, json.dumps(record), other_bank)
    refused(tf.WrongBankError, "saved episode touch", tf.Episode.restore, json.dumps(record | {"touches": []}), bank)
    config = record["config"] | {"settings": {"max_touches": 0}}
    refused(tf.ConfigError, "max_touches", tf.Episode.restore, json.dumps(record | {"config": config}), bank)


def starts(model, bank, observation):
    config = tf.EpisodeConfig.of(model)
    covariance = np.diag([4.0, 4.0, 0.01]).tolist()
    for wrong in [[[-1.0] * 3] * 3, [[np.nan] * 3] * 3]:
        known = config.with_start((0.0, 0.0, 0.0), wrong)
        refused(tf.ConfigError, "start covariance", tf.Episode.begin, known, bank, observation)
    far = config.with_start((1e4, 0.0, 0.0), covariance)
    refused(tf.ConfigError, "start pose within", tf.Episode.begin, far, bank, observation)
    for wrong in [None, 3, "covariance", [1.0, 2.0, 3.0], [[1.0, 0.0], [0.0, 1.0]]]:
        refused(TypeError, "covariance three rows", config.with_start, (0.0, 0.0, 0.0), wrong)
    assert far.without_start() == config and far != config
    seen = config.with_part((10.0, 0.0, 0.0), covariance, (11.0, 0.0, 0.0))
    known = tf.Episode.begin(seen, bank, observation)
    assert known.estimate() != tf.Episode.begin(config, bank, observation).estimate()


def searches(episode):
    before = episode.record()
    for name, value in [("play_mm", 0.0), ("radius_mm", np.nan), ("covariance", [[-1e9, 0, 0]] * 3)]:
        wanted = "above zero" if name != "covariance" else "covariance"
        refused(tf.ConfigError, wanted, episode.search, **({"play_mm": 0.5, "radius_mm": 9.0} | {name: value}))
    refused(TypeError, "", episode.search, "wide", 9.0)
    refused(TypeError, "search", episode.did_not_fit, None)
    assert episode.record() == before
    search = episode.search(0.5, 9.0, episode.estimate().offset_covariance.tolist(), most=7)
    assert search.offsets.dtype == np.float64 and search.offsets.shape[0] <= 7 and not search.offsets[0].any()
    assert 0.0 < search.covered < 1.0
    tried = tf.Episode.restore(before, episode.bank)
    tried.did_not_fit(search)
    part = episode.bank.parts.index(episode.estimate().part)
    assert tried.class_posterior()[part] <= episode.class_posterior()[part]
    assert tf.Episode.restore(tried.record(), episode.bank).estimate() == tried.estimate()


def values(episode, decision):
    """What comes out cannot be changed, and says what it is."""
    estimate, belief = episode.estimate(), episode.belief()
    other = estimate.runner_up
    for made, name in [
        (estimate, "part"), (other, "part"), (decision, "motion"), (episode, "bank"), (belief, "parts"),
        (tf.Pose(), "x_mm"),
    ]:  # fmt: skip
        refused(AttributeError, "", setattr, made, name, None)
        refused(AttributeError, "", setattr, made, "new_name", None)
        assert len(repr(made)) > 10
        refused(TypeError, "", type, "Derived", (type(made),), {})
    belief.probabilities[:] = 0
    assert abs(belief.probabilities.sum() - 1) < 1e-9 and abs(estimate.class_posterior.sum() - 1) < 1e-9
    assert belief.probabilities.shape == (len(belief.parts), len(belief.poses)) and len(belief.poses) == np.prod(belief.shape)
    assert belief.poses.shape[1] == 3 and (np.diff(belief.poses[: belief.shape[2], 2]) > 0).all()
    for class_ in [tf.Episode, tf.Model, tf.Bank, tf.Estimate, tf.Touch, tf.Done, tf.Belief, tf.Mode, tf.RunnerUp]:
        refused(TypeError, "", class_)
    second = np.argsort(estimate.class_posterior)[-2]
    assert (other.part, other.probability) == (belief.parts[second], estimate.class_posterior[second]), other
    assert other == episode.estimate().runner_up and other != estimate
    # The parts' rows sum to the parts' probabilities: numpy's sum against Rust's.
    assert np.allclose(belief.probabilities.sum(axis=1), belief.class_posterior, rtol=0, atol=1e-12)
    pose = tf.Pose(1.0, -2.0, 0.5)
    here = pose * pose.inverse()
    assert max(map(abs, here.as_tuple())) < 1e-12 and pose * (0, 0, 0) == pose and pose != (1.0, -2.0, 0.5)
    assert np.allclose(pose.apply(1.0, 0.0), (1 + np.cos(0.5), -2 + np.sin(0.5)))
    assert eval(f"tf.{pose!r}") == pose and tf.Pose.from_degrees(theta_deg=540).theta_deg == 180
    refused(TypeError, "", lambda: pose * None)
    refused(TypeError, "", tf.Pose, "a")
    refused(KeyError, "part", episode.bank.twins, "no such part", pose)
    assert episode.bank.twins(estimate.part, pose)[0] == pose
    refused(TypeError, "pickle", pickle.dumps, episode)
    for error in vars(tf).values():
        if isinstance(error, type) and issubclass(error, Exception):
            assert issubclass(error, tf.Error) and error.__module__ == "tactile_filter" and error.__doc__, error


def simulators(model):
    simulator = tf.Simulator("alphabet-small", 1)
    part = simulator.parts[0]
    refused(tf.InvalidError, "no-such-scene", tf.Simulator, "no-such-scene")
    refused(TypeError, "", tf.Simulator, None)
    refused(KeyError, "part expected", simulator.touch, "no such part", tf.Pose())
    refused(TypeError, "pose expected", simulator.touch, part, None)
    refused(tf.InvalidError, "finite pose", simulator.touch, part, (np.nan, 0, 0))
    for steps in [(0.0, 15.0), (2.0, -1.0), (3.0, 15.0), (np.nan, 15.0), (2.0, np.inf), (1e-9, 1e-9)]:
        refused(tf.InvalidError, "expected", simulator.bank, model, *steps)
    frame = simulator.touch(part, tf.Pose(1.0), n=3)
    assert (frame == simulator.touch(part, (1.0, 0.0, 0.0), n=3)).all() and frame.dtype == np.uint8
    assert (frame != simulator.touch(part, (1.0, 0.0, 0.0), n=4)).any() and frame.shape == simulator.rest_frame().shape


def main(folder):
    with open(folder / "expected.json") as file:
        written = json.load(file)
    model = tf.Model.load(written["model"])
    sensor = tf.Sensor(model, np.load(folder / "rest.npy"))
    touches = [np.load(folder / touch["frame"]) for touch in written["episodes"][0]["touches"][:2]]
    observation, other = frames(sensor, touches[0]), sensor.observe(touches[1])
    bank, other_bank = (tf.Bank.load(folder / name, model) for name in ["fine.bank", "coarse.bank"])
    episode = tf.Episode.begin(tf.EpisodeConfig.of(model), bank, observation)
    places = np.arange(-6.0, 7.0, 3.0)
    decision = reaches(episode, np.array([(x, y, 0.0) for x in places for y in places]))
    motions(episode, observation, other)
    settings(model)
    with tempfile.TemporaryDirectory() as scratch:
        files(model, folder / "fine.bank", episode, Path(scratch))
    records(episode, bank, other_bank)
    starts(model, bank, observation)
    searches(episode)
    values(episode, decision)
    if hasattr(tf, "Simulator"):
        simulators(model)
    refused(TypeError, "", tf.Episode.begin, None, bank, observation)
    refused(TypeError, "", tf.Episode.begin, tf.EpisodeConfig(), None, observation)
    refused(TypeError, "", tf.Episode.begin, tf.EpisodeConfig(), bank, None)
    refused(TypeError, "", tf.Sensor, None, touches[0])
    print(f"hostile: {N_CHECKED} wrong inputs refused as they should be")


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(Path(sys.argv[1]))
