"""The training step of train/ in PyTorch on a graphics card: what `cargo xtask bench card` compares with.

Usage: card.py MODEL.safetensors PAIRS SECONDS [ARITHMETIC...]. Prints JSON: the card; pairs a second with images that are already on
the card, for each arithmetic (`float32` as IEEE has it; `tf32`, PyTorch's own default for convolutions; `bfloat16`, mixed) the better
of eager and compiled; TFLOP a second of a product of large matrices of float32; how many GFLOP a pair's step takes. Channels last, AdamW in one
kernel, the moving average in one call.
"""

import copy
import json
import sys
import time

import torch

from network import Encoder, Predictor, config_of, info_nce, load
from pytorch import pair_gflop

CARD = torch.device("cuda")


def timed(step, seconds):
    """Seconds of a step, the mean over some seconds after ten that do not count."""
    for _ in range(10):
        step()
    torch.cuda.synchronize()
    n, start = 0, time.perf_counter()
    while time.perf_counter() < start + seconds:
        for _ in range(10):
            step()
        torch.cuda.synchronize()
        n += 10
    return (time.perf_counter() - start) / n


def training_step(path, n_pairs, mixed, compiles):
    (width, height), w, hidden, dim = config_of(path)
    online, predictor = Encoder(width, height, w, hidden, dim), Predictor(hidden, dim)
    load(path, online, predictor)
    online, predictor = online.to(CARD, memory_format=torch.channels_last).train(), predictor.to(CARD).train()
    momentum = copy.deepcopy(online).requires_grad_(False)
    optimizer = torch.optim.AdamW([*online.parameters(), *predictor.parameters()], 1e-4, weight_decay=0.05, fused=True)
    images = torch.randn(2 * n_pairs, 3, height, width, device=CARD).contiguous(memory_format=torch.channels_last)

    def loss_of(images):
        with torch.autocast("cuda", torch.bfloat16, enabled=mixed):
            queries = predictor(online(images))
            with torch.no_grad():
                keys = momentum(images)
        queries, keys = queries.float(), keys.float()
        return info_nce(queries[:n_pairs], keys[n_pairs:], 0.1) + info_nce(queries[n_pairs:], keys[:n_pairs], 0.1)

    loss_of = torch.compile(loss_of) if compiles else loss_of

    def step():
        optimizer.zero_grad()
        loss_of(images).backward()
        optimizer.step()
        with torch.no_grad():
            torch._foreach_lerp_(list(momentum.parameters()), list(online.parameters()), 0.02)

    return step


def matrix_product_tflops(seconds, n=8192):
    a, b = torch.randn(n, n, device=CARD), torch.randn(n, n, device=CARD)
    return 2e-12 * n**3 / timed(lambda: a @ b, seconds)


def main():
    path, n_pairs, seconds = sys.argv[1], int(sys.argv[2]), float(sys.argv[3])
    (width, height), w, hidden, dim = config_of(path)
    result = {"torch": torch.__version__, "card": torch.cuda.get_device_name()}
    torch.backends.cuda.matmul.allow_tf32 = torch.backends.cudnn.allow_tf32 = False
    result["product_tflops"] = matrix_product_tflops(seconds / 3)
    result["pair_gflop"] = pair_gflop(Encoder(width, height, w, hidden, dim).eval(), Predictor(hidden, dim).eval(),
                                      torch.randn(1, 3, height, width))
    for arithmetic in sys.argv[4:] or ("float32", "tf32", "bfloat16"):
        is_tf32 = arithmetic != "float32"
        torch.backends.cuda.matmul.allow_tf32 = torch.backends.cudnn.allow_tf32 = is_tf32
        best = 0.0
        for compiles in (False, True):
            torch.manual_seed(1)
            speed = n_pairs / timed(training_step(path, n_pairs, arithmetic == "bfloat16", compiles), seconds)
            print(f"{arithmetic}, {'compiled' if compiles else 'eager'}: {speed:.0f} pairs/s", file=sys.stderr)
            best = max(best, speed)
        result[arithmetic] = best
    print(json.dumps(result))


if __name__ == "__main__":
    main()
