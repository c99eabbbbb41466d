"""Tests without a sensor: `python tests/test_camera.py`, or pytest. Videos take the sensor's place."""

import inspect
import sys
import tempfile
import threading
import time
import unittest
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from unittest.mock import patch

sys.path.insert(0, str(Path(__file__).parent))
import record  # first: it keeps LeRobot off the network

import cv2
import draccus
import numpy as np
from lerobot.cameras import CameraConfig, make_cameras_from_configs
from lerobot.datasets.lerobot_dataset import LeRobotDataset
from lerobot.scripts import lerobot_record
from lerobot.utils.import_utils import register_third_party_plugins
from lerobot_camera_gelsight_mini import Device, GelSightMini, GelSightMiniConfig, devices

FULL_PX = (3280, 2464)
LEFT = "GelSight Mini R0B 2BNK-CE0U: Ge"
RIGHT = "GelSight Mini R0B 2BG8-0H3X: Ge"


def camera(**settings):
    return GelSightMini(GelSightMiniConfig(**settings))


def shares(n_from, n_to):
    """What each pixel has in each larger one, `[n_to, n_from]`: lengths of overlap, in exact arithmetic."""
    at = np.arange(n_from) * n_to
    begin, end = np.arange(n_to)[:, None] * n_from, (np.arange(n_to)[:, None] + 1) * n_from
    return np.clip(np.minimum(at + n_to, end) - np.maximum(at, begin), 0, None) / n_from


def expected_picture(bgr, size, border=7):
    """The picture that comes out, not rounded: RGB, without 1/border at each side, means over areas."""
    left, top = bgr.shape[1] // border, bgr.shape[0] // border
    rgb = bgr[top : bgr.shape[0] - top, left : bgr.shape[1] - left, ::-1].astype(float)
    rows, columns = shares(rgb.shape[0], size[1]), shares(rgb.shape[1], size[0])
    return columns @ np.tensordot(rows, rgb, axes=1)  # [y, w, c], then [y, x, c]


class Tests(unittest.TestCase):
    def setUp(self):
        scratch = tempfile.TemporaryDirectory()
        self.addCleanup(scratch.cleanup)
        self.folder = Path(scratch.name)

    def video(self, pictures, fps=25):
        return record.write_video(self.folder / "touch.avi", pictures, fps)

    def assert_is(self, got, expected, what=""):
        """Equal but for rounding to counts; OpenCV leaves out overlaps below a thousandth of a pixel."""
        self.assertEqual((got.dtype, got.shape), (np.uint8, expected.shape), what)
        self.assertLessEqual(np.abs(got - expected).max(), 0.51, what)

    @contextmanager
    def connected(self, *nodes):
        """A /sys with these nodes: number, name and index."""
        for number, name, index in nodes:
            folder = self.folder / "sys" / f"video{number}"
            folder.mkdir(parents=True)
            (folder / "name").write_text(name + "\n")
            (folder / "index").write_text(f"{index}\n")
        with patch.object(devices, "VIDEO_DEVICES", self.folder / "sys"):
            yield


class Pictures(Tests):
    def test_each_is_cropped_and_reduced_as_numpy_does_it(self):
        pictures = record.touches(7)
        with camera(index_or_path=self.video(pictures), fps=10) as mini:
            got = [mini.read_latest()] + [mini.read() for _ in pictures[1:]]
        for i, (one, picture) in enumerate(zip(got, pictures, strict=True)):
            self.assert_is(one, expected_picture(picture, (320, 240)), f"picture {i}")

    def test_rotation_turns_what_was_cropped_and_width_is_what_comes_out(self):
        pictures = record.touches(3)
        whole = expected_picture(pictures[0], (320, 240))
        upright, turned = (320, 240), (240, 320)
        for rotation, size, turns in ((0, upright, 0), (90, turned, 3), (180, upright, 2), (-90, turned, 1)):
            settings = {"rotation": rotation, "width": size[0], "height": size[1]}
            with camera(index_or_path=self.video(pictures), **settings) as mini:
                self.assert_is(mini.async_read(2000), np.rot90(whole, turns), str(rotation))

    def test_bgr_and_no_border_are_as_asked_for(self):
        pictures = record.touches(3)
        settings = {"border": 0, "color_mode": "bgr", "width": 656, "height": 492}
        with camera(index_or_path=self.video(pictures), **settings) as mini:
            self.assertTrue(np.array_equal(mini.async_read(2000), pictures[0]))

    def test_a_border_is_rounded_down_as_the_project_does_it(self):
        from lerobot_camera_gelsight_mini.gelsight_mini import _border_px

        # The sizes of the Rust test of `Crop::Border`.
        for side, border in ((320, 45), (240, 34), (245, 35), (7, 1), (6, 0), (3280, 468), (2464, 352)):
            self.assertEqual(_border_px(side, 1 / 7), border)

    def test_a_picture_is_never_enlarged(self):
        with self.assertRaisesRegex(ValueError, "at most 230x172, which border=0.1429 leaves of 320x240, got 320x240"):
            camera(index_or_path=self.video(record.touches(2, (320, 240)))).connect()


