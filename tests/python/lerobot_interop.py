"""Compares a LeRobot dataset that `tactile-data export --to lerobot` wrote with the arrays of `--to npy` of the same dataset: by
the package lerobot and by Hugging Face's datasets, which read it without this project.

    tactile-data export touches --to lerobot --out touches-lerobot
    tactile-data export touches --to npy --out touches-npy
    pip install lerobot==0.4.4
    python tests/python/lerobot_interop.py touches-lerobot touches-npy
"""

import io
import json
import math
import os
import sys
from pathlib import Path

os.environ["HF_HUB_OFFLINE"] = "1"

import numpy as np
from datasets import load_dataset
from lerobot.datasets.lerobot_dataset import LeRobotDataset
from PIL import Image

PICTURES = "observation.images.tactile"


def main(folder: Path, arrays: Path) -> None:
    frames = np.load(arrays / "frames.npy", mmap_mode="r")
    poses = np.load(arrays / "poses.npy")
    touches = json.loads((arrays / "touches.json").read_text())

    by_lerobot = LeRobotDataset("local/touches", root=folder)
    assert len(by_lerobot) == len(frames), (len(by_lerobot), len(frames))
    for i in range(len(frames)):
        item = by_lerobot[i]
        picture = (item[PICTURES].permute(1, 2, 0) * 255).round().byte().numpy()
        assert np.array_equal(picture, frames[i]), f"lerobot, frame {i}: another picture"
        part, side = touches["parts"][i], touches["sides"][i]
        if part is not None:
            assert item["part"] == part and part in item["task"], f"lerobot, frame {i}: {item['part']}, {item['task']}"
        if side is not None:
            assert item["side"] == side and side in item["task"], f"lerobot, frame {i}: {item['side']}, {item['task']}"
        # lerobot brings every number to f32.
        if not np.isnan(poses[i, 0]):
            degrees = [*poses[i, :2], math.degrees(poses[i, 2])]
            assert np.allclose(item["observation.state"], degrees, rtol=1e-6, atol=1e-6), f"lerobot, frame {i}: another pose"
    mean = np.asarray(by_lerobot.meta.stats[PICTURES]["mean"]).ravel()
    assert np.allclose(mean, frames.mean(axis=(0, 1, 2)) / 255, atol=1e-9), "another mean colour"

    by_datasets = load_dataset("parquet", data_files=str(folder / "data" / "*" / "*.parquet"), split="train")
    assert len(by_datasets) == len(frames)
    for i, row in enumerate(by_datasets):
        found = row[PICTURES]
        picture = found if isinstance(found, Image.Image) else Image.open(io.BytesIO(found["bytes"]))
        assert np.array_equal(np.asarray(picture), frames[i]), f"datasets, frame {i}: another picture"
        assert row["index"] == i
        if not np.isnan(poses[i, 0]):
            pose = [row["x_mm"], row["y_mm"], math.radians(row["theta_deg"])]
            assert pose[:2] == list(poses[i, :2]), f"datasets, frame {i}: another place"
            assert math.isclose(pose[2], poses[i, 2], rel_tol=1e-15, abs_tol=1e-18), f"datasets, frame {i}: another angle"

    print(f"{len(frames)} frames of {by_lerobot.meta.total_episodes} episodes: lerobot and datasets read what was exported")


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
