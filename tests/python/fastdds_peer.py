"""Robot and camera on Fast DDS: what `live_peer.py` takes of CycloneDDS, over the program of `tests/fastdds/peer.cpp`.

FASTDDS_PEER is that program; with FASTDDS_TRANSPORT=udp it leaves shared memory alone. Messages are the same Python types.
"""

import collections
import os
import struct
import subprocess
import threading
import time

import dds_types as ros

# The identity of no sample, and the number of a sample that has none yet.
NONE = bytes(24)
UNKNOWN = (-1 << 32).to_bytes(8, "little", signed=True)


class DomainParticipant:
    """The program in the background. It leaves the domain when nothing refers to this any more."""

    def __init__(self, domain):
        command = [os.environ["FASTDDS_PEER"], str(domain), os.environ.get("FASTDDS_TRANSPORT", "")]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        self.endpoints, self.lock = {}, threading.Lock()
        threading.Thread(target=_read, args=(self.process.stdout, self.endpoints), daemon=True).start()

    def send(self, kind, number, body):
        with self.lock:
            self.process.stdin.write(struct.pack("<IcI", 5 + len(body), kind, number) + body)
            self.process.stdin.flush()

    def make(self, kind, topic, type_, delivery, depth):
        """A reader or writer; its number and what is known of it."""
        known = Known()
        with self.lock:
            number = len(self.endpoints) + 1
            self.endpoints[number] = known
        qos = struct.pack("<BBI", delivery != "newest", delivery == "latched", depth)
        name = type_.__idl_typename__.replace(".", "::")
        self.send(kind, number, qos + topic.encode() + b"\0" + name.encode() + b"\0")
        known.wait(lambda: known.guid)
        return number, known

    def __del__(self):
        self.process.stdin.close()
        try:
            self.process.wait(5)
        except subprocess.TimeoutExpired:
            self.process.kill()


class Known:
    """What the program has said of a reader or writer."""

    def __init__(self):
        self.guid, self.n_matched = None, 0
        self.samples, self.written = collections.deque(), collections.deque()
        self.news = threading.Condition()

    def wait(self, condition, seconds=10):
        with self.news:
            if not self.news.wait_for(condition, seconds):
                raise RuntimeError("the program on Fast DDS does not answer")


def _read(stream, endpoints):
    while len(head := stream.read(9)) == 9:
        n_bytes, kind, number = struct.unpack("<IcI", head)
        body = stream.read(n_bytes - 5)
        known = endpoints[number]
        with known.news:
            if kind == b"C":
                known.guid = body
            elif kind == b"N":
                known.n_matched = int.from_bytes(body, "little")
            elif kind == b"I":
                known.written.append(body)
            else:
                known.samples.append((body[24:48], body[48:]))
            known.news.notify_all()


class Writer:
    def __init__(self, *asked):
        self.participant = asked[0]
        self.number, self.known = self.participant.make(b"W", *asked[1:])

    def write(self, message, answers=NONE):
        self.participant.send(b"S", self.number, answers + message.serialize(use_version_2=False))


class Reader:
    def __init__(self, *asked):
        self.participant, self.kind = asked[0], asked[2]
        self.number, self.known = self.participant.make(b"R", *asked[1:])

    def take(self):
        """All that came, each with the identity of the sample that it answers."""
        came = []
        while self.known.samples:
            answers, cdr = self.known.samples.popleft()
            came.append((answers, self.kind.deserialize(cdr)))
        return came


def writer(participant, topic, kind=ros.CompressedImage, delivery="newest", depth=10):
    return Writer(participant, topic, kind, delivery, depth)


def reader(participant, topic, kind=ros.CompressedImage, delivery="newest", depth=10):
    return Reader(participant, topic, kind, delivery, depth)


def take(of):
    """All that came."""
    return [message for _, message in of.take()]


def n_matched(of):
    """How many endpoints match a reader or writer."""
    return of.known.n_matched


class Client:
    """Calls a service of std_srvs/Trigger as rmw_fastrtps does: whose answer it is says the sample's identity."""

    def __init__(self, participant, service):
        self.to = writer(participant, f"rq{service}Request", ros.PlainRequest, "reliable")
        self.answers = reader(participant, f"rr{service}Reply", ros.PlainResponse, "reliable")

    def is_found(self):
        return n_matched(self.to) and n_matched(self.answers)

    def ask(self):
        """Calls; the call's identity: the endpoint that is to be answered, and the number that Fast DDS gave it."""
        self.to.write(ros.PlainRequest(), self.answers.known.guid + UNKNOWN)
        self.to.known.wait(lambda: self.to.known.written)
        return self.to.known.written.popleft()[16:]

    def answer(self, call):
        """The answer of a call, if it came."""
        mine = {self.answers.known.guid, self.to.known.guid}
        return next((answer for of, answer in self.answers.take() if of[:16] in mine and of[16:] == call), None)
