"""A robot and a teleoperator for `lerobot-record` that need no hardware: a tool at x, y and yaw that slides along x."""

from dataclasses import dataclass, field

from lerobot.cameras import CameraConfig, make_cameras_from_configs
from lerobot.robots import Robot, RobotConfig
from lerobot.teleoperators import Teleoperator, TeleoperatorConfig

AXES = ("x", "y", "yaw")


@RobotConfig.register_subclass("gantry")
@dataclass(kw_only=True)
class GantryConfig(RobotConfig):
    cameras: dict[str, CameraConfig] = field(default_factory=dict)


class Gantry(Robot):
    config_class, name = GantryConfig, "gantry"
    is_connected, is_calibrated = False, True

    def __init__(self, config):
        super().__init__(config)
        self.cameras = make_cameras_from_configs(config.cameras)
        self.pose = dict.fromkeys(AXES, 0.0)

    @property
    def observation_features(self):
        pictures = {name: (camera.height, camera.width, 3) for name, camera in self.cameras.items()}
        return {**dict.fromkeys(AXES, float), **pictures}

    @property
    def action_features(self):
        return dict.fromkeys(AXES, float)

    def connect(self, calibrate=True):
        for camera in self.cameras.values():
            camera.connect()
        self.is_connected = True

    def disconnect(self):
        for camera in self.cameras.values():
            camera.disconnect()
        self.is_connected = False

    def calibrate(self):
        pass

    def configure(self):
        pass

    def get_observation(self):
        return {**self.pose, **{name: camera.read_latest() for name, camera in self.cameras.items()}}

    def send_action(self, action):
        self.pose = dict(action)
        return action


@TeleoperatorConfig.register_subclass("slide")
@dataclass(kw_only=True)
class SlideConfig(TeleoperatorConfig):
    pass


class Slide(Teleoperator):
    config_class, name = SlideConfig, "slide"
    is_connected, is_calibrated = False, True
    x = 0.0

    @property
    def action_features(self):
        return dict.fromkeys(AXES, float)

    @property
    def feedback_features(self):
        return {}

    def connect(self, calibrate=True):
        self.is_connected = True

    def disconnect(self):
        self.is_connected = False

    def calibrate(self):
        pass

    def configure(self):
        pass

    def get_action(self):
        self.x += 0.001
        return {"x": self.x, "y": 0.0, "yaw": 0.0}

    def send_feedback(self, feedback):
        pass
