"""The network in numpy alone: embeds the inputs that `tactile-infer embed --dump-input` wrote and compares.

    python forward.py MODEL.safetensors INPUT.npy EMBEDDED.json...

Prints the largest difference from each JSON file (`tactile-infer embed --json`, either side) and fails above 1e-4.
infer/WEIGHTS.md describes the file. Computes in f64, so that what differs is the other side's rounding.
"""

import json
import sys

import numpy as np
from safetensors.numpy import load_file

BOUND = 1e-4
EPSILON = 1e-5  # added to a variance by every normalisation


def convolve(x, weight, stride):
    """[n, c, h, w], [out, c, k, k] -> [n, out, h', w'], padded by k // 2 with zeros, without bias."""
    kernel = weight.shape[2]
    pad = kernel // 2
    x = np.pad(x, ((0, 0), (0, 0), (pad, pad), (pad, pad)))
    views = np.lib.stride_tricks.sliding_window_view(x, (kernel, kernel), axis=(2, 3))
    views = views[:, :, ::stride, ::stride]  # [n, c, h', w', k, k]
    return np.einsum("nchwij,ocij->nohw", views, weight, optimize=True)


def forward(tensors, x):
    """[n, 3, h, w] -> query [n, dim] and key [n, dim], of unit length."""

    def norm(x, name):
        of = lambda part: tensors[f"{name}.{part}"].reshape((1, -1) + (1,) * (x.ndim - 2))
        scale = of("gamma") / np.sqrt(of("running_var") + EPSILON)
        return (x - of("running_mean")) * scale + of("beta")

    def layer(x, name, stride=1):
        return norm(convolve(x, tensors[f"encoder.{name}.conv.weight"], stride), f"encoder.{name}.norm")

    def linear(x, name):
        return x @ tensors[f"{name}.weight"]  # [in, out]

    relu = lambda x: np.maximum(x, 0.0)
    unit = lambda x: x / np.linalg.norm(x, axis=1, keepdims=True)

    x = relu(layer(x, "stem", 2))
    x = relu(layer(x, "half", 2))
    x = relu(x + layer(x, "residual_1"))
    x = relu(layer(x, "quarter", 2))
    x = relu(x + layer(x, "residual_2"))
    x = relu(layer(x, "narrow"))
    x = x.reshape(len(x), -1)  # channel, row, column
    x = relu(norm(linear(x, "encoder.project_1"), "encoder.norm_1"))
    key = norm(linear(x, "encoder.project_2"), "encoder.norm_2")
    x = relu(norm(linear(key, "predictor.predict_1"), "predictor.norm_1"))
    query = linear(x, "predictor.predict_2")
    return unit(query), unit(key)


def main(model, dumped, embedded):
    tensors = {name: values.astype(np.float64) for name, values in load_file(model).items()}
    query, key = forward(tensors, np.load(dumped).astype(np.float64))
    worst = 0.0
    for path in embedded:
        with open(path) as file:
            found = json.load(file)
        rows = np.array([image["embedding"] for image in found["images"]])
        difference = np.abs(rows - (query if found["side"] == "hole" else key)).max()
        print(f"{found['side']}: {len(rows)} embeddings of {found['dim']}, largest difference {difference:.1e}")
        worst = max(worst, difference)
    if not worst <= BOUND:
        sys.exit(f"error: embeddings: expected differences of at most {BOUND}, got {worst:.1e}")


if __name__ == "__main__":
    if len(sys.argv) < 4:
        sys.exit(__doc__)
    main(sys.argv[1], sys.argv[2], sys.argv[3:])
