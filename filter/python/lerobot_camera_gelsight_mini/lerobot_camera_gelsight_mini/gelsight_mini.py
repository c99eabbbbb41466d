"""The camera: LeRobot's OpenCV camera, with the sensor found by name, its border cut away and its stalls seen."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event
from typing import Any

import cv2
import numpy as np
from lerobot.cameras.configs import ColorMode
from lerobot.cameras.opencv import OpenCVCamera, OpenCVCameraConfig
from lerobot.utils.decorators import check_if_already_connected
from lerobot.utils.errors import DeviceNotConnectedError
from numpy.typing import NDArray

from . import devices
from .config_gelsight_mini import GelSightMiniConfig


class GelSightMini(OpenCVCamera):
    """A GelSight Mini, or a video of one. The thread that reads and all time-outs are LeRobot's.

    A picture that equals the one before bit for bit is not new: a camera that works has noise. After `stall_ms` of
    the same picture, or at the end of a video, each read fails and says why, until the camera is connected again.
    """

    def __init__(self, config: GelSightMiniConfig):
        self.mini = config
        given = config.index_or_path
        super().__init__(
            OpenCVCameraConfig(
                # Until `connect` finds the device, its name is there for messages.
                index_or_path=Path(config.sensor or devices.NAME) if given is None else given,
                fps=config.fps,
                width=config.width,
                height=config.height,
                rotation=config.rotation,
                color_mode=config.color_mode,
                warmup_s=config.warmup_s,
            )
        )
        self.is_video = isinstance(given, Path) and given.is_file()
        self.source_px = (0, 0)  # width and height of the device's pictures, known when connected
        self._picture: NDArray[Any] | None = None  # the newest, as the device gave it
        self._picture_s = 0.0  # when it was first seen
        self._begin = Event()  # a video waits at its first picture until it is connected
        self._due_s = 0.0  # when its next picture is due
        self._trouble: Exception | None = None  # why there is no new picture

    @staticmethod
    def find_cameras() -> list[dict[str, Any]]:
        """The sensors that are connected: name, type and id, which is an `index_or_path`."""
        return [{"name": found.name, "type": "gelsight_mini", "id": str(found.path)} for found in devices.connected()]

    @check_if_already_connected  # type: ignore[untyped-decorator]
    def connect(self, warmup: bool = True) -> None:
        """Finds and opens the sensor and starts to read.

        Raises:
            ConnectionError: No such sensor, several of that name, or one that cannot be opened.
            RuntimeError: The device refuses a size or rate, or gives no pictures.
            ValueError: The pictures without their border are smaller than `width` x `height`.
        """
        if self.mini.index_or_path is None:
            self.index_or_path = devices.choose(self.mini.sensor).path
            self.backend = cv2.CAP_V4L2
        self._picture, self._due_s, self._trouble = None, 0.0, None
        self._begin.clear()
        try:
            super().connect(warmup and not self.is_video)
            if warmup and self.is_video:
                self.new_frame_event.wait(self.warmup_s)
        except BaseException:
            if self.videocapture is not None:
                self.disconnect()
            raise
        finally:
            self._begin.set()

    def read(self, color_mode: ColorMode | None = None) -> NDArray[Any]:
        """The next picture, `[height, width, 3]`; waits for it."""
        with self._explained():
            picture: NDArray[Any] = super().read(color_mode)
            return picture

    def async_read(self, timeout_ms: float = 200) -> NDArray[Any]:
        """The newest picture that was not read yet; waits for one up to `timeout_ms`."""
        with self._explained():
            picture: NDArray[Any] = super().async_read(timeout_ms)
            return picture

    def read_latest(self, max_age_ms: int = 500) -> NDArray[Any]:
        """The newest picture, read before or not, of at most `max_age_ms` and `stall_ms`."""
        with self._explained():
            picture: NDArray[Any] = super().read_latest(min(max_age_ms, self.mini.stall_ms))
            return picture

    @contextmanager
    def _explained(self) -> Iterator[None]:
        """LeRobot says that its thread has ended; the reason is in the thread."""
        try:
            yield
        except (RuntimeError, TimeoutError) as error:
            if self._trouble is None:
                raise
            raise type(error)(str(self._trouble)) from error

    def _read_loop(self) -> None:
        try:
            super()._read_loop()
        finally:
            # A read that waits ends now, and no read gives the last picture again.
            with self.frame_lock:
                self.latest_frame = None
                self.latest_timestamp = None
            self.new_frame_event.set()

    def _read_from_hardware(self) -> NDArray[Any]:
        try:
            picture = self._new_picture()
        except Exception as error:
            self._trouble = error
            raise
        self._trouble = None
        return picture

    def _new_picture(self) -> NDArray[Any]:
        """Waits for a picture that differs from the one before. `DeviceNotConnectedError` ends LeRobot's thread."""
        while self.stop_event is not None and not self.stop_event.is_set():
            if self.is_video:
                self._wait_for_video()
            try:
                picture: NDArray[Any] = super()._read_from_hardware()
            except RuntimeError as error:
                if self.is_video:
                    raise DeviceNotConnectedError(f"{self}: the video has ended") from error
                raise RuntimeError(f"{self} gives no picture: is it unplugged?") from error
            height, width, _ = picture.shape
            if (width, height) != self.source_px:
                raise RuntimeError(f"{self}: expected {_size(self.source_px)} pixels, got {_size((width, height))}")
            now_s = time.monotonic()
            if self._picture is None or not _is_same(picture, self._picture):
                self._picture, self._picture_s = picture, now_s
                return picture
            if (now_s - self._picture_s) * 1000 > self.mini.stall_ms:
                stalled = f"{self} has stalled: the same picture for more than {self.mini.stall_ms} ms; connect again"
                raise DeviceNotConnectedError(stalled)
        raise DeviceNotConnectedError(f"{self} is closed")

    def _wait_for_video(self) -> None:
        """Waits until the next picture of the video is due."""
        if self._picture is not None:
            self._begin.wait()
        now_s = time.monotonic()
        if self.stop_event is not None:
            self.stop_event.wait(max(0.0, self._due_s - now_s))
        self._due_s = max(self._due_s, now_s) + 1 / (self.fps or 25)

    def _postprocess_image(self, image: NDArray[Any]) -> NDArray[Any]:
        """Cuts the border away and brings the rest to the size asked for; colours and rotation are LeRobot's."""
        left, top = (_border_px(side, self.mini.border) for side in self.source_px)
        kept = image[top : image.shape[0] - top, left : image.shape[1] - left]
        size = (self.capture_width, self.capture_height)
        finished: NDArray[Any] = super()._postprocess_image(cv2.resize(kept, size, interpolation=cv2.INTER_AREA))
        return finished

    def _validate_width_and_height(self) -> None:
        """Settles the size of the device's pictures. LeRobot's `capture_width` is what it gets: before rotation."""
        if self.videocapture is None:
            raise DeviceNotConnectedError(f"{self} is closed")
        asked = (self.mini.capture_width, self.mini.capture_height)
        if asked[0] is not None and asked[1] is not None and not self.is_video:
            self.videocapture.set(cv2.CAP_PROP_FRAME_WIDTH, float(asked[0]))
            self.videocapture.set(cv2.CAP_PROP_FRAME_HEIGHT, float(asked[1]))
        width = round(self.videocapture.get(cv2.CAP_PROP_FRAME_WIDTH))
        height = round(self.videocapture.get(cv2.CAP_PROP_FRAME_HEIGHT))
        self.source_px = (width, height)
        if asked[0] is not None and asked != self.source_px:
            expected = f"capture_width x capture_height: expected {_size(self.source_px)}, which the device gives"
            raise RuntimeError(f"{self}: {expected}, got {_size(asked)}")
        kept = tuple(side - 2 * _border_px(side, self.mini.border) for side in self.source_px)
        if kept[0] < self.capture_width or kept[1] < self.capture_height:
            size = (self.capture_width, self.capture_height)
            expected = f"width x height (before rotation): expected at most {_size(kept)}"
            why = f"which border={self.mini.border:.4g} leaves of {_size(self.source_px)}"
            raise ValueError(f"{expected}, {why}, got {_size(size)}")

    def _validate_fps(self) -> None:
        """A video is played at any rate; a device must have it."""
        if not self.is_video:
            super()._validate_fps()


def _border_px(side: int, share: float) -> int:
    """Rounded down as the drivers of a GelSight Mini do; 1/7 has no exact binary form, and of 245 it is 35."""
    return int(side * share + 1e-9)


def _is_same(picture: NDArray[Any], other: NDArray[Any]) -> bool:
    """Bit for bit. Pictures that differ do so in their first rows, so the others are rarely compared."""
    return picture.shape == other.shape and all(map(np.array_equal, picture, other))


def _size(size: tuple[Any, ...]) -> str:
    return f"{size[0]}x{size[1]}"