class Stalls(Tests):
    def test_a_picture_that_comes_again_is_not_new(self):
        a, b, c = record.touches(3)
        with camera(index_or_path=self.video([a, a, b, b, b, c]), fps=8, stall_ms=2000) as mini:
            got = [mini.async_read(2000) for _ in range(3)]
        for one, picture in zip(got, (a, b, c), strict=True):
            self.assert_is(one, expected_picture(picture, (320, 240)))

    def test_a_camera_that_stalls_is_an_error_of_each_read(self):
        moving = record.touches(3)
        with camera(index_or_path=self.video(moving + moving[-1:] * 20), fps=10, stall_ms=200) as mini:
            for _ in moving:
                mini.async_read(2000)
            began = time.monotonic()
            with self.assertRaisesRegex(RuntimeError, "has stalled: the same picture for more than 200 ms"):
                mini.read()
            self.assertLess(time.monotonic() - began, 1)
            for read in (mini.read, mini.async_read, mini.read_latest):
                self.assertRaisesRegex(RuntimeError, "has stalled", read)
            mini.disconnect()
            mini.connect()
            self.assert_is(mini.async_read(2000), expected_picture(moving[0], (320, 240)), "after connecting again")

    def test_the_latest_picture_is_never_older_than_a_stall(self):
        moving = record.touches(2)
        with camera(index_or_path=self.video(moving + moving[-1:] * 60), stall_ms=300) as mini:
            began = time.monotonic()
            with self.assertRaises((RuntimeError, TimeoutError)):
                while time.monotonic() < began + 2:
                    mini.read_latest(max_age_ms=10_000)
                    time.sleep(0.01)
            self.assertLess(time.monotonic() - began, 1)

    def test_a_video_that_ends_is_an_error_that_says_so(self):
        with camera(index_or_path=self.video(record.touches(2)), fps=5) as mini:
            mini.async_read(2000)
            mini.async_read(2000)
            for read in (mini.read, mini.async_read, mini.read_latest):
                self.assertRaisesRegex(RuntimeError, r"GelSightMini\(.*touch.avi\): the video has ended", read)


