"""Which peg fits a hole, and where the hole is, found by touch.

Lengths are in mm, angles in radians where a name does not say degrees. Arrays that come out are copies.
"""

import os
from collections.abc import Sequence
from typing import Any, ClassVar, Literal, TypedDict, final

import numpy as np
import numpy.typing as npt
from typing_extensions import Self, TypeAlias, Unpack

__version__: str

_Path: TypeAlias = str | os.PathLike[str]
_PoseLike: TypeAlias = Pose | Sequence[float] | npt.NDArray[np.float64]
_Covariance: TypeAlias = npt.NDArray[np.float64] | Sequence[Sequence[float]]
_Reach: TypeAlias = npt.NDArray[np.float64] | Sequence[_PoseLike]
_Side: TypeAlias = Literal["hole", "peg"]
_Reason: TypeAlias = Literal["confident", "none-of-these", "touch-limit", "nothing-to-learn"]

class _Settings(TypedDict, total=False):
    stop_probability: float
    stop_place_mm: float | None
    max_touches: int
    false_accept: float | None
    false_refuse: float
    verify: int
    travel_nats_per_mm: float
    n_draws: int
    n_suppositions: int
    n_finalists: int | None
    subdivisions: int
    seed: int

class Error(Exception):
    """An error of this module. After any of them an episode is as it was before the call."""

class FrameError(Error):
    """The frame is dark, saturated, uniform or of another size: touch again."""

    fault: Literal["dark", "saturated", "uniform", "wrong-size", "other"]

class FrozenFrameError(Error):
    """The same picture, byte for byte, after a motion: the camera has stopped."""

class MotionError(Error):
    """The motion is not finite, or no robot's."""

class WrongModelError(Error):
    """The observation or bank is of another model."""

class WrongSideError(Error):
    """A touch of a peg among touches of holes, or the other way."""

class WrongBankError(Error):
    """The saved episode is of another bank or version."""

class EmptyReachError(Error):
    """No motion was offered that could be made."""

class ObservationError(Error):
    """An observation that no sensor makes."""

class ConfigError(Error):
    """A setting outside its range, or of an unknown name."""

class FileError(Error):
    """A file that the system refuses to read or write."""

class InvalidError(Error):
    """A file or value that makes no sense."""

class InternalError(Error):
    """A mistake in this library: please report it."""

@final
class Pose:
    """A pose or a motion in the plane. `a_from_b * b_from_c` is `a_from_c`."""

    __hash__: ClassVar[None]  # type: ignore[assignment]
    def __new__(cls, x_mm: float = 0.0, y_mm: float = 0.0, theta_rad: float = 0.0) -> Self: ...
    @staticmethod
    def from_degrees(x_mm: float = 0.0, y_mm: float = 0.0, theta_deg: float = 0.0) -> Pose: ...
    @property
    def x_mm(self) -> float: ...
    @property
    def y_mm(self) -> float: ...
    @property
    def theta_rad(self) -> float:
        """In (-pi, pi]."""
    @property
    def theta_deg(self) -> float: ...
    def inverse(self) -> Pose:
        """`b_from_a` of this `a_from_b`."""
    def apply(self, x_mm: float, y_mm: float) -> tuple[float, float]:
        """Takes a point of frame `b` to frame `a`, mm."""
    def distance_mm(self, other: _PoseLike) -> float:
        """The distance between the origins of two poses, mm."""
    def as_tuple(self) -> tuple[float, float, float]:
        """x mm, y mm, theta rad."""
    def __mul__(self, value: _PoseLike, /) -> Pose: ...
    def __rmul__(self, value: Any, /) -> Any: ...
    def __eq__(self, value: object, /) -> bool: ...
    def __ne__(self, value: object, /) -> bool: ...

