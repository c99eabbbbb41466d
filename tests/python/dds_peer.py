"""CycloneDDS against our ROS 2 transport: both ways, services, restarts, malformed messages. Run by `cargo xtask dds`.

    pip install cyclonedds==11.0.1
    python tests/python/dds_peer.py target/release/examples/ros2_peer [--seconds 600] [--only NAME]

CycloneDDS shares no code with the middleware that is checked. All traffic stays on 127.0.0.1. Prints a line of figures
for each check and ends with exit code 1 at the first that fails.
"""

import argparse
import contextlib
import glob
import json
import os
import random
import signal
import socket
import statistics
import subprocess
import sys
import tempfile
import threading
import time
import zlib

os.environ["ROS_LOCALHOST_ONLY"] = "1"
# No other node says how the messages of the graph are laid out.
os.environ["ROS_DISTRO"] = "jazzy"
os.environ["CYCLONEDDS_URI"] = (
    "<CycloneDDS><Domain><General><Interfaces><NetworkInterface address='127.0.0.1'/></Interfaces>"
    "<AllowMulticast>false</AllowMulticast></General><Discovery><Peers><Peer address='127.0.0.1'/></Peers>"
    "<ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>40</MaxAutoParticipantIndex>"
    "</Discovery></Domain></CycloneDDS>"
)

import dds_types as ros  # noqa: E402
from cyclonedds.domain import DomainParticipant  # noqa: E402
from cyclonedds.internal import InvalidSample  # noqa: E402
from cyclonedds.pub import DataWriter  # noqa: E402
from cyclonedds.sub import DataReader  # noqa: E402
from cyclonedds.topic import Topic  # noqa: E402

DOMAIN = 77
RATE_HZ = 25


