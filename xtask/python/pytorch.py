"""The same network and the same training step in PyTorch, timed: what `cargo xtask bench training` compares with.

Usage: pytorch.py MODEL.safetensors PAIRS SECONDS. Prints JSON: pairs a second, milliseconds of one image, images a
second in batches of 64; how many GFLOP a second a product of large matrices makes, and how many a pair's step takes with
convolutions counted as they are defined. The step is that of train/src/moco.rs in one shard: both encoders in training mode, symmetric
InfoNCE, backward, AdamW, moving average.
"""

import copy
import json
import sys
import time

import torch
from safetensors import safe_open
from torch import nn
from torch.nn import functional as F


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


def load(path, encoder, predictor):
    """Puts the weights of a checkpoint into the modules: linear layers are stored [in, out] there."""
    # `half` is a method of every PyTorch module.
    names = {"gamma": "weight", "beta": "bias", "half": "halve"}
    with safe_open(path, framework="pt") as file:
        for module, prefix in ((encoder, "encoder."), (predictor, "predictor.")):
            state = {}
            for key in file.keys():
                if key.startswith(prefix):
                    values = file.get_tensor(key).float()
                    name = ".".join(names.get(part, part) for part in key.removeprefix(prefix).split("."))
                    state[name] = values.T if values.dim() == 2 else values
            module.load_state_dict(state, strict=False)


def info_nce(queries, keys, tau):
    logits = F.normalize(queries) @ F.normalize(keys).T / tau
    return 2 * tau * F.cross_entropy(logits, torch.arange(len(logits)))


def timed(step, seconds):
    """Median time of a step over some seconds, after three that do not count."""
    for _ in range(3):
        step()
    times, end = [], time.perf_counter() + seconds
    while time.perf_counter() < end or len(times) < 3:
        start = time.perf_counter()
        step()
        times.append(time.perf_counter() - start)
    return sorted(times)[len(times) // 2]


def matrix_product_gflops(seconds, n=1024):
    """The best of products of n x n matrices over some seconds."""
    a, b = torch.randn(n, n), torch.randn(n, n)
    best, end = 0.0, time.perf_counter() + seconds
    while time.perf_counter() < end:
        start = time.perf_counter()
        a @ b
        best = max(best, 2e-9 * n**3 / (time.perf_counter() - start))
    return best


def pair_gflop(online, predictor, image):
    """Of one pair's step: two images, forward and back (twice as much) and forward in the momentum encoder."""
    counts = {"encoder": 0, "predictor": 0}

    def count(key):
        def hook(module, _, out):
            counts[key] += 2 * module.weight[0].numel() * out.numel()

        return hook

    modules = [("encoder", module) for module in online.modules()] + [("predictor", module) for module in predictor.modules()]
    layers = [(key, module) for key, module in modules if isinstance(module, (nn.Conv2d, nn.Linear))]
    hooks = [module.register_forward_hook(count(key)) for key, module in layers]
    with torch.inference_mode():
        predictor(online(image))
    for hook in hooks:
        hook.remove()
    return 1e-9 * 2 * (4 * counts["encoder"] + 3 * counts["predictor"])


def main():
    path, n_pairs, seconds = sys.argv[1], int(sys.argv[2]), float(sys.argv[3])
    with safe_open(path, framework="pt") as file:
        config = json.loads(file.metadata()["config"])
    (width, height), w, hidden, dim = config["input_px"], config["width"], config["hidden"], config["dim"]
    torch.manual_seed(1)
    result = {"torch": torch.__version__, "threads": torch.get_num_threads()}
    result["matrix_product_gflops"] = matrix_product_gflops(seconds / 6)
    for layout in (torch.contiguous_format, torch.channels_last):
        online, predictor = Encoder(width, height, w, hidden, dim), Predictor(hidden, dim)
        load(path, online, predictor)
        online = online.to(memory_format=layout)
        momentum = copy.deepcopy(online).requires_grad_(False)
        optimizer = torch.optim.AdamW([*online.parameters(), *predictor.parameters()], 1e-4, weight_decay=0.05)
        images = torch.randn(2 * n_pairs, 3, height, width).contiguous(memory_format=layout)

        def step():
            queries = predictor(online(images))
            with torch.no_grad():
                keys = momentum(images)
            loss = info_nce(queries[:n_pairs], keys[n_pairs:], 0.1) + info_nce(queries[n_pairs:], keys[:n_pairs], 0.1)
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            with torch.no_grad():
                for slow, fast in zip(momentum.parameters(), online.parameters()):
                    slow.lerp_(fast, 0.02)

        def embed(n):
            def run():
                with torch.inference_mode():
                    predictor(online(images[:n]))

            return run

        online.train(), predictor.train(), momentum.train()
        found = {"pairs_per_second": n_pairs / timed(step, seconds)}
        online.eval(), predictor.eval()
        result["pair_gflop"] = pair_gflop(online, predictor, images[:1])
        found["one_image_ms"] = 1e3 * timed(embed(1), seconds / 3)
        found["images_per_second"] = 64 / timed(embed(64), seconds / 3)
        # The better of PyTorch's two layouts counts, figure by figure.
        for key, value in found.items():
            better = min if key == "one_image_ms" else max
            result[key] = better(result.get(key, value), value)
    print(json.dumps(result))


main()
