"""A PyTorch twin of a training run, for `cargo xtask bench twin`: the same first weights, batches, loss, optimiser and schedules.

Usage: twin.py FIRST.safetensors TRAIN.toml OUT TRAINER [ARGUMENTS]. TRAINER is the program that writes the batches of the run to
its standard output (`tactile-train --write-batches`): for each step the number n of pairs as u32, then n hole and n peg images as
f32 [3, height, width], all little-endian. In OUT a checkpoint every `save_every` steps, and times.csv: step, seconds of training
until then, without what saving took.
"""

import copy
import csv
import math
import queue
import subprocess
import sys
import threading
import time
import tomllib
from pathlib import Path

import numpy as np
import torch

from network import Encoder, Predictor, config_of, info_nce, load, save


class Lamb(torch.optim.Optimizer):
    """You et al. 2020 as burn's LambConfig computes it: bias correction, weight decay in the update, a trust ratio per tensor."""

    def __init__(self, parameters, weight_decay, betas=(0.9, 0.999), eps=1e-6):
        super().__init__(parameters, {"lr": 0.0, "weight_decay": weight_decay, "betas": betas, "eps": eps})
        self.time = 0

    @torch.no_grad()
    def step(self):
        self.time += 1
        for group in self.param_groups:
            (beta_1, beta_2), eps = group["betas"], group["eps"]
            parameters = [p for p in group["params"] if p.grad is not None]
            gradients = [p.grad for p in parameters]
            for p in parameters:
                if not self.state[p]:
                    self.state[p] = {"first": torch.zeros_like(p), "second": torch.zeros_like(p)}
            first, second = ([self.state[p][key] for p in parameters] for key in ("first", "second"))
            torch._foreach_lerp_(first, gradients, 1 - beta_1)
            torch._foreach_mul_(second, beta_2)
            torch._foreach_addcmul_(second, gradients, gradients, 1 - beta_2)
            below = torch._foreach_div(second, 1 - beta_2**self.time)
            torch._foreach_sqrt_(below)
            torch._foreach_add_(below, eps)
            update = torch._foreach_div(first, 1 - beta_1**self.time)
            torch._foreach_div_(update, below)
            torch._foreach_add_(update, parameters, alpha=group["weight_decay"])
            lengths = zip(torch._foreach_norm(parameters), torch._foreach_norm(update))
            trust = [(a / b).item() if a > 0 and b > 0 else 1.0 for a, b in lengths]
            torch._foreach_mul_(update, [-group["lr"] * ratio for ratio in trust])
            torch._foreach_add_(parameters, update)


def rate(step, s):
    """train/src/schedule.rs: linear warm-up, then half a cosine to 0."""
    if step < s["warmup"]:
        return s["learning_rate"] * (step + 1) / s["warmup"]
    share = (step - s["warmup"]) / max(s["steps"] - s["warmup"], 1)
    return s["learning_rate"] * 0.5 * (1 + math.cos(math.pi * min(share, 1)))


def momentum_at(step, s):
    """train/src/schedule.rs: from the start to 1 on half a cosine."""
    return 1 - (1 - s["momentum"]) * 0.5 * (1 + math.cos(math.pi * min(step / s["steps"], 1)))


def batches(command, length, ahead):
    """Puts what the trainer writes into a queue, one batch ahead, as `tactile-train` itself does."""
    with subprocess.Popen(command, stdout=subprocess.PIPE, bufsize=0) as trainer:
        stream = open(trainer.stdout.fileno(), "rb", buffering=1 << 20, closefd=False)
        while head := stream.read(4):
            n = int.from_bytes(head, "little")
            values = np.frombuffer(stream.read(2 * n * length * 4), dtype="<f4")
            if len(values) != 2 * n * length:
                raise EOFError("a batch cut short")
            ahead.put(torch.from_numpy(values.copy()).view(2, n, -1))
    if trainer.returncode:
        raise RuntimeError(f"{command[0]} ended with {trainer.returncode}")


