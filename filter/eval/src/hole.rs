//! The robot's side of an episode: the hole under the sensor, with its true part and pose.

use rand::RngExt;
use tactile_data::frame::Frame;
use tactile_data::pose::grid::PoseGrid;
use tactile_data::pose::se2::{Se2, wrap_angle};
use tactile_data::pose::symmetry::Symmetry;
use tactile_data::sensor::simulator::frame_rng;
use tactile_filter::choice::Action;
use tactile_filter::{Observation, Sensor};

use crate::error::Result;
use crate::holes::Holes;
use crate::result::Poses;

/// One hole under the sensor: the robot's side of an episode.
pub struct Hole<'a> {
    holes: Holes<'a>,
    part: usize,
    first: Se2,
    part_from_sensor: Se2,
    seed: u64,
    stream: u64,
    print: usize,
    slopes: [f64; 2],
    first_view: Option<usize>,
    /// In a recording, the frame under the sensor, and all frames that were looked at.
    frame: usize,
    touched: Vec<usize>,
}

impl<'a> Hole<'a> {
    /// The hole of an episode, in its first print: part and pose follow from the seed and the episode's number.
    pub fn new(holes: Holes<'a>, grid: &PoseGrid, poses: Poses, seed: u64, episode: usize) -> Self {
        // A dataset's frames are drawn from small streams of its seed; an episode's from these.
        let (seed, stream) = (seed ^ 0x686f_6c65, (episode as u64 + 1) << 20);
        let mut rng = frame_rng(seed, stream);
        let touched = holes.touched();
        let part = touched[rng.random_range(0..touched.len())];
        let (first_view, first) = match (holes, poses) {
            (Holes::Recorded(recorded), _) => {
                let frames = recorded.frames(part);
                let frame = frames[rng.random_range(0..frames.len())];
                (Some(frame), recorded.pose(frame))
            }
            (_, Poses::OnGrid) => {
                let cell = rng.random_range(0..grid.len());
                (Some(cell), grid.pose(cell))
            }
            (_, Poses::OffGrid) => (None, grid.draw(&mut rng)),
        };
        let frame = first_view.unwrap_or(0);
        let (part_from_sensor, print, slopes, touched) = (first, 0, [0.0; 2], Vec::new());
        Self { holes, part, first, part_from_sensor, seed, stream, print, slopes, first_view, frame, touched }
    }

    /// The same hole in another print of its part; what was recorded has one.
    pub fn of_print(self, print: usize) -> Self {
        Self { print, ..self }
    }

    /// The same hole, tilted against the tool ([`Print::tilted`](tactile_data::sensor::simulator::Print::tilted)); what was recorded stays.
    pub fn tilted(self, slopes: [f64; 2]) -> Self {
        Self { slopes, ..self }
    }

    /// The simulated hole of one part; the pose follows from the seed and the episode's number.
    pub fn of_part(holes: Holes<'a>, part: usize, grid: &PoseGrid, seed: u64, episode: usize) -> Self {
        Self { part, ..Self::new(holes, grid, Poses::OffGrid, seed, episode) }
    }

    /// Name of the part whose hole this is.
    pub fn part(&self) -> &str {
        &self.holes.parts()[self.part]
    }

    /// Index in the scene of the part of a name; 0 for another name.
    pub fn index_of(&self, part: &str) -> usize {
        self.holes.parts().iter().position(|name| name == part).unwrap_or(0)
    }

    /// Index of the part in the scene.
    pub fn part_index(&self) -> usize {
        self.part
    }

    /// The turns after which the part looks the same.
    pub fn symmetry(&self) -> Symmetry {
        self.holes.symmetry(self.part)
    }

    /// Number of the episode's stream of random draws.
    pub(crate) fn episode_stream(&self) -> u64 {
        self.stream >> 20
    }

    /// Seed of the hole's random draws.
    pub(crate) fn seed(&self) -> u64 {
        self.seed
    }

    /// Index of the print.
    pub fn print(&self) -> usize {
        self.print
    }

    /// Which of the recorded poses, or of a recording's frames, was touched first; `None` where it was anywhere.
    pub fn first_view(&self) -> Option<usize> {
        self.first_view
    }

    /// True pose of the first touch; of a recording, the stated one.
    pub fn part_from_first(&self) -> Se2 {
        self.first
    }

    /// True pose now.
    pub fn part_from_sensor(&self) -> Se2 {
        self.part_from_sensor
    }

    /// Touches the hole where the sensor is.
    pub fn touch(&mut self) -> Result<Frame> {
        self.stream += 1;
        match self.holes {
            Holes::Simulated(simulator, side) => {
                let mut rng = frame_rng(self.seed, self.stream);
                let print = simulator.print(self.print).tilted(self.slopes);
                Ok(print.touch(self.part, side, &self.part_from_sensor, &mut rng)?)
            }
            Holes::Recorded(recorded) => {
                self.touched.push(self.frame);
                Ok(recorded.dataset().frame(self.frame))
            }
        }
    }

    /// Moves the sensor; returns the motion actually made.
    pub fn go(&mut self, action: &Action) -> Se2 {
        self.part_from_sensor = self.part_from_sensor * action.sensor_from_next;
        if let Holes::Recorded(recorded) = self.holes {
            let off = |frame: &usize| {
                let pose = recorded.pose(*frame);
                pose.distance_mm(&self.part_from_sensor)
                    + wrap_angle(pose.theta_rad - self.part_from_sensor.theta_rad).abs()
            };
            let left = self.left().min_by(|a, b| off(a).total_cmp(&off(b)));
            self.frame = left.unwrap_or(self.frame);
        }
        action.sensor_from_next
    }

    /// The frames of a recorded hole that were not looked at yet.
    fn left(&self) -> impl Iterator<Item = usize> {
        let frames = match self.holes {
            Holes::Recorded(recorded) => recorded.frames(self.part),
            Holes::Simulated(..) => &[],
        };
        frames.iter().copied().filter(|frame| !self.touched.contains(frame))
    }

    /// The motions that the reach allows from here: to the recorded poses that were not touched yet, or of a simulated
    /// hole off the grid to those of the scene's reach, seen from the first touch.
    pub fn reach(&self, recorded: &PoseGrid, poses: Poses) -> Vec<Se2> {
        let sensor_from_part = self.part_from_sensor.inverse();
        let (grid, origin) = match (self.holes, poses) {
            (Holes::Recorded(holes), _) => {
                return self.left().map(|frame| sensor_from_part * holes.pose(frame)).collect();
            }
            (Holes::Simulated(..), Poses::OnGrid) => (*recorded, Se2::IDENTITY),
            (Holes::Simulated(simulator, _), Poses::OffGrid) => {
                (simulator.scene().reach.unwrap_or(*recorded), self.first)
            }
        };
        (0..grid.len()).map(|cell| sensor_from_part * origin * grid.pose(cell)).collect()
    }
}

/// What a frame shows, without a look at whether it was seen before: an evaluation may draw one twice.
///
/// # Errors
/// A frame that the sensor refuses.
pub fn observe(sensor: &Sensor, frame: &Frame) -> Result<Observation> {
    Ok(sensor.observe(frame)?.of_simulation())
}