class Sensors(Tests):
    WEBCAM = (0, "Integrated Webcam: Integrated W", 0)
    ONE = ((2, LEFT, 0), (3, LEFT, 1))
    TWO = ((10, RIGHT, 0), (11, RIGHT, 1))

    def test_minis_alone_are_found_and_only_the_node_with_pictures(self):
        with self.connected(*self.TWO, self.WEBCAM, *self.ONE):
            found = GelSightMini.find_cameras()
        self.assertEqual([one["id"] for one in found], ["/dev/video2", "/dev/video10"])
        self.assertEqual(found[0], {"name": LEFT, "type": "gelsight_mini", "id": "/dev/video2"})

    def test_one_is_taken_and_of_several_the_one_named(self):
        with self.connected(self.WEBCAM, *self.ONE):
            self.assertEqual(devices.choose(None), Device(LEFT, Path("/dev/video2")))
        with self.connected(*self.TWO):
            for part in (RIGHT, "2BG8-0H3X", "2bg80h3x", "GelSight Mini R0B 2BG8-0H3X"):
                self.assertEqual(devices.choose(part).path, Path("/dev/video10"), part)

    def test_several_of_a_name_are_listed(self):
        with self.connected(*self.ONE, *self.TWO):
            for part in (None, "R0B"):
                with self.assertRaises(ConnectionError) as refused:
                    camera(sensor=part).connect()
                for said in (LEFT, "/dev/video2", RIGHT, "/dev/video10"):
                    self.assertIn(said, str(refused.exception))

    def test_of_none_it_is_said_what_was_looked_for(self):
        with self.connected(self.WEBCAM):
            with self.assertRaisesRegex(ConnectionError, r"no GelSight Mini in .*/sys/\*/name; connected: none"):
                camera().connect()
        with self.connected(*self.ONE):
            with self.assertRaisesRegex(ConnectionError, "with '9999' in its name.*connected: .*2BNK-CE0U"):
                camera(sensor="9999").connect()

    def test_a_sensor_is_opened_at_its_own_size_and_unplugged(self):
        device = FakeDevice(record.touches(2, FULL_PX))
        with self.connected(self.WEBCAM, *self.ONE), device.plugged_in():
            mini = camera(warmup_s=0)
            mini.connect()
            self.assertEqual((str(mini), device.opened), ("GelSightMini(/dev/video2)", ("/dev/video2", cv2.CAP_V4L2)))
            self.assertEqual(device.asked, [(cv2.CAP_PROP_FPS, 25.0)])
            self.assert_is(mini.async_read(5000), expected_picture(device.pictures[0], (320, 240)))
            with patch.object(threading, "excepthook"), self.assertLogs(level="WARNING"):
                with self.assertRaisesRegex(RuntimeError, "gives no picture: is it unplugged"):
                    while True:
                        mini.async_read(2000)
            mini.disconnect()

    def test_a_size_that_the_device_does_not_have_is_refused(self):
        device = FakeDevice(record.touches(2))
        with self.connected(*self.ONE), device.plugged_in():
            mini = camera(capture_width=640, capture_height=480)
            with self.assertRaisesRegex(RuntimeError, "expected 656x492, which the device gives, got 640x480"):
                mini.connect()
            self.assertFalse(mini.is_connected)


class FakeDevice:
    """What `cv2.VideoCapture` gives of a sensor with one size and one rate, 25; after its pictures it is gone."""

    def __init__(self, pictures):
        self.pictures, self.asked = pictures, []

    def plugged_in(self):
        device, (height, width, _) = self, self.pictures[0].shape

        class VideoCapture:
            def __init__(self, path, backend):
                device.opened, self.left = (str(path), backend), list(device.pictures)

            def isOpened(self):
                return True

            def get(self, what):
                return {cv2.CAP_PROP_FRAME_WIDTH: width, cv2.CAP_PROP_FRAME_HEIGHT: height, cv2.CAP_PROP_FPS: 25}[what]

            def set(self, what, value):
                device.asked.append((what, value))
                return True  # as OpenCV does of a size that it did not get

            def read(self):
                time.sleep(0.04)
                return (True, self.left.pop(0)) if self.left else (False, None)

            def release(self):
                pass

        return patch.object(cv2, "VideoCapture", VideoCapture)


class Configs(Tests):
    def test_a_bad_value_is_named(self):
        for field_name, value in (
            ("width", 0), ("width", None), ("height", -1), ("height", 240.0), ("fps", 0), ("border", 0.5),
            ("border", -0.1), ("border", float("nan")), ("border", "1/7"), ("stall_ms", 0), ("warmup_s", -1),
            ("sensor", ""), ("sensor", " - "), ("index_or_path", -1), ("rotation", 45), ("color_mode", "gray"),
        ):  # fmt: skip
            with self.assertRaises(ValueError) as refused:
                GelSightMiniConfig(**{field_name: value})
            message = str(refused.exception)
            self.assertTrue(field_name in message and str(value) in message, message)
        with self.assertRaisesRegex(ValueError, "capture_height: expected width and height, or neither, got None"):
            GelSightMiniConfig(capture_width=640)
        with self.assertRaisesRegex(ValueError, "index_or_path: expected none, as the sensor is '2BNK', got '2'"):
            GelSightMiniConfig(sensor="2BNK", index_or_path="2")


