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
from torch import nn

from network import Encoder, Predictor, config_of, info_nce, load


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
    (width, height), w, hidden, dim = config_of(path)
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


if __name__ == "__main__":
    main()
