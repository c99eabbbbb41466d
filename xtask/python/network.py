"""The network of train/ in PyTorch, its checkpoints and its loss: what pytorch.py and twin.py have in common."""

import hashlib
import json

import numpy as np
import torch
from safetensors import safe_open
from safetensors.torch import save_file
from torch import nn
from torch.nn import functional as F

# `half` is a method of every PyTorch module.
NAMES = {"gamma": "weight", "beta": "bias", "half": "halve"}


class ConvBn(nn.Module):
    def __init__(self, n_in, n_out, kernel, stride):
        super().__init__()
        self.conv = nn.Conv2d(n_in, n_out, kernel, stride, kernel // 2, bias=False)
        self.norm = nn.BatchNorm2d(n_out)

    def forward(self, x):
        return self.norm(self.conv(x))


class Encoder(nn.Module):
    def __init__(self, width, height, w, hidden, dim):
        super().__init__()
        self.stem = ConvBn(3, w, 5, 2)
        self.halve = ConvBn(w, 4 * w, 3, 2)
        self.residual_1 = ConvBn(4 * w, 4 * w, 3, 1)
        self.quarter = ConvBn(4 * w, 4 * w, 3, 2)
        self.residual_2 = ConvBn(4 * w, 4 * w, 3, 1)
        self.narrow = ConvBn(4 * w, 2 * w, 1, 1)
        n_pixels = -(-width // 8) * -(-height // 8)
        self.project_1 = nn.Linear(2 * w * n_pixels, hidden, bias=False)
        self.norm_1 = nn.BatchNorm1d(hidden)
        self.project_2 = nn.Linear(hidden, dim, bias=False)
        self.norm_2 = nn.BatchNorm1d(dim)

    def forward(self, x):
        x = F.relu(self.stem(x))
        x = F.relu(self.halve(x))
        x = F.relu(x + self.residual_1(x))
        x = F.relu(self.quarter(x))
        x = F.relu(x + self.residual_2(x))
        x = F.relu(self.narrow(x)).flatten(1)
        return self.norm_2(self.project_2(F.relu(self.norm_1(self.project_1(x)))))


class Predictor(nn.Module):
    def __init__(self, hidden, dim):
        super().__init__()
        self.predict_1 = nn.Linear(dim, hidden, bias=False)
        self.norm_1 = nn.BatchNorm1d(hidden)
        self.predict_2 = nn.Linear(hidden, dim, bias=False)

    def forward(self, x):
        return self.predict_2(F.relu(self.norm_1(self.predict_1(x))))


def config_of(path):
    """The sizes of a checkpoint's network: [width, height] of its input, channels, hidden and dim."""
    with safe_open(path, framework="pt") as file:
        config = json.loads(file.metadata()["config"])
    return config["input_px"], config["width"], config["hidden"], config["dim"]


def name_here(key):
    """The name in a PyTorch module of a tensor that a checkpoint calls `key`, without its first part."""
    return ".".join(NAMES.get(part, part) for part in key.split(".")[1:])


def load(path, encoder, predictor):
    """Puts the weights of a checkpoint into the modules: linear layers are stored [in, out] there."""
    with safe_open(path, framework="pt") as file:
        for module, prefix in ((encoder, "encoder."), (predictor, "predictor.")):
            state = {}
            for key in file.keys():
                if key.startswith(prefix):
                    values = file.get_tensor(key).float()
                    state[name_here(key)] = values.T if values.dim() == 2 else values
            module.load_state_dict(state, strict=False)


def save(like, path, encoder, predictor):
    """Writes the modules as a checkpoint with the text of another, which has the same tensors."""
    modules = {"encoder": encoder.state_dict(), "predictor": predictor.state_dict()}
    with safe_open(like, framework="pt") as file:
        metadata, keys = file.metadata(), sorted(file.keys())
    tensors = {}
    for key in keys:
        values = modules[key.split(".")[0]][name_here(key)].detach()
        tensors[key] = (values.T if values.dim() == 2 else values).contiguous(memory_format=torch.contiguous_format)
    digest = hashlib.sha256()
    for key in sorted(set(metadata) - {"schema", "sha256"}):
        digest.update(f"{key}\0{metadata[key]}\0".encode())
    for key in keys:
        digest.update(f"{key}\0{list(tensors[key].shape)}\0".encode())
        digest.update(tensors[key].numpy().astype(np.float32).tobytes())
    save_file(tensors, path, {**metadata, "sha256": digest.hexdigest()})


def info_nce(queries, keys, tau):
    logits = F.normalize(queries) @ F.normalize(keys).T / tau
    return 2 * tau * F.cross_entropy(logits, torch.arange(len(logits), device=logits.device))
