"""Records a video of a made-up touch through the camera, as a dataset of LeRobot with pictures and poses.

    python tests/record.py FOLDER
    tactile-data import FOLDER --state x:m,y:m,yaw:rad --part A --side hole --out touches
"""

import math
import os
import sys
import tempfile
from pathlib import Path

os.environ["HF_HUB_OFFLINE"] = "1"

import cv2
import numpy as np
from lerobot.datasets.lerobot_dataset import LeRobotDataset
from lerobot_camera_gelsight_mini import GelSightMini, GelSightMiniConfig

PICTURES = "observation.images.tactile"
SOURCE_PX = (656, 492)  # a fifth of the sensor's pictures
N_AT_REST = 5


def touches(n_pictures, size=SOURCE_PX, seed=1):
    """Pictures as OpenCV gives them (BGR): a lit film with noise; after those at rest a ring moves over it."""
    rng = np.random.default_rng(seed)
    y, x = (axis.astype(np.float32) / size[0] for axis in np.mgrid[: size[1], : size[0]])
    film = np.stack([70 + 60 * x, 110 - 40 * x, 60 + 80 * y], axis=2)
    pictures = []
    for i in range(n_pictures):
        lit = film + rng.integers(0, 8, film.shape, np.uint8)
        if i >= N_AT_REST:
            ring = np.exp(-(((np.hypot(x - 0.3 - 0.01 * i, y - 0.35) - 0.1) / 0.02) ** 2))
            lit += (60 * ring * (x - 0.5))[:, :, None] * np.array([1, -1, 0.5], np.float32)
        pictures.append(lit.astype(np.uint8))
    return pictures


def write_video(path, pictures, fps=25):
    """Without loss, in the order and with the values given."""
    height, width, _ = pictures[0].shape
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"FFV1"), fps, (width, height))
    assert writer.isOpened(), "this OpenCV writes no FFV1"
    for picture in pictures:
        writer.write(picture)
    writer.release()
    return Path(path)


def record(video, folder, n_frames):
    """Records frames and the pose of the tool at each; returns the pictures that the camera gave, and the poses."""
    camera = GelSightMini(GelSightMiniConfig(index_or_path=video))
    features = {
        PICTURES: {
            "dtype": "image",
            "shape": (camera.height, camera.width, 3),
            "names": ["height", "width", "channels"],
        },
        "observation.state": {"dtype": "float32", "shape": (3,), "names": ["x", "y", "yaw"]},
    }
    dataset = LeRobotDataset.create(
        "local/touches", fps=camera.fps, root=folder, features=features, use_videos=False, image_writer_threads=1
    )
    pictures, poses = [], []
    with camera:
        for i in range(n_frames):
            pictures.append(camera.async_read(timeout_ms=2000))
            poses.append(np.array([0.4 + 0.0002 * i, -0.001 * math.sin(i), 0.01 * i], np.float32))
            dataset.add_frame({PICTURES: pictures[-1], "observation.state": poses[-1], "task": "touch"})
    dataset.save_episode()
    dataset.finalize()
    return pictures, poses


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    with tempfile.TemporaryDirectory() as scratch:
        record(write_video(Path(scratch) / "touch.avi", touches(30)), Path(sys.argv[1]), 20)
    print(f"20 frames in {sys.argv[1]}")
