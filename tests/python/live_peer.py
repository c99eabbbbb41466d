"""The live node against a robot and a camera on CycloneDDS or Fast DDS: whole holes, with all that goes wrong. Run by
`cargo xtask dds --node`.

    pip install cyclonedds==11.0.1 mcap numpy pillow
    tactile-data generate --scene alphabet-small --sides hole --xy-step-mm 2 --theta-step-deg 90 \\
      --frame-px 320x240 --out holes
    tactile-data export holes --to folder --out pictures
    python tests/python/live_peer.py tactile-filter --model M --bank B --pictures pictures [--seconds 600] [--only NAME]

The bank is one of the scene's pegs. With FASTDDS_PEER robot and camera are on Fast DDS (`fastdds_peer.py`). Neither
shares code with the middleware that is checked. All traffic stays on 127.0.0.1. Ends with a table of the figures, or
with exit code 1 at the first check that fails.
"""

import argparse
import contextlib
import copy
import csv
import dataclasses
import io
import itertools
import json
import multiprocessing
import os
import random
import re
import signal
import statistics
import struct
import subprocess
import sys
import tempfile
import threading
import time

import dds_peer as dds
import dds_types as ros
import numpy as np
from dds_peer import check, paced, wait_for
from mcap.reader import make_reader
from PIL import Image

# A variable, since the processes that are started here need it as well.
if "FASTDDS_PEER" in os.environ:
    from fastdds_peer import Client, DomainParticipant, n_matched, reader, take, writer
else:
    from cyclonedds.domain import DomainParticipant
    from dds_peer import Client, n_matched, reader, take, writer

DOMAIN = 79
RATE_HZ = 25
STEP_MM = 2
# As the pictures are: on a grid, not turned. The first touch is in the middle of the grid, and the next are around it.
REACH = ["-p", "reach.xy_half_mm:=4.0", "-p", f"reach.xy_step_mm:={STEP_MM}.0", "-p", "reach.theta_half_deg:=0.0"]
# What a contact takes to settle, s: six pictures.
SETTLE_S = 0.24
SERVICES = ("observe", "reset", "calibrate_no_contact")
ROWS = []


def row(name, what, measured, target=""):
    ROWS.append((name, what, measured, target))
    print(f"{name:10} {what}: {measured}" + (f" (target {target})" if target else ""), flush=True)


class Pictures:
    """What the sensor shows at each place of each hole, and at rest."""

    def __init__(self, folder):
        self.folder = folder
        self.at, self.kept = {}, {}
        with open(os.path.join(folder, "index.csv"), newline="") as file:
            for line in csv.DictReader(file):
                if float(line["theta_deg"]) == 0:
                    place = (line["part"], round(float(line["x_mm"])), round(float(line["y_mm"])))
                    self.at[place] = line["file"]
        self.parts = sorted({part for part, *_ in self.at})

    def rgb(self, place):
        """Of a part and a place, or of nothing."""
        if place not in self.kept:
            name = self.at[place] if place else "no_contact.png"
            self.kept[place] = np.asarray(Image.open(os.path.join(self.folder, name)).convert("RGB"))
        return self.kept[place]


def flickering(rgb, number):
    """The same, with one byte in 97 changed by one count: no camera sends the same bytes twice."""
    values = rgb.reshape(-1).copy()
    changed = values[number % 97 :: 97].astype(np.int16) + (1 if number % 2 else -1)
    values[number % 97 :: 97] = np.clip(changed, 0, 255).astype(np.uint8)
    return values.reshape(rgb.shape)


def jpeg(rgb, quality=90):
    data = io.BytesIO()
    Image.fromarray(rgb).save(data, "JPEG", quality=quality)
    return data.getvalue()


def remarked(data, number):
    """The same JPEG with a comment: other bytes, the same pixels."""
    comment = f"picture {number}".encode()
    return data[:2] + b"\xff\xfe" + (len(comment) + 2).to_bytes(2, "big") + comment + data[2:]