@final
class Model:
    """A trained model on the CPU: makes embeddings of frames."""

    @staticmethod
    def load(path: _Path, *, maps: _Path | None = None) -> Model:
        """Loads a checkpoint, as `tactile-train` writes it, and with `maps` networks that draw a map of each touch.

        With banks that have maps of their parts (`tactile-infer bank --maps`), places are found and parts are verified by them.
        """
    @property
    def sha256(self) -> str:
        """64 hex digits: banks are bound to it."""
    @property
    def dim(self) -> int:
        """Length of an embedding."""
    @property
    def input_px(self) -> tuple[int, int]:
        """Width and height of the network's input; a frame has at least as many pixels."""
    @property
    def is_calibrated(self) -> bool:
        """Whether it was measured how far its similarities can be believed."""

@final
class Bank:
    """The recorded views of the parts, as embeddings."""

    @staticmethod
    def load(path: _Path, model: Model) -> Bank:
        """Loads a bank, as `tactile-infer bank` writes it, that this model made."""
    def save(self, path: _Path) -> None:
        """Writes the bank to a file, whole or not at all."""
    @property
    def parts(self) -> list[str]:
        """Names of the parts, in the order of every belief."""
    @property
    def poses(self) -> npt.NDArray[np.float64]:
        """Recorded poses `part_from_sensor` of each part: `[n_poses, 3]` (x mm, y mm, theta rad)."""
    @property
    def sha256(self) -> str:
        """64 hex digits: saved episodes are bound to it."""
    @property
    def model_sha256(self) -> str:
        """Of the model that made it, 64 hex digits."""
    def twins(self, part: str, part_from_sensor: Pose) -> list[Pose]:
        """The poses at which a part feels the same as at this one, itself first."""
    def __len__(self) -> int: ...

@final
class Observation:
    """What the filter takes in of one touch."""

    __hash__: ClassVar[None]  # type: ignore[assignment]
    def __new__(cls, query: npt.NDArray[np.float32], edge_share: float, side: _Side = "hole") -> Self:
        """Of an embedding `[dim]` alone: neither its frame nor its model is checked."""
    @property
    def query(self) -> npt.NDArray[np.float32]:
        """The embedding of what was touched: `[dim]`, of unit length."""
    @property
    def edge_share(self) -> float:
        """Share of the view that shows an edge, 0 to 1."""
    @property
    def side(self) -> _Side: ...
    def of_simulation(self) -> Observation:
        """The same, of a simulated frame: two of them may be equal though the sensor moved."""
    def __eq__(self, value: object, /) -> bool: ...
    def __ne__(self, value: object, /) -> bool: ...

