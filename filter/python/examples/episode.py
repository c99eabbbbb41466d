"""Finds by touch which letter of the alphabet a hole is for. Robot and camera are simulated.

    python examples/episode.py
"""

from pathlib import Path

import numpy as np
import tactile_filter as tf

model = tf.Model.load(Path(__file__).parents[3] / "infer/models/maze-small.safetensors")
simulator = tf.Simulator("alphabet-small")
bank = simulator.bank(model)  # once, at the desk: `tactile-infer bank` writes a file for Bank.load
sensor = tf.Sensor(model, simulator.rest_frame())
places = np.arange(-8.0, 9.0, 2.0)  # the robot reaches 8 mm along x and along y, mm
reach = np.array([(x, y, 0.0) for x in places for y in places])

truth, pose = "G", tf.Pose.from_degrees(3.0, -2.0, 20.0)  # where the sensor really is: the robot does not know
episode = tf.Episode.begin(tf.EpisodeConfig.of(model), bank, sensor.observe(simulator.touch(truth, pose)))
moved = tf.Pose()  # since the last touch that was taken in
while isinstance(decision := episode.decide(reach), tf.Touch):
    pose = pose * decision.motion  # a robot moves and touches here
    moved = moved * decision.motion  # the motion really made
    try:
        episode.observe(moved, sensor.observe(simulator.touch(truth, pose, n=episode.n_touches)))
        moved = tf.Pose()
    except (tf.FrameError, tf.FrozenFrameError) as error:
        print(error)
found = decision.estimate
print(f"{decision.reason} after {found.n_touches} touches: {100 * found.probability:.1f} % sure")
print(f"part {found.part} at {found.part_from_sensor}; it is {truth} at {pose}")