class InLeRobot(Tests):
    def test_the_plugin_is_found_and_chosen_by_its_type(self):
        register_third_party_plugins()

        @dataclass
        class Robot:
            cameras: dict[str, CameraConfig] = field(default_factory=dict)

        text = "{tactile: {type: gelsight_mini, sensor: 2BNK-CE0U, border: 0.15, rotation: 90}, " \
               "video: {type: gelsight_mini, index_or_path: touch.avi}}"  # fmt: skip
        cameras = make_cameras_from_configs(draccus.parse(Robot, args=[f"--cameras={text}"]).cameras)
        tactile, video = cameras["tactile"], cameras["video"]
        self.assertIs(type(tactile), GelSightMini)
        self.assertEqual((tactile.width, tactile.height, tactile.fps), (320, 240, 25))
        self.assertEqual((tactile.mini.sensor, tactile.mini.border, tactile.rotation), ("2BNK-CE0U", 0.15, 0))
        self.assertEqual((video.mini.index_or_path, video.mini.border), (Path("touch.avi"), 1 / 7))

    def assert_has(self, folder, pictures, poses):
        """The dataset has these pictures, bit for bit."""
        dataset = LeRobotDataset("local/touches", root=folder)
        self.assertEqual(dataset.features[record.PICTURES]["dtype"], "image")
        self.assertEqual(list(dataset.features["observation.state"]["names"]), ["x", "y", "yaw"])
        self.assertEqual(len(dataset), len(pictures))
        for i, (picture, pose) in enumerate(zip(pictures, poses, strict=True)):
            item = dataset[i]
            got = (item[record.PICTURES].permute(1, 2, 0) * 255).round().byte().numpy()
            self.assertTrue(np.array_equal(got, picture), f"picture {i}")
            self.assertTrue(np.array_equal(item["observation.state"].numpy(), pose), f"pose {i}")

    def test_a_dataset_has_what_the_camera_gave(self):
        touches = record.touches(30)
        shown = [expected_picture(picture, (320, 240)) for picture in touches]
        pictures, poses = record.record(self.video(touches), self.folder / "set", 20)
        nearest = [
            int(np.argmin([np.abs(one[::8, ::8] - picture[::8, ::8]).mean() for one in shown])) for picture in pictures
        ]
        self.assertEqual(nearest, sorted(set(nearest)), "a picture came twice, or before another")
        for i, picture in zip(nearest, pictures, strict=True):
            self.assert_is(picture, shown[i], f"picture {i}")
        self.assert_has(self.folder / "set", pictures, poses)

    def test_lerobot_record_writes_the_pictures(self):
        import gantry  # noqa: F401

        features_of = lerobot_record.aggregate_pipeline_dataset_features

        def with_pictures(use_videos, **pipeline):
            """Before 0.6.0 LeRobot leaves out all pictures if it makes no video: huggingface/lerobot#3783."""
            if "exclude_images" in inspect.signature(features_of).parameters:
                return features_of(use_videos=use_videos, **pipeline)
            features = features_of(use_videos=True, **pipeline)
            return {
                name: {**feature, "dtype": "image"} if feature["dtype"] == "video" and not use_videos else feature
                for name, feature in features.items()
            }

        given, read_latest = [], GelSightMini.read_latest

        def noted(mini):
            given.append(read_latest(mini))
            return given[-1]

        camera_of = f"{{tactile: {{type: gelsight_mini, index_or_path: {self.video(record.touches(32))}}}}}"
        command = f"""lerobot-record --robot.type=gantry --robot.calibration_dir={self.folder} --teleop.type=slide
            --teleop.calibration_dir={self.folder} --dataset.repo_id=local/touches --dataset.root={self.folder}/set
            --dataset.video=false --dataset.fps=15 --dataset.episode_time_s=1 --dataset.num_episodes=1
            --dataset.single_task=touch --dataset.push_to_hub=false --play_sounds=false"""
        with (
            patch.object(sys, "argv", [*command.split(), f"--robot.cameras={camera_of}"]),
            patch.object(inspect, "getsource", side_effect=OSError),  # for --help all settings' sources are read: 6 s
            patch.object(lerobot_record, "aggregate_pipeline_dataset_features", with_pictures),
            patch.object(GelSightMini, "read_latest", noted),
        ):
            lerobot_record.main()
        self.assertGreater(len(given), 10)
        poses = [np.array([0.001 * i, 0, 0], np.float32) for i in range(len(given))]
        self.assert_has(self.folder / "set", given, poses)


if __name__ == "__main__":
    unittest.main()