def stamp(offset_s=0.0):
    now = time.time_ns() + int(offset_s * 1e9)
    return ros.Time(now // 10**9, now % 10**9)


class Node(dds.Ours):
    """`tactile-filter live --ros` in the background: its decisions and what it says."""

    def __init__(self, *words, ros_args=(), namespace="", log=None, variables=()):
        self.name = f"{namespace}/tactile_filter"
        program = [dds.PROGRAM, "live", "--ros", "--json", "--model", WORDS.model, "--bank", WORDS.bank, *words]
        program += ["--log", log] if log else []
        names = ["-r", f"__ns:={namespace}"] if namespace else []
        environment = {**os.environ, "ROS_DOMAIN_ID": str(DOMAIN), **dict(variables)}
        command = [*program, "--ros-args", *REACH, *names, *ros_args]
        pipe = subprocess.PIPE
        self.process = subprocess.Popen(command, stdout=pipe, stderr=pipe, env=environment, text=True)
        self.decisions, self.lines, self.news = [], [], threading.Condition()
        for stream, kept in ((self.process.stdout, self.decisions), (self.process.stderr, self.lines)):
            threading.Thread(target=self._read_lines, args=(stream, kept), daemon=True).start()

    def _read_lines(self, stream, kept):
        for line in stream:
            with self.news:
                kept.append(line.rstrip("\n"))
                self.news.notify_all()

    def said(self, words):
        """The lines with these words."""
        with self.news:
            return [line for line in self.lines if words in line]

    def wait_said(self, words, seconds=15):
        return wait_for(f"the node did not say {words!r}, but {self.lines[-5:]}", lambda: self.said(words), seconds)

    def end(self):
        if self.is_alive():
            self.process.send_signal(signal.SIGINT)
        try:
            code = self.process.wait(10)
        except subprocess.TimeoutExpired:
            self.process.kill()
            check(False, f"the node did not end at ctrl-C: {self.lines[-5:]}")
        check(code == 0, f"the node ended with {code}: {self.lines[-5:]}")
        check(not self.said("panicked"), f"{self.said('panicked')}")

    def __exit__(self, kind, *_):
        if kind is None:
            self.end()
        else:
            self.process.kill()


class Robot:
    """The robot and its camera: pictures at 25 Hz, tool poses at 50 Hz, calls, and what the node answers."""

    def __init__(self, node, pictures, film=None):
        self.node, self.pictures = node, pictures
        self.participant = DomainParticipant(DOMAIN)
        name = f"rt{node}"
        reading = lambda topic, kind, depth=10: reader(self.participant, f"{name}/{topic}", kind, "reliable", depth)
        self.to_image = writer(self.participant, f"{name}/image/compressed")
        self.to_raw = None
        self.to_pose = writer(self.participant, f"{name}/tool_pose", ros.PoseStamped)
        self.calls = {service: Client(self.participant, f"{node}/{service}") for service in SERVICES}
        self.decisions = reading("decision", ros.String)
        self.actions = reading("next_action", ros.TransformStamped)
        self.goals = reading("next_pose", ros.PoseStamped)
        self.events = reading("events", ros.String, 1000)
        # What the film shows, changed between two pictures: a place, the tool's pose in mm, and whether it comes at all.
        self.shows, self.is_filming, self.is_posing = (None, (0, 0, 10)), True, True
        self.rate_hz, self.stamp_s = RATE_HZ, 0.0
        self.n_pictures = self.n_poses = 0
        self.make = film or self.flickering_jpeg
        self.is_over, self.lock = False, threading.Lock()
        self.thread = threading.Thread(target=self._film, daemon=True)
        self.thread.start()

    def flickering_jpeg(self, place, number):
        data = jpeg(flickering(self.pictures.rgb(place), number))
        return ros.CompressedImage(ros.Header(stamp(self.stamp_s), "gelsight"), "jpeg", data)

    def still_jpeg(self, place, number):
        """Other bytes each time, and always the same pixels."""
        key = ("jpeg", place)
        if key not in self.pictures.kept:
            self.pictures.kept[key] = jpeg(self.pictures.rgb(place))
        data = remarked(self.pictures.kept[key], number)
        return ros.CompressedImage(ros.Header(stamp(self.stamp_s), "gelsight"), "jpeg", data)

    def _film(self):
        start, number, next_picture = time.monotonic(), 0, 0.0
        while not self.is_over:
            number += 1
            time.sleep(max(0.0, start + number / 50 - time.monotonic()))
            with self.lock:
                place, (x_mm, y_mm, z_mm) = self.shows
            # The pose first: a picture after it shows what is there.
            if self.is_posing:
                position = ros.Point(x_mm / 1000, y_mm / 1000, -z_mm / 1000)
                self.to_pose.write(ros.PoseStamped(ros.Header(stamp(), "base_link"), ros.Pose(position, ros.Quaternion())))
                self.n_poses += 1
            if self.is_filming and number / 50 >= next_picture:
                next_picture = max(next_picture + 1 / self.rate_hz, number / 50)
                message = self.make(place, self.n_pictures)
                if message is not None:
                    to = self.to_image if isinstance(message, ros.CompressedImage) else self.raw()
                    to.write(message)
                    self.n_pictures += 1

    def raw(self):
        if self.to_raw is None:
            self.to_raw = writer(self.participant, f"rt{self.node}/image", ros.Image)
            time.sleep(0.5)
        return self.to_raw

    def show(self, place, pose_mm):
        with self.lock:
            self.shows = (place, pose_mm)

    def ready(self):
        for client in self.calls.values():
            wait_for(f"{self.node} is not found", client.is_found, 30)
        wait_for("the camera is not found", lambda: n_matched(self.to_image))
        time.sleep(0.5)
        return self

    def call(self, service, seconds=15, heard=None):
        """Calls; the answer and what it took, ms. `None`: none came. The first message on the topic of `heard`, its reader,
        is put there with its time."""
        client, start = self.calls[service], time.monotonic()
        call = client.ask()
        while time.monotonic() < start + seconds:
            if heard is not None and len(heard) == 1 and (came := take(heard[0])):
                heard.extend([came[-1], 1000 * (time.monotonic() - start)])
            if answer := client.answer(call):
                return answer, 1000 * (time.monotonic() - start)
            time.sleep(0.0003)
        return None, 1000 * seconds

    def must(self, service, seconds=15):
        answer, _ = self.call(service, seconds)
        check(answer and answer.success, f"{service}: {answer}; {take(self.events)}")
        return answer.message

    def rest(self):
        """Over the board, touching nothing: pictures of the sensor at rest."""
        self.show(None, (0, 0, 10))
        time.sleep(SETTLE_S)
        return self.must("calibrate_no_contact")

    def observe(self):
        """Calls ~/observe; what was decided and the times in ms from the call to the answer and to the next action."""
        [take(of) for of in (self.decisions, self.actions, self.goals)]
        heard = [self.actions]
        answer, answered_ms = self.call("observe", heard=heard)
        if not (answer and answer.success):
            return answer, None
        decision = json.loads(wait_for("a decision", lambda: take(self.decisions))[-1].data)
        touch = {"decision": decision, "answered_ms": answered_ms}
        if decision["next"]:
            if len(heard) == 1:
                # Both came between two looks.
                wait_for("a next action", lambda: take(self.actions))
                heard += [None, answered_ms]
            touch["action_ms"] = heard[2]
            touch["goal"] = wait_for("a next pose", lambda: take(self.goals))[-1].pose.position
        return answer, touch

    def touch(self, place, settle_s=SETTLE_S):
        """Travels, presses, waits, observes."""
        self.show(None, (place[1], place[2], 10))
        time.sleep(0.12)
        self.show(place, (place[1], place[2], 0))
        before = self.n_poses
        # The first pose and picture of the contact.
        wait_for("a pose", lambda: self.n_poses >= before + 2 or not self.is_posing)
        time.sleep(settle_s)
        return self.observe()

    def hole(self, part, first=(0, 0), settle_s=SETTLE_S, before_touch=lambda number: None, tries=1):
        """Touches a hole until the node says stop: the touches."""
        self.must("reset")
        touches, (x_mm, y_mm) = [], first
        while len(touches) < 30:
            before_touch(len(touches))
            answer, touch = self.touch((part, x_mm, y_mm), settle_s)
            for _ in range(tries - 1):
                if touch is None:
                    answer, touch = self.observe()
            check(touch, f"touch {len(touches) + 1} of {part} was refused: {answer}")
            touches.append(touch)
            if touch["decision"]["stop"]:
                return touches
            x_mm, y_mm = (snapped(1000 * metres) for metres in (touch["goal"].x, touch["goal"].y))
        check(False, "a hole without an end")

    def end(self):
        self.is_over = True
        self.thread.join()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.end()


def snapped(mm):
    place = STEP_MM * round(mm / STEP_MM)
    check(abs(place - mm) < 1e-6 and abs(place) <= 8, f"a goal beside the grid: {mm}")
    return place


def names_right(part, touches):
    return touches[-1]["decision"]["estimate"]["part"] == part


def quantile(values, share):
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))]


