"""Which sensor is opened, and what its pictures become."""

from dataclasses import dataclass
from pathlib import Path

from lerobot.cameras.configs import CameraConfig, ColorMode, Cv2Rotation


@CameraConfig.register_subclass("gelsight_mini")
@dataclass(kw_only=True)
class GelSightMiniConfig(CameraConfig):
    """A GelSight Mini. Without `sensor` and `index_or_path` it is the only one that is connected.

    The steps are made in the order: border cut away, size, colours, rotation.

    Attributes:
        sensor: A part of the sensor's name, such as its serial number: `2BNK-CE0U`. Case and hyphens do not count.
        index_or_path: A device, as of LeRobot's OpenCV camera, or a video file, which is played at `fps`.
        width: Width of the pictures that come out, after rotation, pixels.
        height: Their height, pixels.
        fps: Pictures a second that the device is asked for; `None` leaves the device's or the file's rate.
        border: What is cut away at each side, as a share of the width and of the height, 0 to below 0.5. The drivers
            of a GelSight Mini cut away 1/7.
        rotation: Quarter turns, as of LeRobot's OpenCV camera.
        color_mode: Order of the colours. Datasets of LeRobot are RGB.
        capture_width: Width that the device is asked for, pixels; `None` takes what it gives: 3280 x 2464.
        capture_height: The height, pixels; given with `capture_width` or not at all.
        stall_ms: A camera that gives no other picture for longer than this has stalled, and its reading fails.
        warmup_s: Pictures of so many seconds are left out at first; a video's are not.
    """

    sensor: str | None = None
    index_or_path: int | Path | None = None
    width: int | None = 320
    height: int | None = 240
    fps: int | None = 25
    border: float = 1 / 7
    rotation: Cv2Rotation = Cv2Rotation.NO_ROTATION
    color_mode: ColorMode = ColorMode.RGB
    capture_width: int | None = None
    capture_height: int | None = None
    stall_ms: int = 500
    warmup_s: int = 2

    def __post_init__(self) -> None:
        self.rotation = Cv2Rotation(self.rotation)
        self.color_mode = ColorMode(self.color_mode)
        if isinstance(self.index_or_path, str):
            self.index_or_path = Path(self.index_or_path)

        if self.sensor is not None and not any(character.isalnum() for character in self.sensor):
            raise _invalid("sensor", "a part of a name", self.sensor)
        if self.sensor is not None and self.index_or_path is not None:
            raise _invalid("index_or_path", f"none, as the sensor is {self.sensor!r}", str(self.index_or_path))
        if isinstance(self.index_or_path, int) and self.index_or_path < 0:
            raise _invalid("index_or_path", "0 or more", self.index_or_path)
        for field in ("width", "height", "stall_ms"):
            value = getattr(self, field)
            if not isinstance(value, int) or value < 1:
                raise _invalid(field, "a whole number, 1 or more", value)
        for field in ("fps", "capture_width", "capture_height"):
            value = getattr(self, field)
            if value is not None and (not isinstance(value, int) or value < 1):
                raise _invalid(field, "a whole number, 1 or more, or none", value)
        if (self.capture_width is None) != (self.capture_height is None):
            missing = "capture_width" if self.capture_width is None else "capture_height"
            raise _invalid(missing, "width and height, or neither", None)
        if not isinstance(self.border, (int, float)) or not 0 <= self.border < 0.5:
            raise _invalid("border", "0 to below 0.5", self.border)
        if not isinstance(self.warmup_s, int) or self.warmup_s < 0:
            raise _invalid("warmup_s", "a whole number, 0 or more", self.warmup_s)


def _invalid(field: str, expected: str, got: object) -> ValueError:
    return ValueError(f"{field}: expected {expected}, got {got!r}")