class Twin:
    def __init__(self, path, settings, layout):
        self.settings, self.layout = settings, layout
        (self.width, self.height), w, hidden, dim = config_of(path)
        self.online, self.predictor = Encoder(self.width, self.height, w, hidden, dim), Predictor(hidden, dim)
        load(path, self.online, self.predictor)
        # The step that made the file moved them from zero, by less than shows anywhere but in the trust ratio.
        biases = [m.bias for module in (self.online, self.predictor) for m in module.modules() if hasattr(m, "running_mean")]
        torch._foreach_zero_([bias.data for bias in biases])
        self.online = self.online.to(memory_format=layout).train()
        self.predictor.train()
        self.momentum = copy.deepcopy(self.online).requires_grad_(False)
        parameters = [*self.online.parameters(), *self.predictor.parameters()]
        self.optimizer = Lamb(parameters, settings["weight_decay"])

    def train(self, step, holes, pegs):
        s, n = self.settings, len(holes)
        shape = lambda rows: rows.view(-1, 3, self.height, self.width)
        bounds = [i * n // s["micro_batches"] for i in range(s["micro_batches"] + 1)]
        queries, keys = ([], []), ([], [])
        for start, end in zip(bounds, bounds[1:]):
            images = shape(torch.cat([holes[start:end], pegs[start:end]])).contiguous(memory_format=self.layout)
            with torch.no_grad():
                of_keys = self.momentum(images)
            of_queries = self.predictor(self.online(images))
            for rows, both in ((queries, of_queries), (keys, of_keys)):
                rows[0].append(both[: end - start]), rows[1].append(both[end - start :])
        queries, keys = [torch.cat(rows) for rows in queries], [torch.cat(rows) for rows in keys]
        loss = info_nce(queries[0], keys[1], s["temperature"]) + info_nce(queries[1], keys[0], s["temperature"])
        self.optimizer.zero_grad()
        loss.backward()
        self.optimizer.param_groups[0]["lr"] = rate(step, s)
        self.optimizer.step()
        with torch.no_grad():
            torch._foreach_lerp_(
                list(self.momentum.parameters()), list(self.online.parameters()), 1 - momentum_at(step, s)
            )
        return loss.item()


def faster_layout(path, settings):
    """The layout whose step is faster, of two: as PyTorch is used at its best. Not counted."""
    (width, height), *_ = config_of(path)
    images = torch.randn(2, settings["batch"], 3 * height * width)
    taken = {}
    for layout in (torch.contiguous_format, torch.channels_last):
        twin = Twin(path, settings, layout)
        for step in range(6):
            start = time.perf_counter()
            twin.train(step, *images)
            taken[layout] = min(taken.get(layout, math.inf), time.perf_counter() - start)
    return min(taken, key=taken.get)


def main():
    first, toml, out, command = sys.argv[1], sys.argv[2], Path(sys.argv[3]), sys.argv[4:]
    settings = tomllib.loads(Path(toml).read_text())
    if settings["optimizer"] != "lamb":
        raise SystemExit(f"{toml}: expected the optimizer lamb, got {settings['optimizer']}")
    torch.manual_seed(1)
    twin = Twin(first, settings, faster_layout(first, settings))
    ahead = queue.Queue(1)
    reader = threading.Thread(target=batches, args=(command, 3 * twin.width * twin.height, ahead), daemon=True)
    rows, seconds = [("step", "seconds", "loss")], 0.0
    reader.start()
    batch = ahead.get(timeout=600)  # How long the trainer takes to start does not count.
    for step in range(settings["steps"]):
        start = time.perf_counter()
        loss = twin.train(step, *batch)
        if step + 1 < settings["steps"]:
            batch = ahead.get(timeout=600)
        seconds += time.perf_counter() - start
        if (step + 1) % settings["save_every"] == 0 or step + 1 == settings["steps"]:
            save(first, out / f"step-{step + 1}.safetensors", twin.online, twin.predictor)
            rows.append((step + 1, f"{seconds:.3f}", f"{loss:.4f}"))
    with open(out / "times.csv", "w", newline="") as file:
        csv.writer(file).writerows(rows)


if __name__ == "__main__":
    main()
