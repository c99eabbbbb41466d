"""The encoder in ONNX Runtime and in tract, timed: what `cargo xtask bench runtimes` compares with.

Usage: runtimes.py MODEL.safetensors SECONDS. Writes the network as ONNX next to itself in the current folder, checks both against
numpy (forward.py) and prints JSON: milliseconds of one image and images a second in batches of 64, each on one core. The
normalisations are nodes of their own: both runtimes fold them into the convolutions, as ours does.
"""

import json
import sys
import time

import numpy as np
import onnx
import onnxruntime
import tract
from onnx import TensorProto, helper, numpy_helper
from safetensors import safe_open
from safetensors.numpy import load_file

from forward import EPSILON, forward

BATCH = 64
BOUND = 1e-4

# Layer, stride, whether its input is added: infer/src/embedding/architecture.rs.
CONVOLUTIONS = [("stem", 2, False), ("half", 2, False), ("residual_1", 1, True), ("quarter", 2, False),
                ("residual_2", 1, True), ("narrow", 1, False)]


def as_onnx(tensors, size, n):
    """The query of `n` images, `[n, 3, height, width]` -> `[n, dim]`, of unit length."""
    nodes, constants = [], []

    def node(kind, inputs, out, **attributes):
        nodes.append(helper.make_node(kind, inputs, [out], **attributes))
        return out

    def constant(name, values=None):
        values = tensors[name] if values is None else values
        constants.append(numpy_helper.from_array(np.ascontiguousarray(values, dtype=np.float32), name))
        return name

    def norm(x, name):
        parts = [constant(f"{name}.{part}") for part in ("gamma", "beta", "running_mean", "running_var")]
        return node("BatchNormalization", [x, *parts], f"{name}.out", epsilon=EPSILON)

    def linear(x, name):
        return node("MatMul", [x, constant(f"{name}.weight")], f"{name}.out")

    x = "images"
    for name, stride, adds in CONVOLUTIONS:
        weight = constant(f"encoder.{name}.conv.weight")
        pad = tensors[weight].shape[2] // 2
        y = node("Conv", [x, weight], f"{name}.conv", strides=[stride] * 2, pads=[pad] * 4)
        y = norm(y, f"encoder.{name}.norm")
        y = node("Add", [x, y], f"{name}.sum") if adds else y
        x = node("Relu", [y], f"{name}.relu")
    x = node("Flatten", [x], "flat", axis=1)
    x = node("Relu", [norm(linear(x, "encoder.project_1"), "encoder.norm_1")], "project.relu")
    x = norm(linear(x, "encoder.project_2"), "encoder.norm_2")
    x = node("Relu", [norm(linear(x, "predictor.predict_1"), "predictor.norm_1")], "predict.relu")
    x = linear(x, "predictor.predict_2")
    node("LpNormalization", [x], "queries", axis=1, p=2)
    dim = tensors["predictor.predict_2.weight"].shape[1]
    of = lambda name, shape: helper.make_tensor_value_info(name, TensorProto.FLOAT, shape)
    graph = helper.make_graph(nodes, "encoder", [of("images", [n, 3, size[1], size[0]])], [of("queries", [n, dim])], constants)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8)
    onnx.checker.check_model(model)
    path = f"encoder-{n}.onnx"
    onnx.save(model, path)
    return path


def in_onnxruntime(path):
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    session = onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])
    return lambda images: session.run(None, {"images": images})[0]


def in_tract(path):
    model = tract.onnx().load(path).into_model().into_runnable()
    return lambda images: model.run([images])[0].to_numpy()


def median(run, images, seconds):
    run(images)
    times, end = [], time.perf_counter() + seconds
    while time.perf_counter() < end or len(times) < 3:
        start = time.perf_counter()
        run(images)
        times.append(time.perf_counter() - start)
    return sorted(times)[len(times) // 2]


def main():
    path, seconds = sys.argv[1], float(sys.argv[2])
    tensors = load_file(path)
    with safe_open(path, framework="np") as file:
        size = json.loads(file.metadata()["config"])["input_px"]
    images = np.random.default_rng(1).standard_normal((BATCH, 3, size[1], size[0]), dtype=np.float32)
    truth, _ = forward({name: values.astype(np.float64) for name, values in tensors.items()}, images.astype(np.float64))
    result = {"onnxruntime": {"version": onnxruntime.__version__}, "tract": {"version": tract.version()}}
    for name, load in (("onnxruntime", in_onnxruntime), ("tract", in_tract)):
        for n in (1, BATCH):
            run = load(as_onnx(tensors, size, n))
            worst = np.abs(run(images[:n]) - truth[:n]).max()
            if not worst <= BOUND:
                sys.exit(f"error: {name}: expected embeddings that differ by at most {BOUND}, got {worst:.1e}")
            taken = median(run, images[:n], seconds)
            result[name].update({"one_image_ms": 1e3 * taken} if n == 1 else {"images_per_second": n / taken})
    print(json.dumps(result))


if __name__ == "__main__":
    main()