def milliseconds(values):
    return f"{statistics.median(values):.1f} / {quantile(values, 0.99):.1f} ms of {len(values)}"


def same(touches):
    """What must be equal where the pictures were."""
    return [json.dumps(touch["decision"], sort_keys=True) for touch in touches]


def holes(seed):
    """Holes without end, each with the place of its first touch."""
    source = random.Random(seed)
    while True:
        yield source.choice(PICTURES.parts), (2 * source.randrange(-2, 3), 2 * source.randrange(-2, 3))


def check_bare(seconds):
    """The same without a log, whose index is held in memory."""
    check_run(seconds, "bare")


def check_run(seconds, name="run"):
    """Hole after hole: nothing lost, memory, processor, times."""
    log = os.path.join(WORDS.out, "run.mcap") if name == "run" else None
    with contextlib.suppress(FileNotFoundError):
        os.remove(log or "")
    with Node(log=log) as node, Robot(node.name, PICTURES) as robot:
        robot.ready().rest()
        start = time.monotonic()
        memory, touches, n_right, n_holes, idle = [], [], 0, 0, [0.0, 0.0]
        watch = threading.Thread(target=lambda: [
            (memory.append((time.monotonic() - start, node.rss_kib())), time.sleep(1))
            for _ in iter(lambda: not robot.is_over and node.is_alive(), False)
        ], daemon=True)
        watch.start()
        before = node.cpu_s()
        for part, first in holes(1):
            if time.monotonic() - start > seconds:
                break
            of_hole = robot.hole(part, first)
            touches += of_hole
            n_holes += 1
            n_right += names_right(part, of_hole)
            # Lifted, with the film running: what the node takes between touches.
            robot.show(None, (0, 0, 10))
            time.sleep(0.5)
            cpu, begun = node.cpu_s(), time.monotonic()
            time.sleep(3)
            idle = [idle[0] + node.cpu_s() - cpu, idle[1] + time.monotonic() - begun]
        took = time.monotonic() - start
        whole = 100 * (node.cpu_s() - before) / took
        settled = memory[len(memory) // 5:]
        slope = statistics.linear_regression(*zip(*settled)).slope * 60
        ticks = robot.n_pictures, robot.n_poses
    with_log = "with a log" if log else "without a log"
    row(name, f"{with_log}: time; pictures and poses sent", f"{took:.0f} s; {ticks[0]} and {ticks[1]}", "600 s")
    row(name, "cores; programs that ran on average in the last 5 minutes", f"{os.cpu_count()}; {os.getloadavg()[1]:.1f}")
    row(name, "touches asked for and answered with success", f"{len(touches)} of {len(touches)}", "all")
    row(name, "holes named right", f"{n_right} of {n_holes}")
    actions = [touch["action_ms"] for touch in touches if "action_ms" in touch]
    row(name, "settled contact: call to next_action, p50 / p99", milliseconds(actions), "20 / 50 ms")
    row(name, "settled contact: call to answer, p50 / p99", milliseconds([t["answered_ms"] for t in touches]))
    share = 100 * idle[0] / idle[1]
    row(name, "processor between touches", f"{share:.1f} % of a core in {idle[1]:.0f} s", "under 10 %")
    row(name, "processor over all", f"{whole:.1f} % of a core")
    text = f"{memory[0][1]} -> {memory[-1][1]} KiB, {slope:+.1f} KiB a minute after the first fifth"
    row(name, "memory", text, "no growth")
    check(n_right >= 0.9 * n_holes, "holes named wrongly")
    if log:
        waited = waited_ms(log)
        check(len(waited) == len(touches), f"{len(waited)} answers in the log")
        text = f"{milliseconds(waited)}; {sum(ms > 1 for ms in waited)} waited"
        row(name, "of the time to the answer, waiting for a fresh picture, p50 / p99", text)
        size = os.path.getsize(log) / 2**20
        row(name, "log", f"{size:.0f} MiB, {size / took * 60:.1f} MiB a minute")
        replayed(log, len(touches))


def waited_ms(log):
    """By how much each touch's decision came after the call, on the node's clock, which stands still while it computes:
    the wait for fresh pictures."""
    called, waited = {}, []
    text = lambda message: message.data[8:-1].decode()
    with open(log, "rb") as file:
        topics = ["/tactile_filter/called", "/tactile_filter/answers"]
        for _, channel, message in make_reader(file).iter_messages(topics=topics):
            words = text(message).split(" ")
            if channel.topic.endswith("/called"):
                if words[0] == "~/observe":
                    called[words[1]] = message.log_time
            elif words[0] in called:
                waited.append((message.log_time - called[words[0]]) / 1e6)
    return waited


def replayed(log, n_touches=None):
    """Gives a log to a new node: the words of `replay`."""
    words = ["replay", "--json", "--model", WORDS.model, "--bank", WORDS.bank, "--log", log]
    start = time.monotonic()
    done = subprocess.run([dds.PROGRAM, *words], capture_output=True, text=True)
    check(done.returncode == 0, f"replay: {done.stderr}")
    n_decisions = len(done.stdout.splitlines())
    if n_touches is not None:
        check(n_decisions == n_touches, f"{n_decisions} decisions in the log, {n_touches} touches")
        row("run", "replay of the log", f"the same {n_decisions} decisions, {time.monotonic() - start:.0f} s", "the same")
    return done


def check_fresh(_seconds):
    """Observed at once: how long fresh pictures are waited for."""
    log = os.path.join(WORDS.out, "fresh.mcap")
    with contextlib.suppress(FileNotFoundError):
        os.remove(log)
    with Node(log=log) as node, Robot(node.name, PICTURES) as robot:
        robot.ready().rest()
        times = []
        for part, first in holes(2):
            if len(times) > 60:
                break
            times += [touch["answered_ms"] for touch in robot.hole(part, first, settle_s=0)]
    row("fresh", "call within 40 ms of the contact to answer, p50 / p99", milliseconds(times), "two pictures (80 ms) more")
    row("fresh", "of it, waiting for a fresh picture, p50 / p99", milliseconds(waited_ms(log)))



def script(node, places):
    """The same touches, whatever is decided."""
    touches = []
    for place in places:
        answer, touch = node.touch(place)
        check(touch, f"the touch at {place} was refused: {answer}")
        touches.append(touch)
    return touches


def check_encodings(_seconds):
    """The same touches in every form that a driver may send."""
    header = lambda: ros.Header(stamp(), "gelsight")
    size = lambda rgb: (header(), rgb.shape[0], rgb.shape[1])
    pixels = lambda rgb, name, order, step: ros.Image(*size(rgb), name, 0, step, rgb[..., order].tobytes())
    alpha = lambda rgb: np.concatenate([rgb, np.full_like(rgb[..., :1], 255)], axis=2)

    def png(rgb):
        data = io.BytesIO()
        Image.fromarray(rgb).save(data, "PNG", compress_level=1)
        return data.getvalue()

    forms = {
        "rgb8": lambda rgb: pixels(rgb, "rgb8", [0, 1, 2], 3 * rgb.shape[1]),
        "bgr8": lambda rgb: pixels(rgb, "bgr8", [2, 1, 0], 3 * rgb.shape[1]),
        "rgba8": lambda rgb: pixels(alpha(rgb), "rgba8", [0, 1, 2, 3], 4 * rgb.shape[1]),
        "bgra8": lambda rgb: pixels(alpha(rgb), "bgra8", [2, 1, 0, 3], 4 * rgb.shape[1]),
        "passthrough": lambda rgb: pixels(rgb, "passthrough", [0, 1, 2], 3 * rgb.shape[1]),
        "PNG": lambda rgb: ros.CompressedImage(header(), "png", png(rgb)),
        "JPEG": lambda rgb: ros.CompressedImage(header(), "jpeg", jpeg(rgb)),
        "JPEG called bgr8": lambda rgb: ros.Image(*size(rgb), "bgr8", 0, 3 * rgb.shape[1], jpeg(rgb)),
        "JPEG, all empty": lambda rgb: ros.Image(ros.Header(ros.Time(), ""), 0, 0, "", 0, 0, jpeg(rgb)),
        "rgb8, empty header": lambda rgb: dataclasses.replace(forms["rgb8"](rgb), header=ros.Header(ros.Time(), "")),
    }
    named, said = {}, {}
    for name, make in forms.items():
        film = lambda place, number: make(flickering(PICTURES.rgb(place), number))
        with Node() as node, Robot(node.name, PICTURES, film) as robot:
            robot.raw()
            robot.ready().rest()
            touches = robot.hole("E", (2, 0))
            named[name] = [(t["decision"]["estimate"]["part"], t["decision"]["estimate"]["probability"]) for t in touches]
            said[name] = len(node.said("encoding"))
    for name, of in named.items():
        check(of[-1][0] == "E", f"{name}: {of}")
    ends = {name: f"{of[-1][1]:.4f}" for name, of in named.items()}
    row("encodings", f"hole E in {len(forms)} forms ({', '.join(forms)})", f"named E in all, with {min(ends.values())} "
        f"to {max(ends.values())}; {said['passthrough']} line on passthrough", "E")


def check_trouble(_seconds):
    """A camera that stamps its last picture anew, whose stamps jump, that is slow."""
    frozen = []

    def film(place, number):
        if not frozen:
            return robot.still_jpeg(place, number)
        if len(frozen) == 1:
            frozen.append(robot.still_jpeg(place, number))
        return dataclasses.replace(frozen[1], header=ros.Header(stamp(), "gelsight"))

    with Node(ros_args=["-p", "camera.rate_hz:=25.0"]) as node, Robot(node.name, PICTURES) as robot:
        robot.make = film
        robot.ready().rest()
        first = robot.hole("K", (0, 2))
        # Short enough that the frame at rest is still good.
        robot.show(("K", 0, 2), (0, 2, 0))
        time.sleep(0.2)
        frozen.append(True)
        robot.show(("K", 2, 2), (2, 2, 0))
        time.sleep(0.5)
        answer, touch = robot.observe()
        check(touch is None and "camera has stopped" in answer.message, f"{answer}")
        refused = answer.message
        frozen.clear()
        time.sleep(0.3)
        check(same(robot.hole("K", (0, 2)))[:1] != [], "no touch after it")
        lines = len(node.said("it has stopped"))
        row("trouble", "camera that stamps its last picture anew for 1.5 s", f'refused: "{refused}"; {lines} line', "refused, 1 line")
        check(lines == 1, f"{node.lines}")
        # The clock of the camera.
        jumps = []
        for offset_s in (-3600.0, 0.0, 86_400.0, -86_400.0):
            robot.stamp_s = offset_s
            touches = robot.hole("K", (0, 2))
            jumps.append([touch["decision"]["estimate"]["part"] for touch in touches])
        check(all(parts[-1] == "K" for parts in jumps), f"{jumps}")
        check(len({len(first), *map(len, jumps)}) == 1, f"{jumps}")
        lines = len(node.said("its clock went back"))
        row("trouble", "stamps that jump by -1 h, +1 h, +1 d, -2 d within holes", f"each named right, {lines} lines", "no touch lost")
        robot.stamp_s = 0.0
        robot.rate_hz = 15
        node.wait_said("pictures a second, expected 25", 30)
        time.sleep(3)
        check(names_right("K", robot.hole("K", (0, 2))), "at 15 Hz")
        lines = node.said("pictures a second, expected 25")
        row("trouble", "15 Hz where 25 are expected", f'{len(lines)} line: "{lines[0]}"', "said, once in 10 s")


def publish_alone(node, folder):
    """A camera as a process of its own, until it is killed."""
    pictures = Pictures(folder)
    to = writer(DomainParticipant(DOMAIN), f"rt{node}/image/compressed")
    for number in paced(10**9, RATE_HZ):
        data = jpeg(flickering(pictures.rgb(None), number))
        to.write(ros.CompressedImage(ros.Header(stamp(), "gelsight"), "jpeg", data))


def apart(target, *args):
    """A function in a process of its own."""
    process = multiprocessing.get_context("spawn").Process(target=target, args=args, daemon=True)
    process.start()
    return process


def check_killed_camera(_seconds):
    """A camera's process killed and started again, quickly and late."""
    with Node() as node, Robot(node.name, PICTURES) as robot:
        robot.is_filming = False
        robot.ready()
        camera = apart(publish_alone, node.name, WORDS.pictures)
        time.sleep(2)
        robot.rest()
        needed = lambda: node.said("a new frame at rest is needed")
        for gap_s in (0.0, 4.0, 15.0):
            before = len(needed())
            camera.kill()
            camera.join()
            killed = time.monotonic()
            time.sleep(gap_s)
            camera = apart(publish_alone, node.name, WORDS.pictures)
            time.sleep(3)
            answer, _ = robot.call("observe")
            n_said = len(needed()) - before
            text = f"{n_said} line; observe: {answer.message[:110]!r}" if n_said else f"observe: {answer.success}"
            row("killed", f"camera killed, back after {gap_s:.0f} s", text, "asks once for a new frame at rest")
            check(n_said == 1 or gap_s == 0.0, f"{node.lines}")
            check(gap_s == 0.0 or "calibrate_no_contact" in answer.message, f"{answer}")
            robot.rest()
            answer, touch = robot.observe()
            check(touch, f"{answer}")
            print(f"           {time.monotonic() - killed:.0f} s after: {node.lines[-3:]}", flush=True)
        # The leases of the killed run out; that is no news while another camera sends.
        before = len(needed())
        time.sleep(15)
        robot.must("observe")
        check(len(needed()) == before, f"{node.lines}")
        camera.kill()


LATCHED = {
    "decision": ros.String,
    "label": ros.String,
    "next_action": ros.TransformStamped,
    "next_pose": ros.PoseStamped,
    "pose": ros.PoseWithCovarianceStamped,
    "/tf_static": ros.TFMessage,
    "particles": ros.PoseArray,
    "particle_cloud": ros.PointCloud2,
    "belief": ros.OccupancyGrid,
}


def latched(participant, node, topic, depth):
    """A reader of one of `LATCHED`: below the node, or at the root."""
    path = topic if topic.startswith("/") else f"{node}/{topic}"
    return reader(participant, f"rt{path}", LATCHED[topic], "latched", depth)


def check_late(_seconds):
    """Who comes late gets the latest of each latched topic, and nothing older: the first viewer, and two after it."""
    with Node() as node, Robot(node.name, PICTURES) as robot:
        robot.ready().rest()
        viewers, counts = [], []
        for n_holes in (12, 3, 3):
            for _ in range(n_holes):
                robot.must("reset")
                touches = script(robot, [("B", 0, 0), ("B", 2, 0)])
            viewers.append(DomainParticipant(DOMAIN))
            readers = {topic: latched(viewers[-1], node.name, topic, 10) for topic in LATCHED}
            came = {topic: wait_for(f"the latest {topic}", lambda: take(of)) for topic, of in readers.items()}
            time.sleep(2)
            [came[topic].extend(take(of)) for topic, of in readers.items()]
            counts.append(max(map(len, came.values())))
            n_older = {topic: sum(message != of[-1] for message in of) for topic, of in came.items()}
            check(not any(n_older.values()), f"older messages to viewer {len(viewers)}: {n_older}")
            decision = json.loads(came["decision"][0].data)
            check(decision == touches[-1]["decision"] and decision["touch"] == 2, f"{decision}")
            stamps = {(of[0].header.stamp.sec, of[0].header.stamp.nanosec) for of in came.values() if hasattr(of[0], "header")}
            check(len(stamps) == 1, "messages of several touches")
            frame, pose = came["/tf_static"][0].transforms[0], came["pose"][0]
            check((frame.header, frame.child_frame_id) == (pose.header, came["belief"][0].header.frame_id), f"{frame}")
            numbers = lambda of: [getattr(of, axis) for axis in of.__dataclass_fields__]
            there, pose = (frame.transform.translation, frame.transform.rotation), pose.pose.pose
            check([*map(numbers, there)] == [numbers(pose.position), numbers(pose.orientation)], f"{frame} {pose}")
            n = len(came["particles"][0].poses)
            check(n == came["particle_cloud"][0].width * came["particle_cloud"][0].height, "particles")
        graph = reader(viewers[-1], "ros_discovery_info", ros.ParticipantEntities, "latched")
        nodes = wait_for("the graph", lambda: take(graph))[-1].nodes
        check([node.node_name for node in nodes] == ["tactile_filter"], f"{nodes}")
        text = f"at most {counts}, all of the last touch; {n} particles"
        row("late", f"{len(LATCHED)} latched topics: messages of a topic to three viewers, after 12, 15 and 18 holes", text, "1")


def check_graph(_seconds):
    """Where nothing says how ROS 2's graph is laid out, the node learns it from another node."""
    with Node(variables={"ROS_DISTRO": ""}) as node:
        participant = DomainParticipant(DOMAIN)
        events = reader(participant, f"rt{node.name}/events", ros.String, "reliable")
        graph = reader(participant, "ros_discovery_info", ros.HumbleEntities, "latched")
        wait_for("the node is not found", lambda: n_matched(events))
        time.sleep(5)
        check(not take(graph), "a message before any node was heard")
        to = writer(participant, "ros_discovery_info", ros.HumbleEntities, "latched")
        humble = ros.HumbleNode("/", "viewer", [[7] * 24], [])
        to.write(ros.HumbleEntities([9] * 24, [humble]))
        ours = lambda: [node for message in take(graph) for node in message.nodes if node.node_name == "tactile_filter"]
        found = wait_for("the graph", ours)[-1]
        n_endpoints = len(found.readers) + len(found.writers)
        row("graph", "without ROS_DISTRO", f"nothing for 5 s, then as Humble's node: {n_endpoints} endpoints", "Humble's layout")


def fuzz_bodies(source, pictures):
    """What no message is: topic, type and bodies of one size."""
    header = ros.Header(ros.Time(1, 2), "base_link")
    pose = ros.PoseStamped(header, ros.Pose(ros.Point(), ros.Quaternion()))
    rgb = pictures.rgb(None)
    picture = ros.CompressedImage(header, "jpeg", jpeg(rgb))
    small = np.ascontiguousarray(rgb[::8, ::8])
    image = ros.Image(header, small.shape[0], small.shape[1], "rgb8", 0, 3 * small.shape[1], small.tobytes())
    body = lambda message: message.serialize(use_version_2=False)[4:]
    kinds = {"tool_pose": pose, "image/compressed": picture, "image": image}
    for topic, message in kinds.items():
        name = type(message).__idl_typename__.replace(".", "::")
        whole = body(message)
        yield topic, name, [source.randbytes(len(whole)) for _ in range(300)]
        for n_bytes in (1, 3, 8, 11, 12, 20, 33, 61):
            yield topic, name, [source.choice([source.randbytes(n_bytes), whole[:n_bytes]]) for _ in range(100)]
        # The length of the frame's name: more than there is.
        yield topic, name, [whole[:8] + source.randrange(len(whole), 1 << 32).to_bytes(4, "little") + whole[12:] for _ in range(300)]
    whole = bytearray(body(pose))
    at = len(whole) - 56
    bodies = []
    for _ in range(1200):
        # A number that is none in a place or a turn, or a turn of no length.
        wrong, n = bytearray(whole), source.randrange(7)
        value = np.float64(source.choice([np.nan, np.inf, -np.inf, 1e300]))
        wrong[at + 8 * n : at + 8 * n + 8] = value.tobytes()
        bodies.append(bytes(wrong) if source.random() < 0.8 else bytes(whole[:at + 24]) + bytes(32))
    yield "tool_pose", "geometry_msgs::msg::dds_::PoseStamped_", bodies
    whole = body(image)
    at = 12 + 12
    bodies = []
    for _ in range(1200):
        wrong = bytearray(whole)
        # Height, width: another number of pixels than there are.
        wrong[at : at + 8] = source.randrange(1 << 32).to_bytes(4, "little") + source.randrange(1 << 32).to_bytes(4, "little")
        bodies.append(bytes(wrong))
    yield "image", "sensor_msgs::msg::dds_::Image_", bodies
    whole = body(picture)
    start = whole.index(b"\xff\xd8")
    # No JPEG where one should be.
    yield "image/compressed", "sensor_msgs::msg::dds_::CompressedImage_", [
        whole[:start] + source.randbytes(1) + b"\0" + whole[start + 2 :] for _ in range(1200)
    ]
    for service in SERVICES:
        # Filled to a multiple of four none is as long as a request.
        for n_bytes in (5, 7, 9, 12, 21, 27, 40, 700):
            yield service, "std_srvs::srv::dds_::Trigger_Request_", [source.randbytes(n_bytes) for _ in range(100)]


def fuzz(node, folder, n_sent):
    """Sends it all, a participant for each size."""
    for topic, name, bodies in fuzz_bodies(random.Random(7), Pictures(folder)):
        participant = DomainParticipant(DOMAIN)
        kind = ros.garbage_type(len(bodies[0]), name)
        is_call = topic in SERVICES
        full = f"rq{node}/{topic}Request" if is_call else f"rt{node}/{topic}"
        to = writer(participant, full, kind, "reliable" if is_call else "newest")
        wait_for(f"nobody listens to {full}", lambda: n_matched(to))
        time.sleep(0.2)
        for body in bodies:
            to.write(kind(body))
            n_sent.value += 1
            time.sleep(0.003)
        del to, participant


def check_fuzz(_seconds):
    """Malformed messages on the node's own topics while touches go on."""
    places = list(zip(holes(3), range(400)))
    ends = []

    def play(is_fuzzed):
        with Node() as node, Robot(node.name, PICTURES) as robot:
            robot.make = robot.still_jpeg
            robot.ready().rest()
            n_sent = multiprocessing.get_context("spawn").Value("i", 0)
            noise = apart(fuzz, node.name, WORDS.pictures, n_sent) if is_fuzzed else None
            touches, n_refused = [], 0
            for (part, first), number in places:
                if (not noise.is_alive()) if is_fuzzed else number >= ends[0]:
                    break
                # While most poses are wrong a touch may be refused.
                touches += robot.hole(part, first, tries=10)
            if is_fuzzed:
                noise.join()
                check(noise.exitcode == 0, "the noise ended")
                ends.append(number)
                diagnostics = reader(robot.participant, f"rt{node.name}/diagnostics", ros.DiagnosticArray, "reliable")
                latest = wait_for("diagnostics", lambda: take(diagnostics))[-1].status
                check(int(next(of_value.value for of in latest for of_value in of.values if of_value.key == "poses")) <= robot.n_poses
                      and int(latest[0].values[0].value) <= robot.n_pictures, "malformed messages were believed")
                values = {f"{of.name.split(': ')[1]} {of_value.key}": of_value.value for of in latest for of_value in of.values}
                counted = [int(values["camera malformed"]), int(values["tool malformed"])]
                left_out = sum(int(m) for line in node.lines for m in re.findall(r": (\d+) messages left out", line))
                return touches, n_sent.value, counted, left_out, len(node.lines)
            return touches

    fuzzed, n_sent, counted, left_out, n_lines = play(True)
    plain = play(False)
    check(same(fuzzed) == same(plain), "other decisions with malformed messages")
    text = f"{n_sent}: {counted[0]} pictures, {counted[1]} poses and {left_out} requests counted; {n_lines} lines"
    row("fuzz", "malformed messages sent to the node's topics", text, "10,000")
    row("fuzz", "decisions meanwhile, with and without them", f"{len(fuzzed)} and {len(plain)}, equal to the last digit", "equal")


def check_damaged(_seconds):
    """Every fourth picture cut off, or of another size, or dark: none is believed."""
    source = random.Random(5)

    def film(place, number):
        message = robot.still_jpeg(place, number)
        if not is_damaged[0] or number % 4:
            return message
        rgb = PICTURES.rgb(place)
        wrong = {
            "cut": lambda: bytes(message.data)[: len(message.data) * 2 // 3],
            "small": lambda: jpeg(np.ascontiguousarray(rgb[::2, ::2])),
            "dark": lambda: jpeg((rgb // 16).astype(np.uint8)),
            "torn": lambda: jpeg(np.concatenate([rgb[:120], PICTURES.rgb(None)[120:]])),
            "noise": lambda: b"\xff\xd8" + source.randbytes(5000) + b"\xff\xd9",
        }
        return dataclasses.replace(message, data=wrong[list(wrong)[number // 4 % 5]]())

    results = []
    for damage in (False, True):
        is_damaged = [False]
        with Node() as node, Robot(node.name, PICTURES) as robot:
            robot.make = film
            robot.ready().rest()
            is_damaged[0] = damage
            touches = []
            for (part, first), _ in zip(holes(4), range(6)):
                touches += robot.hole(part, first, tries=3)
            results.append(touches)
            ended = node.lines
    check(same(results[0]) == same(results[1]), "other decisions with damaged pictures")
    times = [touch["answered_ms"] for touch in results[1]]
    row("damaged", "every fourth picture cut, small, dark, torn or noise", f"{len(times)} touches, the same decisions; call to "
        f"answer {milliseconds(times)}", "equal")
    del ended


def kept_on_wire(message):
    """A function that gives the message anew with the present stamp and another last byte: large ones take long to
    serialise."""
    cdr = bytearray(message.serialize(use_version_2=False))

    def anew(number):
        now = stamp()
        cdr[4:12] = struct.pack("<iI", now.sec, now.nanosec)
        cdr[-1] = number % 256
        made, data = copy.copy(message), bytes(cdr)
        made.serialize = lambda **_: data
        return made

    return anew


def check_large(_seconds):
    """Pictures of 3280 x 2464 pixels as JPEG, and of 1280 x 960 as they are."""
    header = lambda: ros.Header(stamp(), "gelsight")
    larger = lambda place, size: Image.fromarray(PICTURES.rgb(place)).resize(size, Image.BILINEAR)

    def compressed(place):
        data = jpeg(np.asarray(larger(place, (3280, 2464))))
        return lambda number: ros.CompressedImage(header(), "jpeg", remarked(data, number))

    def plain(place):
        pixels = larger(place, (1280, 960)).tobytes()
        return kept_on_wire(ros.Image(header(), 960, 1280, "rgb8", 0, 3 * 1280, pixels))

    for name, make in (("3280x2464, JPEG", compressed), ("1280x960, rgb8 of 3.7 MB", plain)):
        kept = {}

        def film(place, number):
            if place not in kept:
                kept[place] = make(place)
            return kept[place](number)

        with Node() as node, Robot(node.name, PICTURES) as robot:
            # What is sent before the node is found cannot come.
            robot.is_filming, robot.make, robot.rate_hz = False, film, 10
            n_before = robot.ready().n_pictures
            robot.is_filming = True
            time.sleep(1)
            robot.rest()
            before, start = node.cpu_s(), time.monotonic()
            time.sleep(5)
            idle = 100 * (node.cpu_s() - before) / (time.monotonic() - start)
            touches = robot.hole("G", (0, 0), settle_s=0.6)
            times = [touch["answered_ms"] for touch in touches]
            check(names_right("G", touches), f"{touches[-1]}")
            robot.is_filming = False
            time.sleep(2)
            diagnostics = reader(robot.participant, f"rt{node.name}/diagnostics", ros.DiagnosticArray, "reliable")
            n_came = int(wait_for("diagnostics", lambda: take(diagnostics))[-1].status[0].values[0].value)
            row("large", f"{name}, 10 Hz", f"{n_came} of {robot.n_pictures - n_before} came; {len(touches)} touches, named right; call to "
                f"answer {milliseconds(times)}; {idle:.1f} % of a core between, {node.rss_kib() // 1024} MiB")


def check_two(_seconds):
    """Two sensors, each with its own node, on one network."""
    sides = ("left", "right")
    with contextlib.ExitStack() as stack:
        nodes = [stack.enter_context(Node(namespace=f"/{side}")) for side in sides]
        robots = [stack.enter_context(Robot(node.name, PICTURES)) for node in nodes]
        right = {}

        def play(side):
            robots[side].ready().rest()
            right[side] = []
            for (part, first), _ in zip(holes(10 + side), range(6)):
                touches = robots[side].hole(part, first)
                right[side].append((names_right(part, touches), len(touches), len({t["decision"]["episode"] for t in touches})))

        threads = [threading.Thread(target=play, args=(side,)) for side in range(2)]
        [thread.start() for thread in threads]
        [thread.join() for thread in threads]
        check(len(right) == 2 and all(len(of) == 6 for of in right.values()), f"{right}")
        check(all(n_episodes == 1 for of in right.values() for *_, n_episodes in of), "touches of the other")
        for side, node in enumerate(nodes):
            n_touches = sum(n for _, n, _ in right[side])
            check(len(node.decisions) == n_touches, f"{len(node.decisions)} decisions of {n_touches} touches")
        named = [f"{sides[side]}: {sum(of[0] for of in right[side])} of 6 named right" for side in range(2)]
        row("two", "two sensors at once in two namespaces", "; ".join(named), "each its own")


def hang(node):
    """A subscriber of everything that reads nothing and is stopped."""
    participant = DomainParticipant(DOMAIN)
    kept = [latched(participant, node, topic, 1) for topic in LATCHED]
    kept += [reader(participant, f"rt{node}/{topic}", kind, "reliable") for topic, kind in
             (("events", ros.String), ("diagnostics", ros.DiagnosticArray))]
    time.sleep(1000)


def stop(process):
    """Stops a process and those that it has started."""
    with open(f"/proc/{process.pid}/task/{process.pid}/children") as file:
        children = map(int, file.read().split())
    for pid in (process.pid, *children):
        os.kill(pid, signal.SIGSTOP)


def check_stopped(_seconds):
    """A viewer that stands still, as in a debugger: the node goes on."""
    with Node() as node, Robot(node.name, PICTURES) as robot:
        robot.ready().rest()
        viewer = apart(hang, node.name)
        time.sleep(3)
        stop(viewer)
        start, touches = time.monotonic(), []
        for part, first in holes(6):
            if time.monotonic() - start > 60:
                break
            touches += robot.hole(part, first)
        times = [touch["answered_ms"] for touch in touches]
        lines = [line for line in node.lines if "keep up" in line]
        viewer.kill()
        check(node.is_alive(), f"{node.lines[-3:]}")
        row("stopped", "a viewer of all topics stopped for 60 s", f"{len(touches)} touches, call to answer "
            f"{milliseconds(times)}; {len(lines)} lines", "the node goes on")


def check_killed_node(_seconds):
    """The node killed while it writes its log."""
    log = os.path.join(WORDS.out, "killed.mcap")
    with contextlib.suppress(FileNotFoundError):
        os.remove(log)
    with Node(log=log) as node, Robot(node.name, PICTURES) as robot:
        robot.ready().rest()
        start = time.monotonic()
        n_touches, early = 0, 0
        for part, first in holes(7):
            if time.monotonic() - start > 15:
                break
            early = n_touches
            n_touches += len(robot.hole(part, first))
            time.sleep(1.0)
        n_sent = robot.n_pictures + robot.n_poses
        node.process.kill()
        node.process.wait()
        done = replayed(log)
        n_decisions = len(done.stdout.splitlines())
        n_events = int(re.search(r"(\d+) events", done.stderr)[1])
        node.end = lambda: None
        # 50 poses, 25 pictures and 20 ticks a second.
        took = time.monotonic() - start
        lost_s = max(0.0, (n_sent * 95 / 75 - n_events) / 95)
        row("log", f"node killed after {took:.0f} s", f"{n_events} events and {n_decisions} of {n_touches} decisions read back, "
            f"about {lost_s:.1f} s lost; {done.stderr.splitlines()[0]!r}", "all but the last second")
        check(n_decisions == n_touches and lost_s < 1.5, f"{early}: {done.stderr}")


class Simulated:
    """`tactile-filter robot` in the background."""

    def __init__(self, episodes, node="/tactile_filter"):
        words = ["robot", "--scene", "alphabet-small", "--episodes", str(episodes), "--jpeg", "90", "--node", node]
        environment = {**os.environ, "ROS_DOMAIN_ID": str(DOMAIN)}
        self.process = subprocess.Popen([dds.PROGRAM, *words], stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                                        env=environment, text=True)

    def ended(self, seconds):
        try:
            said, _ = self.process.communicate(timeout=seconds)
        except subprocess.TimeoutExpired:
            self.process.kill()
            said, _ = self.process.communicate()
            check(False, f"the robot did not end: {said[-2000:]}")
        check(self.process.returncode == 0, said)
        return said


def check_restart(_seconds):
    """The simulated robot killed within a hole, and the node."""
    with Node() as node:
        first = Simulated(3)
        wait_for("touches", lambda: len(node.decisions) >= 2, 30)
        first.process.kill()
        first.process.wait()
        start = time.monotonic()
        said = Simulated(3).ended(60)
        summary = said.splitlines()[-1]
        check(summary.startswith("3 of 3"), said)
        row("restart", "robot killed within a hole and started again", f"{summary} ({time.monotonic() - start:.0f} s)", "3 of 3")
    node = Node()
    robot = Simulated(4)
    wait_for("touches", lambda: len(node.decisions) >= 2, 30)
    node.process.kill()
    node.process.wait()
    start = time.monotonic()
    with Node() as node:
        said = robot.ended(120)
    summary = said.splitlines()[-1]
    check(summary.startswith("4 of 4"), said)
    row("restart", "node killed within a hole and started again", f"{summary} ({time.monotonic() - start:.0f} s)", "4 of 4")


class PlannersNode:
    """What `identify` asks, over the robot's middleware."""

    def __init__(self, robot):
        self.robot = robot
        self.poses = reader(robot.participant, f"rt{robot.node}/pose", ros.PoseWithCovarianceStamped, "reliable")
        self.readers = {"decision": robot.decisions, "next_pose": robot.goals, "pose": self.poses}

    def call(self, service):
        [take(of) for of in self.readers.values()]
        answer, _ = self.robot.call(service)
        return bool(answer and answer.success), answer.message if answer else "no answer"

    def latest(self, topic):
        return wait_for(f"nothing on {topic}", lambda: take(self.readers[topic]))[-1]


class PlannersArm:
    """The two motions of a touch, over a hole of a part."""

    def __init__(self, robot, part, first):
        self.robot, self.part, self.first = robot, part, first

    def press(self, pose):
        place = self.first
        if pose is not None:
            place = tuple(snapped(1000 * metres) for metres in (pose.pose.position.x, pose.pose.position.y))
        self.robot.show(None, (*place, 10))
        time.sleep(0.12)
        self.robot.show((self.part, *place), (*place, 0))
        time.sleep(SETTLE_S + 0.1)

    def lift(self):
        self.robot.show(None, (0, 0, 10))


def check_planner(_seconds):
    """The example for planners: whole holes, and a touch that is refused."""
    sys.path.insert(0, os.path.join(os.path.dirname(__file__), "../../filter/live/examples"))
    import identify as planner

    n_right, n_holes, n_touches = 0, 8, 0
    with Node() as node, Robot(node.name, PICTURES) as robot:
        robot.ready().rest()
        asked = PlannersNode(robot)
        for part, first in itertools.islice(holes(11), n_holes):
            found = planner.identify(asked, PlannersArm(robot, part, first))
            n_right += found.part == part
            n_touches += len(found.touches)
            if found.part is not None:
                variances = found.pose.pose.covariance[0], found.pose.pose.covariance[7]
                check(all(0 < variance < 1e-4 for variance in variances), f"{found.pose}")
        robot.is_filming = False
        time.sleep(1)
        part, first = next(holes(12))
        try:
            planner.identify(asked, PlannersArm(robot, part, first))
            check(False, "a touch without pictures was taken")
        except planner.Refused as refused:
            said = str(refused)
        check(said.startswith("observe: "), said)
    row("planner", "identify(region) of filter/live/examples: holes named right; touches", f"{n_right} of {n_holes}; {n_touches}")
    row("planner", "a touch without pictures", said[:60])
    check(n_right >= n_holes - 1, "holes named wrongly")


CHECKS = {
    "planner": check_planner,
    "restart": check_restart,
    "encodings": check_encodings,
    "trouble": check_trouble,
    "late": check_late,
    "graph": check_graph,
    "two": check_two,
    "large": check_large,
    "damaged": check_damaged,
    "fuzz": check_fuzz,
    "camera": check_killed_camera,
    "stopped": check_stopped,
    "log": check_killed_node,
    "fresh": check_fresh,
    "run": check_run,
    "bare": check_bare,
}


def main():
    global WORDS, PICTURES
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program")
    for name in ("model", "bank", "pictures"):
        parser.add_argument(f"--{name}", required=True)
    parser.add_argument("--out", default=".", help="where logs go")
    parser.add_argument("--seconds", type=float, default=60, help="how long the long check runs")
    parser.add_argument("--only", choices=CHECKS, action="append")
    WORDS = parser.parse_args()
    dds.PROGRAM = WORDS.program
    PICTURES = Pictures(WORDS.pictures)
    for name in WORDS.only or CHECKS:
        CHECKS[name](WORDS.seconds)
    print("\n| what | measured | target |\n|---|---|---|")
    for _, what, measured, target in ROWS:
        print(f"| {what} | {measured} | {target} |")
    print("all checks passed")


if __name__ == "__main__":
    main()