@final
class Sensor:
    """The camera, the gel and its frame at rest, bound to a model; touches holes, or raised parts (`side="peg"`)."""

    def __new__(cls, model: Model, rest_frame: npt.NDArray[np.uint8], side: _Side = "hole") -> Self:
        """`rest_frame`: a frame without contact, `[height, width, 3]`, RGB."""
    def observe(self, frame: npt.NDArray[np.uint8]) -> Observation:
        """What a frame of a touch shows: `[height, width, 3]`, RGB, of the size of the frame at rest."""
    def lit_by(self, along_x: Sequence[Sequence[float]], along_y: Sequence[Sequence[float]]) -> Self:
        """The same sensor with known lamps: `[light]` of `tactile-data calibrate`, `[3, 6]` each, RGB."""
    @property
    def model(self) -> Model: ...
    @property
    def side(self) -> _Side: ...
    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height of its frames."""

@final
class SensorLight:
    """The lamps of a sensor that nobody calibrated, learnt from its touches of anything."""

    def __new__(cls, rest_frame: npt.NDArray[np.uint8], field_of_view_mm: Sequence[float]) -> Self:
        """`rest_frame`: a frame without contact, `[height, width, 3]`, RGB; what it shows, width and height."""
    def add(self, frame: npt.NDArray[np.uint8]) -> None:
        """Adds the frame of a touch, of any part, at any pose."""
    def learn(self) -> tuple[list[list[float]], list[list[float]]] | None:
        """New lamps for `Sensor.lit_by`, where there are touches enough to learn them now."""

@final
class EpisodeConfig:
    """How an episode infers, chooses and stops."""

    __hash__: ClassVar[None]  # type: ignore[assignment]
    def __new__(cls, **settings: Unpack[_Settings]) -> Self:
        """The defaults for a model of which nothing was measured."""
    @staticmethod
    def of(model: Model, side: _Side = "hole", **settings: Unpack[_Settings]) -> EpisodeConfig:
        """The defaults with what was measured of a model where this side is touched."""
    @staticmethod
    def paper(**settings: Unpack[_Settings]) -> EpisodeConfig:
        """Alg. 1 of the paper as printed."""
    def replace(self, **settings: Unpack[_Settings]) -> EpisodeConfig:
        """The same with some settings changed."""
    @property
    def n_sensor_holes(self) -> int:
        """Holes that have told of the sensor so far (`Episode.learn`)."""
    def without_sensor(self) -> EpisodeConfig:
        """The same without what holes have told of the sensor: for a new gel or another camera."""
    def with_start(self, part_from_first: _PoseLike, covariance: _Covariance) -> EpisodeConfig:
        """The same for a hole that is known to be somewhere before it is touched, from a camera or a drawing.

        `part_from_first`: pose of the sensor at the first touch, in the part's frame; `covariance`: of that pose over
        (x mm, y mm, theta rad)."""
    def with_part(
        self, base_from_part: _PoseLike, covariance: _Covariance, base_from_first: _PoseLike
    ) -> EpisodeConfig:
        """`with_start` from where the part is seen, both poses in any one frame, as the robot's base.

        `covariance`: of `base_from_part`."""
    def without_start(self) -> EpisodeConfig:
        """The same for a hole that may be anywhere."""
    @property
    def settings(self) -> _Settings:
        """All settings by name."""
    def __eq__(self, value: object, /) -> bool: ...
    def __ne__(self, value: object, /) -> bool: ...

@final
class Mode:
    """A peak of the belief."""

    __hash__: ClassVar[None]  # type: ignore[assignment]
    @property
    def part(self) -> str: ...
    @property
    def probability(self) -> float:
        """Of the peak; of its twins too, where the part is symmetric."""
    @property
    def part_from_sensor(self) -> Pose:
        """Mean pose of the sensor now."""
    @property
    def covariance(self) -> npt.NDArray[np.float64]:
        """`[3, 3]` of x mm, y mm, theta rad."""
    def __eq__(self, value: object, /) -> bool: ...
    def __ne__(self, value: object, /) -> bool: ...

@final
class RunnerUp:
    """The second most probable part."""

    __hash__: ClassVar[None]  # type: ignore[assignment]
    @property
    def part(self) -> str:
        """Its name; the first of equals."""
    @property
    def probability(self) -> float:
        """Of that part, 0 to 1."""
    def __eq__(self, value: object, /) -> bool: ...
    def __ne__(self, value: object, /) -> bool: ...

@final
class Estimate:
    """What is known after the touches so far."""

    __hash__: ClassVar[None]  # type: ignore[assignment]
    @property
    def part(self) -> str:
        """The most probable part; the first of equals."""
    @property
    def probability(self) -> float:
        """Of that part, 0 to 1."""
    @property
    def runner_up(self) -> RunnerUp | None:
        """The next likeliest part; `None` where no other is left."""
    @property
    def part_from_sensor(self) -> Pose:
        """Pose of the sensor now, on that part."""
    @property
    def part_from_first(self) -> Pose:
        """Pose of the sensor at the first touch, on that part."""
    @property
    def twins(self) -> list[Pose]:
        """The poses that touch cannot tell from `part_from_sensor`, itself first: insert at any of them."""
    @property
    def covariance(self) -> npt.NDArray[np.float64]:
        """Of the pose over all places of the part that are believed: `[3, 3]` of x mm, y mm, theta rad."""
    @property
    def offset_covariance(self) -> npt.NDArray[np.float64]:
        """How well it is known where the part is against where it is believed to be: float64 `[3, 3]` over (x mm, y mm, theta
        rad) in the part's frame. Of touches of a held peg it is that of the peg in the hand."""
    @property
    def fit(self) -> float | None:
        """How many standard deviations the touches look more like that part's views than touches of a part that is there; `None` where no edge was felt."""
    @property
    def none_probability(self) -> float | None:
        """Of none of the bank's parts, where that was as likely before the first touch; `None` where no edge was felt."""
    @property
    def stranger_rate(self) -> float | None:
        """How often a part that is not in the bank comes to so good a match at any touch; `None` where no edge was felt."""
    @property
    def class_posterior(self) -> npt.NDArray[np.float64]:
        """Probability of each part of the bank: `[n_parts]`."""
    @property
    def modes(self) -> list[Mode]:
        """Where it may be: the peaks of the belief, the heaviest first."""
    @property
    def entropy_nats(self) -> float:
        """Over all states."""
    @property
    def log_evidence(self) -> float:
        """log p(all touches), up to a constant, nats: 0 says no more than chance."""
    @property
    def n_touches(self) -> int: ...
    @property
    def warnings(self) -> list[str]:
        """Reasons to doubt all this, one sentence each."""
    def __eq__(self, value: object, /) -> bool: ...
    def __ne__(self, value: object, /) -> bool: ...