class Ours:
    """Our program in the background, its lines of JSON read as they come."""

    def __init__(self, *words, ros_args=(), variables=()):
        environment = {**os.environ, "ROS_DOMAIN_ID": str(DOMAIN), **dict(variables)}
        command = [PROGRAM, *map(str, words), "--ros-args", *ros_args]
        self.said = tempfile.TemporaryFile("w+")
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=self.said, env=environment, text=True)
        self.events, self.news = [], threading.Condition()
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self):
        for line in self.process.stdout:
            with self.news:
                self.events.append(json.loads(line))
                self.news.notify_all()

    def of(self, kind):
        with self.news:
            return [event for event in self.events if event["event"] == kind]

    def wait(self, kind, count=1, seconds=15):
        """The first `count` events of a kind, waited for."""
        deadline = time.monotonic() + seconds
        while len(found := self.of(kind)) < count:
            left = deadline - time.monotonic()
            check(left > 0 and self.process.poll() is None, f"{count} {kind}: {len(found)} came; {self.events[-3:]}")
            with self.news:
                self.news.wait(min(left, 0.2))
        return found

    def cpu_s(self):
        with open(f"/proc/{self.process.pid}/stat") as file:
            fields = file.read().rsplit(")", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def rss_kib(self):
        with open(f"/proc/{self.process.pid}/status") as file:
            return next(int(line.split()[1]) for line in file if line.startswith("VmRSS"))

    def is_alive(self):
        return self.process.poll() is None

    def end(self):
        self.process.kill()
        self.process.wait()
        self.said.seek(0)
        said = self.said.read()
        check("panicked" not in said, said)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.end()


def check(is_right, what):
    if not is_right:
        sys.exit(f"FAILED: {what}")


def say(name, text):
    print(f"{name:12} {text}", flush=True)


def writer(participant, topic, kind=ros.CompressedImage, delivery="newest", depth=10):
    qos = ros.qos(delivery, depth)
    return DataWriter(participant, Topic(participant, topic, kind, qos=qos), qos=qos)


def reader(participant, topic, kind=ros.CompressedImage, delivery="newest", depth=10):
    qos = ros.qos(delivery, depth)
    return DataReader(participant, Topic(participant, topic, kind, qos=qos), qos=qos)


def take(of):
    """All that came; Cyclone mixes in what is no message."""
    return [sample for sample in of.take(100) if not isinstance(sample, InvalidSample)]


def n_matched(of):
    """How many endpoints match a reader or writer."""
    is_writer = isinstance(of, DataWriter)
    return (of.get_publication_matched_status() if is_writer else of.get_subscription_matched_status()).current_count


class Client:
    """Calls a service of std_srvs/Trigger as rmw_cyclonedds does: whose answer it is says its first field."""

    def __init__(self, participant, service):
        self.to = writer(participant, f"rq{service}Request", ros.CycloneRequest, "reliable")
        self.answers = reader(participant, f"rr{service}Reply", ros.CycloneResponse, "reliable")
        self.id, self.n_calls = random.randrange(1 << 62), 0

    def is_found(self):
        return n_matched(self.to) and n_matched(self.answers)

    def ask(self):
        """Calls; the call's number."""
        self.n_calls += 1
        self.to.write(ros.CycloneRequest(self.id, self.n_calls))
        return self.n_calls

    def answer(self, call):
        """The answer of a call, if it came."""
        return next((of for of in take(self.answers) if (of.client, of.number) == (self.id, call)), None)


def wait_for(what, condition, seconds=15):
    deadline = time.monotonic() + seconds
    while not (result := condition()):
        check(time.monotonic() < deadline, what)
        time.sleep(0.01)
    return result


def picture(number, n_bytes):
    rest = random.Random(number).randbytes(n_bytes - 12)
    data = number.to_bytes(8, "little") + zlib.crc32(rest).to_bytes(4, "little") + rest
    now = time.time_ns()
    header = ros.Header(ros.Time(now // 10**9, now % 10**9), "gel")
    return ros.CompressedImage(header, "jpeg", data)


def is_whole(message):
    data = bytes(message.data)
    return zlib.crc32(data[12:]) == int.from_bytes(data[8:12], "little")


def number_of(message):
    return int.from_bytes(bytes(message.data[:8]), "little")


def paced(count, rate_hz=RATE_HZ):
    """Yields 0, 1, ... at a rate."""
    start = time.monotonic()
    for number in range(count):
        time.sleep(max(0.0, start + number / rate_hz - time.monotonic()))
        yield number


def quantiles(latencies_us):
    ordered = sorted(latencies_us)
    p99 = ordered[min(len(ordered) - 1, int(0.99 * len(ordered)))]
    return f"median {statistics.median(ordered) / 1000:.1f} ms, p99 {p99 / 1000:.1f} ms"


def check_in(seconds):
    """Frames of CycloneDDS to us: nothing lost, each whole."""
    for n_bytes in (9_600, 20_000, 203_000, 839_000):
        count = int(max(4, min(seconds, 12)) * RATE_HZ)
        participant = DomainParticipant(DOMAIN)
        with Ours("--seconds", 60, "--subscribe", "/gelsight/image", "newest") as ours:
            ours.wait("ready")
            to_us = writer(participant, "rt/gelsight/image")
            ours.wait("matched")
            time.sleep(0.5)
            before, start = ours.cpu_s(), time.monotonic()
            for number in paced(count):
                to_us.write(picture(number, n_bytes))
            time.sleep(1)
            cpu = (ours.cpu_s() - before) / (time.monotonic() - start)
            came = ours.of("message")
            lost = count - len({message["number"] for message in came})
            counted = sum(message["lost"] for message in came)
            check(all(message["whole"] and message["bytes"] == n_bytes for message in came), f"in {n_bytes}: not whole")
            check(lost == 0, f"in {n_bytes}: {lost} of {count} lost ({counted} counted)")
            # RustDDS forgets it where a message comes in pieces.
            check(n_bytes > 10_000 or all(message["source"] for message in came), "the time of sending is missing")
            times = [message["latency_us"] for message in came]
            say("in", f"{n_bytes} bytes: {count} sent, {lost} lost, {quantiles(times)}, {100 * cpu:.1f} % of a core")


def check_out(seconds):
    """Our frames to CycloneDDS."""
    for n_bytes, delivery in ((9_600, "newest"), (20_000, "newest"), (203_000, "newest"), (203_000, "reliable"), (839_000, "reliable")):
        count = int(max(4, min(seconds, 12)) * RATE_HZ)
        participant = DomainParticipant(DOMAIN)
        from_us = reader(participant, "rt/gelsight/image", delivery=delivery)
        with Ours("--seconds", 60, "--publish", "/gelsight/image", delivery, n_bytes, RATE_HZ, count) as ours:
            ours.wait("matched")
            came, latencies, deadline = [], [], time.monotonic() + count / RATE_HZ + 3
            while time.monotonic() < deadline and len(came) < count:
                for message in take(from_us):
                    stamp = message.header.stamp
                    latencies.append((time.time_ns() - stamp.sec * 10**9 - stamp.nanosec) / 1000)
                    check(is_whole(message) and len(message.data) == n_bytes, f"out {n_bytes}: not whole")
                    came.append(number_of(message))
                time.sleep(0.0005)
            lost = count - len(set(came))
            check(lost == 0, f"out {n_bytes} {delivery}: {lost} of {count} lost")
            say("out", f"{n_bytes} bytes, {delivery}: {count} sent, {lost} lost, {quantiles(latencies)}")


def check_services(_seconds):
    """Calls both ways, in the form of rmw_cyclonedds."""
    participant = DomainParticipant(DOMAIN)
    with Ours("--seconds", 30, "--serve", "~/observe", "--call", "/robot/go", 5, ros_args=["-r", "__ns:=/left"]) as ours:
        ours.wait("ready")
        asking = writer(participant, "rq/left/peer/observeRequest", ros.CycloneRequest, "reliable")
        answers = reader(participant, "rr/left/peer/observeReply", ros.CycloneResponse, "reliable")
        requests = reader(participant, "rq/robot/goRequest", ros.CycloneRequest, "reliable")
        answering = writer(participant, "rr/robot/goReply", ros.CycloneResponse, "reliable")
        wait_for("our service is not found", lambda: asking.get_publication_matched_status().current_count)
        latencies = []
        for number in range(50):
            start = time.monotonic()
            asking.write(ros.CycloneRequest(0x1122334455667788, number))
            came = wait_for(f"no answer to call {number}", lambda: take(answers))
            latencies.append((time.monotonic() - start) * 1e6)
            right = ros.CycloneResponse(0x1122334455667788, number, True, "done: ~/observe")
            check(came == [right], f"{came} instead of {right}")
        taken = []
        deadline = time.monotonic() + 10
        while len(taken) < 5 and time.monotonic() < deadline:
            for request in take(requests):
                taken.append(request)
                # To another client first, which must be ignored.
                answering.write(ros.CycloneResponse(request.client + 1, request.number, False, "not yours"))
                answering.write(ros.CycloneResponse(request.client, request.number, True, f"went {request.number}"))
            time.sleep(0.01)
        came = ours.wait("response", 5)
        check([answer["message"] for answer in came] == [f"went {n}" for n in range(1, 6)], f"{came}")
        say("services", f"50 calls answered, {quantiles(latencies)}; 5 calls made, 5 answers")


def check_two_of_ours(_seconds):
    """Calls between two of ours, in the form of Fast DDS."""
    with Ours("--seconds", 30, "--serve", "/robot/go") as server, Ours("--seconds", 30, "--call", "/robot/go", 20) as ours:
        came = ours.wait("response", 20)
        check(all(answer["success"] and answer["message"] == "done: /robot/go" for answer in came), f"{came}")
        check(len(server.of("request")) == 20, "a call came twice")
        say("plain calls", "20 calls, 20 answers")


def check_restart(_seconds):
    """A publisher that is killed without a word, and comes back."""
    script = (
        "import sys, time; sys.path.insert(0, sys.argv[1]); import dds_peer as d\n"
        "w = d.writer(d.DomainParticipant(d.DOMAIN), 'rt/gelsight/image')\n"
        "n = 0\n"
        "while True:\n w.write(d.picture(n, 20000)); n += 1; time.sleep(0.04)\n"
    )
    start = lambda: subprocess.Popen([sys.executable, "-c", script, os.path.dirname(os.path.abspath(__file__))])
    with Ours("--seconds", 90, "--subscribe", "/gelsight/image", "newest") as ours:
        ours.wait("ready")
        for turn in range(3):
            publisher = start()
            before = len(ours.of("message"))
            begun = time.monotonic()
            ours.wait("message", before + 1)
            found = time.monotonic() - begun
            ours.wait("message", before + 40)
            publisher.send_signal(signal.SIGKILL)
            publisher.wait()
            say("restart", f"{turn}: first frame {found:.1f} s after the start")
        check(all(message["whole"] for message in ours.of("message")), "not whole")
        wait_for("the dead are not lost", lambda: ours.of("matched")[-1]["peers"] == 0, 40)
        say("restart", f"killed 3 times; peers since: {[m['peers'] for m in ours.of('matched')]}")


def check_late(_seconds):
    """Who comes late gets the last message of a latched topic, both ways."""
    participant = DomainParticipant(DOMAIN)
    words = ["--publish", "/label", "latched", 100, RATE_HZ, 10, "--subscribe", "/rest", "latched"]
    to_us = writer(participant, "rt/rest", delivery="latched", depth=1)
    for number in range(3):
        to_us.write(picture(number, 100))
    with Ours("--seconds", 30, *words) as ours:
        came = ours.wait("message")
        check(came[-1]["number"] == 2, f"{came}")
        time.sleep(3)
        late = reader(participant, "rt/label", delivery="latched")
        came = wait_for("the last label", lambda: take(late))
        check([number_of(message) for message in came] == [9], f"{[number_of(message) for message in came]}")
        graph = reader(participant, "ros_discovery_info", ros.ParticipantEntities, "latched")
        nodes = wait_for("the node in the graph", lambda: take(graph))[-1].nodes
        check([(node.node_namespace, node.node_name) for node in nodes] == [("/", "peer")], f"{nodes}")
        check((len(nodes[0].readers), len(nodes[0].writers)) == (1, 3), f"{nodes}")
        lines = reader(participant, "rt/rosout", ros.Log, "latched")
        log = wait_for("rosout", lambda: take(lines))
        check((log[-1].name, log[-1].msg, log[-1].level) == ("peer", "ready", 20), f"{log}")
        say("late", "the last of 10 labels, the last of 3 rest frames, the node with 1 reader and 3 writers, its log")


def check_malformed(_seconds):
    """Malformed messages of CycloneDDS and of our own: each arrives as it is, and the node goes on."""
    participant = DomainParticipant(DOMAIN)
    with Ours("--seconds", 120, "--subscribe", "/noise", "newest", "--serve", "/observe") as ours:
        ours.wait("ready")
        source = random.Random(3)
        n_sent = 0
        for n_bytes in [1, 2, 3, 4, 5, 7, 8, 11, 12, 16, 17, 33, 64, 100, 1000, 3000, 70000]:
            noise = DomainParticipant(DOMAIN)
            kind = ros.garbage_type(n_bytes)
            to_us = writer(noise, "rt/noise", kind)
            wait_for("our subscription", lambda: to_us.get_publication_matched_status().current_count)
            time.sleep(0.3)
            for _ in range(100):
                to_us.write(kind(source.randbytes(n_bytes)))
                n_sent += 1
                time.sleep(0.002)
            del to_us, noise
        time.sleep(1)
        before = ours.rss_kib()
        with Ours("--seconds", 60, "--garbage", "/noise", 10_000) as noisy:
            wait_for("10,000 malformed messages", lambda: len(noisy.of("unsent")) or noisy.process.poll() is not None
                     or len(ours.of("malformed")) + len(ours.of("message")) >= n_sent + 9_900, 60)
        time.sleep(1)
        came = len(ours.of("malformed")) + len(ours.of("message"))
        lost = sum(event.get("lost", 0) for event in ours.of("malformed"))
        # Requests of a service that are none.
        wrong = writer(participant, "rq/observeRequest", ros.Header, "reliable")
        check(ours.is_alive(), "the node ended")
        to_us = writer(participant, "rt/noise")
        time.sleep(2)
        to_us.write(picture(5, 20_000))
        wait_for("a picture after the noise", lambda: [m for m in ours.of("message") if m["number"] == 5])
        text = f"{n_sent} of CycloneDDS and 10000 of ours sent, {came} came, {lost} given up by the queue"
        say("malformed", f"{text}; memory {before} -> {ours.rss_kib()} KiB")
        del wrong


def ports():
    """The UDP ports of participants 0 to 9 of the domain (RTPS 2.5, 9.6.2.3)."""
    base = 7400 + 250 * DOMAIN
    return [base, base + 1] + [base + offset + 2 * participant for participant in range(10) for offset in (10, 11)]


def packets(source, count, seen):
    """Packets that look like RTPS more and more: noise, a right beginning, submessages with wrong lengths, and what a
    real program sent with bytes changed."""
    for number in range(count):
        kind = number % 8
        if kind == 0:
            yield source.randbytes(source.randrange(0, 1400))
        elif kind == 1:
            yield b"RTPS\x02\x03\x01\x10" + source.randbytes(12) + source.randbytes(source.randrange(0, 300))
        elif kind == 2:
            packet = b"RTPS\x02\x03\x01\x10" + source.randbytes(12)
            for _ in range(source.randrange(1, 6)):
                name = source.choice([0x01, 0x06, 0x07, 0x08, 0x09, 0x0C, 0x0D, 0x0E, 0x0F, 0x12, 0x13, 0x15, 0x16])
                body = source.randbytes(source.randrange(0, 120))
                length = source.choice([len(body), 0, 0xFFFF, source.randrange(0, 200)])
                packet += bytes([name, source.randrange(256)]) + length.to_bytes(2, "little") + body
            yield packet
        else:
            packet = bytearray(source.choice(seen))
            for _ in range(source.randrange(1, 5)):
                # Behind the sender's name, most of the time: a stranger's messages are not looked at.
                at = source.randrange(20, len(packet)) if kind > 3 else source.randrange(len(packet))
                packet[at] = source.choice([0, 0xFF, 0x7F, packet[at] ^ 1 << source.randrange(8)])
            if kind == 7:
                packet = packet[: source.randrange(len(packet))]
            # RustDDS 0.15.1 believes a known publisher: it lists each number that a heartbeat or a gap claims, 2^60 of
            # them, and makes room for a piece of a message of 4 GiB. It cannot be kept out here; the module says so.
            if not {HEARTBEAT, GAP, PIECE} & set(submessages(packet)):
                yield bytes(packet)


HEARTBEAT, GAP, PIECE = 0x07, 0x08, 0x16


def submessages(packet):
    """The kinds of a packet's submessages."""
    at = 20
    while at + 4 <= len(packet):
        yield packet[at]
        length = int.from_bytes(packet[at + 2 : at + 4], "little" if packet[at + 1] & 1 else "big")
        at += 4 + (length or len(packet))


@contextlib.contextmanager
def overheard():
    """The packets on the loopback interface to our ports while the block runs, in a list; empty where that is not
    allowed (it needs root)."""
    seen, wanted = [], set(ports())
    try:
        ear = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.ntohs(0x0800))
    except (PermissionError, AttributeError):
        yield seen
        return
    ear.bind(("lo", 0x0800))
    ear.settimeout(0.2)
    done = threading.Event()

    def listen():
        while not done.is_set():
            with contextlib.suppress(TimeoutError):
                frame = ear.recv(65536)[14:]
                udp = frame[4 * (frame[0] & 15):]
                if frame[9] == 17 and int.from_bytes(udp[2:4], "big") in wanted and len(udp) > 40:
                    seen.append(udp[8:])

    thread = threading.Thread(target=listen)
    thread.start()
    yield seen
    done.set()
    thread.join()
    ear.close()


@contextlib.contextmanager
def silent():
    """Hides what CycloneDDS, which gets the same packets, says of each."""
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)


def check_packets(_seconds):
    """Packets of noise to the node's ports, and real ones with bytes changed: it goes on."""
    source = random.Random(11)
    with overheard() as seen:
        ours = Ours("--seconds", 240, "--subscribe", "/gelsight/image", "newest", "--serve", "/observe")
        ours.wait("ready")
        participant = DomainParticipant(DOMAIN)
        to_us = writer(participant, "rt/gelsight/image")
        asking = writer(participant, "rq/observeRequest", ros.CycloneRequest, "reliable")
        ours.wait("matched", 2)
        for number in range(5):
            to_us.write(picture(number, 20_000))
            to_us.write(picture(number, 300))
            asking.write(ros.CycloneRequest(1, number))
        ours.wait("message", 8)
        time.sleep(1)
    n_seen = len(seen)
    memory = [ours.rss_kib()]
    with ours, silent(), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as noise:
        for number, packet in enumerate(packets(source, 20_000, seen or [b"RTPS\x02\x03\x01\x10" + bytes(40)])):
            for port in ports():
                noise.sendto(packet, ("127.0.0.1", port))
            if number % 20 == 0:
                time.sleep(0.005)
            if number % 5000 == 4999:
                memory.append(ours.rss_kib())
        time.sleep(15)
        memory.append(ours.rss_kib())
        check(ours.is_alive(), "the node ended")
        check(memory[-1] < memory[0] + 32 * 1024, f"memory, KiB: {memory}")
        fresh = DomainParticipant(DOMAIN)
        to_us = writer(fresh, "rt/gelsight/image")
        time.sleep(3)
        for number in paced(25):
            to_us.write(picture(100 + number, 20_000))
        came = lambda: {message["number"] for message in ours.of("message")} >= set(range(105, 125))
        wait_for("pictures after the noise", came)
        say("packets", f"20000 to each of {len(ports())} ports, from {n_seen} real ones; memory, KiB: {memory}")


def check_namespaces(_seconds):
    """Two sensors on one network."""
    participant = DomainParticipant(DOMAIN)
    sides = ["left", "right"]
    words = ["--seconds", 30, "--subscribe", "image", "newest"]
    ours = [Ours(*words, ros_args=["-r", f"__ns:=/{side}"]) for side in sides]
    [program.wait("ready") for program in ours]
    writers = [writer(participant, f"rt/{side}/image") for side in sides]
    [program.wait("matched") for program in ours]
    time.sleep(0.5)
    for number in paced(100):
        for side, to_us in enumerate(writers):
            to_us.write(picture(2 * number + side, 20_000))
    time.sleep(1)
    for side, program in enumerate(ours):
        numbers = [message["number"] for message in program.of("message")]
        check(numbers == [2 * number + side for number in range(100)], f"{sides[side]}: {len(numbers)} came")
        program.end()
    say("namespaces", "100 frames of each of two sensors, each to its own node, in order")


def check_large(_seconds):
    """Frames of 3280 x 2464 pixels, as they are and as a JPEG of that size."""
    participant = DomainParticipant(DOMAIN)
    jobs = ((3280 * 2464 * 3, 20, 1, "reliable"), (3280 * 2464 * 3, 20, 1, "newest"), (2_500_000, 100, 10, "newest"))
    for n_bytes, count, rate, delivery in jobs:
        with Ours("--seconds", 90, "--subscribe", "/gelsight/image", delivery) as ours:
            ours.wait("ready")
            to_us = writer(participant, "rt/gelsight/image", delivery="reliable", depth=2)
            ours.wait("matched")
            time.sleep(0.5)
            frames = [picture(number, n_bytes) for number in range(4)]
            before, start = ours.cpu_s(), time.monotonic()
            for number in paced(count, rate):
                frame = frames[number % 4]
                now = time.time_ns()
                frame.header.stamp = ros.Time(now // 10**9, now % 10**9)
                to_us.write(frame)
            time.sleep(3)
            cpu = (ours.cpu_s() - before) / (time.monotonic() - start)
            came = ours.of("message")
            check(all(message["whole"] for message in came), "not whole")
            times = [message["latency_us"] for message in came] or [0]
            text = f"{n_bytes} bytes at {rate} Hz, {delivery}: {len(came)} of {count}, {quantiles(times)}"
            say("large", f"{text}, {100 * cpu:.0f} % of a core, {ours.rss_kib() / 1024:.0f} MiB")
            check(delivery == "newest" or len(came) == count, f"{count - len(came)} lost of a reliable topic")
            check(ours.is_alive(), "the node ended")


def check_quality(_seconds):
    """What can never match is said."""
    participant = DomainParticipant(DOMAIN)
    only_newest = writer(participant, "rt/gelsight/image")
    other_type = writer(participant, "rt/other", ros.Image)
    with Ours("--seconds", 30, "--subscribe", "/gelsight/image", "reliable", "--subscribe", "/other", "newest") as ours:
        texts = [event["text"] for event in ours.wait("trouble", 4)]
        check(any("asks for RELIABLE VOLATILE, the other offers BEST_EFFORT" in text for text in texts), f"{texts}")
        check(any("somebody publishes sensor_msgs::msg::dds_::Image_" in text for text in texts), f"{texts}")
        say("quality", " | ".join(texts))
    del only_newest, other_type


def check_clock(_seconds):
    """The node's clock is set back an hour, and forward again."""
    found = glob.glob("/usr/lib/*/faketime/libfaketimeMT.so.1")
    if not found:
        say("clock", "left out: apt-get install faketime")
        return
    participant = DomainParticipant(DOMAIN)
    to_us = writer(participant, "rt/gelsight/image")
    offset = tempfile.NamedTemporaryFile("w", suffix=".offset")
    set_clock = lambda text: (offset.seek(0), offset.truncate(), offset.write(text), offset.flush())
    set_clock("+0s")
    faked = {"LD_PRELOAD": found[0], "FAKETIME_TIMESTAMP_FILE": offset.name, "FAKETIME_NO_CACHE": "1"}
    faked["FAKETIME_DONT_FAKE_MONOTONIC"] = "1"
    words = ["--subscribe", "/gelsight/image", "newest", "--publish", "/label", "latched", 100, RATE_HZ, 3]
    with offset, Ours("--seconds", 60, *words, variables=faked) as ours:
        ours.wait("matched")
        time.sleep(0.5)
        for turn, text in enumerate(["+0s", "-3600s", "+0s"]):
            set_clock(text)
            before = len(ours.of("message"))
            for number in paced(100):
                to_us.write(picture(1000 * turn + number, 20_000))
            time.sleep(0.5)
            came = len(ours.of("message")) - before
            check(came >= 75, f"clock at {text}: {came} of 100")
            say("clock", f"at {text}: {came} of 100 frames")
        late = reader(participant, "rt/label", delivery="latched")
        came = wait_for("the last label", lambda: take(late))
        check(number_of(came[-1]) == 2, "another label")
        check(len(ours.of("trouble")) == 2, f"{ours.of('trouble')}")


def check_long(seconds):
    """Memory and CPU over a long time."""
    participant = DomainParticipant(DOMAIN)
    words = ["--subscribe", "/gelsight/image", "newest", "--publish", "/echo", "reliable", 1000, 5, 10**9]
    with Ours("--seconds", seconds + 30, "--quiet", *words) as ours:
        ours.wait("ready")
        to_us = writer(participant, "rt/gelsight/image")
        from_us = reader(participant, "rt/echo", delivery="reliable")
        ours.wait("matched", 2)
        frames = [picture(number, 20_000) for number in range(50)]
        samples, before, start = [], ours.cpu_s(), time.monotonic()
        for number in paced(int(seconds * RATE_HZ)):
            to_us.write(frames[number % 50])
            take(from_us)
            if number % RATE_HZ == 0:
                samples.append((time.monotonic() - start, ours.rss_kib()))
        cpu = (ours.cpu_s() - before) / (time.monotonic() - start)
        # The first fifth is warming up.
        settled = samples[len(samples) // 5:]
        slope = statistics.linear_regression(*zip(*settled)).slope * 60
        say("long", f"{seconds} s: {100 * cpu:.1f} % of a core, memory {samples[0][1]} -> {samples[-1][1]} KiB, "
            f"{slope:+.1f} KiB a minute")
        check(cpu < 0.10, f"{100 * cpu:.1f} % of a core")


CHECKS = {
    "in": check_in,
    "out": check_out,
    "services": check_services,
    "plain": check_two_of_ours,
    "late": check_late,
    "quality": check_quality,
    "namespaces": check_namespaces,
    "malformed": check_malformed,
    "packets": check_packets,
    "large": check_large,
    "restart": check_restart,
    "clock": check_clock,
    "long": check_long,
}


def main():
    global PROGRAM
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program")
    parser.add_argument("--seconds", type=float, default=60, help="how long the long check runs")
    parser.add_argument("--only", choices=CHECKS, action="append")
    words = parser.parse_args()
    PROGRAM = words.program
    for name in words.only or CHECKS:
        CHECKS[name](words.seconds)
    print("all checks passed")


if __name__ == "__main__":
    main()