@final
class Belief:
    """How probable each part is at each pose: what an episode believed when it was asked."""

    @property
    def parts(self) -> list[str]:
        """Names of the parts, in the order of the rows."""
    @property
    def probabilities(self) -> npt.NDArray[np.float64]:
        """`[n_parts, n_cells]`, which sum to 1."""
    @property
    def poses(self) -> npt.NDArray[np.float64]:
        """Of the cells, `part_from_first` of the sensor at the first touch: `[n_cells, 3]` (x mm, y mm, theta rad)."""
    @property
    def shape(self) -> tuple[int, int, int]:
        """Numbers of x, of y and of angles, whose product is `n_cells`; the angle varies fastest."""
    @property
    def class_posterior(self) -> npt.NDArray[np.float64]:
        """Probability of each part: `[n_parts]`."""
    @property
    def first_from_sensor(self) -> Pose:
        """The sensor's motion since the first touch: a cell's pose of the sensor now is its pose times this."""
    @property
    def entropy_nats(self) -> float: ...

@final
class Touch:
    """A decision: make this motion, then touch."""

    __hash__: ClassVar[None]  # type: ignore[assignment]
    @property
    def motion(self) -> Pose:
        """Where the sensor goes, in its own frame."""
    def __eq__(self, value: object, /) -> bool: ...
    def __ne__(self, value: object, /) -> bool: ...

@final
class Done:
    """A decision: stop."""

    @property
    def estimate(self) -> Estimate: ...
    @property
    def reason(self) -> _Reason: ...

@final
class FeltMap:
    """What the touches of an episode show, stitched about the origin of the part that is named."""

    @property
    def part(self) -> str:
        """Name of the part that is named."""
    @property
    def cell_mm(self) -> float:
        """Side of a cell."""
    @property
    def values(self) -> npt.NDArray[np.float32]:
        """`[n, n, 5]`, rows from the top, the part's origin in the middle.

        Distance to the outline of the peg (mm, negative inside), the probability that the place is inside, that it touches the gel,
        the error of the distance (mm), and how many touches showed it.
        """
    @property
    def difference(self) -> tuple[float, float, float] | None:
        """From the bank's map of the part, mm2: what both show, what is inside here alone, and what there alone."""
    def picture(self, bank: Bank, cell_px: int = 3) -> npt.NDArray[np.uint8]:
        """A picture, `[n * cell_px, n * cell_px, 3]`: blue inside, red outside; the outline of the bank's part is green, and what differs from it yellow."""

@final
class Search:
    """Where to slide the peg of the named part along the plate until it goes in, the likeliest first."""

    @property
    def offsets(self) -> npt.NDArray[np.float64]:
        """By what the peg is moved from where its hole is believed to be, in the part's frame: float64 `[n, 3]` (x mm, y mm,
        theta rad); the first is no motion."""
    @property
    def covered(self) -> float:
        """How probable it is that the peg goes in at one of them, if its hole is near, 0 to 1."""

@final
class Episode:
    """One hole being identified. Threads may share one: a call waits for the one before."""

    @staticmethod
    def begin(config: EpisodeConfig, bank: Bank, observation: Observation) -> Episode:
        """Begins with the first touch."""
    @staticmethod
    def restore(record: str, bank: Bank) -> Episode:
        """An episode as it was when recorded, to the bit."""
    def record(self) -> str:
        """What is needed to go on later, or elsewhere, as JSON."""
    def observe(self, moved: _PoseLike, observation: Observation) -> None:
        """Takes in a touch after the motion that was really made since the one before, in the sensor's frame."""
    def search(
        self, play_mm: float, radius_mm: float, covariance: _Covariance | None = None, most: int = 200
    ) -> Search:
        """Where to slide the peg of the named part until it goes in.

        `play_mm`: by how much its hole is wider on every side; `radius_mm`: from the origin of the part's frame to its
        farthest point; `covariance`: of the peg's pose in the hand over (x mm, y mm, theta rad) in the part's frame, such as
        `Estimate.offset_covariance` of touches of it; none: exactly."""
    def did_not_fit(self, search: Search) -> None:
        """Takes in that the peg went in nowhere there: the hole is another part's, or elsewhere, or was missed.

        Touch again before the next try."""
    def decide(self, reach: _Reach, time_limit_s: float | None = None) -> Touch | Done:
        """Whether to stop, and if not, which motion of `reach` to make. Changes nothing.

        `reach`: the motions that the robot can make from here, in the sensor's frame: float64 `[n, 3]` (x mm, y mm,
        theta rad) or a sequence of poses. After `time_limit_s` the best found so far is taken.
        """
    def stop_reason(self) -> _Reason | None:
        """Why to stop now, whatever could still be touched; `None` to go on."""
    def learn(self, config: EpisodeConfig) -> EpisodeConfig:
        """`config` with what this hole tells of the sensor, where its part is named with confidence now.

        That is how well touches of this sensor match. Begin the next hole of the run with it, as long as gel and camera
        stay.
        """
    def estimate(self) -> Estimate:
        """What is known now."""
    def felt_map(self) -> FeltMap | None:
        """What the touches so far show of what they were made on; `None` where the model draws no maps."""
    def belief(self) -> Belief:
        """How probable each part is at each pose now."""
    def class_posterior(self) -> npt.NDArray[np.float64]:
        """Probability of each part now: `[n_parts]`."""
    @property
    def n_touches(self) -> int: ...
    @property
    def bank(self) -> Bank: ...

@final
class Simulator:
    """A simulated sensor over the holes of a scene, to try things out without a robot."""

    def __new__(cls, scene: str, seed: int = 1) -> Self:
        """`scene`: the name of a preset, such as "alphabet-small", or the path of a scene file."""
    @property
    def parts(self) -> list[str]: ...
    def rest_frame(self) -> npt.NDArray[np.uint8]:
        """The frame without contact: `[height, width, 3]`."""
    def touch(self, part: str, part_from_sensor: _PoseLike, n: int = 0) -> npt.NDArray[np.uint8]:
        """A touch of a part's hole: `[height, width, 3]`. `n`: the number of the touch, which draws its noise."""
    def bank(
        self,
        model: Model,
        xy_step_mm: float = 2.0,
        theta_step_deg: float = 15.0,
        views: Literal["pegs", "both"] = "both",
        learn_from: Literal["hole", "peg", "both", "nothing"] = "hole",
    ) -> Bank:
        """The bank of the scene's parts, touched one by one at the poses of the scene's reach in these steps.

        Its views are of pegs alone, as a robot records them, or of both sides: of the pegs and of the holes that the scene
        gives them. In which directions embeddings differ by chance is learnt from simulated touches of `learn_from`, the side
        that will be touched; from nothing they are compared by the cosine alone.

        Takes a minute or less. With steps above 2.5 mm or 20 degrees views are not interpolated.
        """
