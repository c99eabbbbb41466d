//! The simulated robot's side of an episode: the hole under the sensor, with its true part and pose.

use rand::RngExt;
use tactile_data::frame::Frame;
use tactile_data::grid::PoseGrid;
use tactile_data::se2::Se2;
use tactile_data::simulator::{Simulator, frame_rng};
use tactile_data::touch::Side;
use tactile_filter::action::Action;
use tactile_filter::{Observation, Sensor};

use crate::error::Result;
use crate::result::Poses;

/// One simulated hole under the sensor: the robot's side of an episode.
pub struct Hole<'a> {
    simulator: &'a Simulator,
    part: usize,
    symmetric: bool,
    first: Se2,
    part_from_sensor: Se2,
    seed: u64,
    stream: u64,
}

impl<'a> Hole<'a> {
    /// The hole of an episode: part and pose follow from the seed and the episode's number.
    pub fn new(simulator: &'a Simulator, grid: &PoseGrid, poses: Poses, seed: u64, episode: usize) -> Self {
        // A dataset's frames are drawn from small streams of its seed; an episode's from these.
        let (seed, stream) = (seed ^ 0x686f_6c65, (episode as u64 + 1) << 20);
        let mut rng = frame_rng(seed, stream);
        let part = rng.random_range(0..simulator.parts().len());
        let first = match poses {
            Poses::OnGrid => grid.pose(rng.random_range(0..grid.len())),
            Poses::OffGrid => {
                let mut around = |half: f64| half * (2.0 * rng.random::<f64>() - 1.0);
                Se2::from_degrees(around(grid.xy_half_mm), around(grid.xy_half_mm), around(grid.theta_half_deg))
            }
        };
        Self {
            simulator,
            part,
            symmetric: simulator.is_half_turn_symmetric(part),
            first,
            part_from_sensor: first,
            seed,
            stream,
        }
    }

    /// The hole of one part; the pose follows from the seed and the episode's number.
    pub fn of_part(simulator: &'a Simulator, part: usize, grid: &PoseGrid, seed: u64, episode: usize) -> Self {
        let symmetric = simulator.is_half_turn_symmetric(part);
        Self { part, symmetric, ..Self::new(simulator, grid, Poses::OffGrid, seed, episode) }
    }

    /// Name of the part whose hole this is.
    pub fn part(&self) -> &str {
        &self.simulator.parts()[self.part]
    }

    /// Index in the scene of the part of a name; 0 for another name.
    pub fn index_of(&self, part: &str) -> usize {
        self.simulator.parts().iter().position(|name| name == part).unwrap_or(0)
    }

    /// Index of the part in the scene.
    pub fn part_index(&self) -> usize {
        self.part
    }

    /// Whether the part looks the same after half a turn.
    pub fn is_symmetric(&self) -> bool {
        self.symmetric
    }

    /// Number of the episode's stream of random draws.
    pub(crate) fn episode_stream(&self) -> u64 {
        self.stream >> 20
    }

    /// Seed of the hole's random draws.
    pub(crate) fn seed(&self) -> u64 {
        self.seed
    }

    /// True pose of the first touch.
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
        let mut rng = frame_rng(self.seed, self.stream);
        Ok(self.simulator.touch(self.part, Side::Hole, &self.part_from_sensor, &mut rng)?)
    }

    /// Moves the sensor; returns the motion actually made.
    pub fn go(&mut self, action: &Action) -> Se2 {
        self.part_from_sensor = self.part_from_sensor * action.sensor_from_next;
        action.sensor_from_next
    }

    /// The motions that the reach allows from here: to the recorded poses, or off the grid those of the
    /// scene's reach, seen from the first touch.
    pub fn reach(&self, recorded: &PoseGrid, poses: Poses) -> Vec<Se2> {
        let grid = match poses {
            Poses::OnGrid => *recorded,
            Poses::OffGrid => self.simulator.scene().reach.unwrap_or(*recorded),
        };
        let sensor_from_part = self.part_from_sensor.inverse();
        let origin = match poses {
            Poses::OnGrid => Se2::IDENTITY,
            Poses::OffGrid => self.first,
        };
        (0..grid.len()).map(|cell| sensor_from_part * origin * grid.pose(cell)).collect()
    }
}

/// What a simulated frame shows.
///
/// # Errors
/// A frame that the sensor refuses.
pub fn observe(sensor: &Sensor, frame: &Frame) -> Result<Observation> {
    Ok(sensor.observe(frame)?.of_simulation())
}

/// The no-contact frame of the robot's own session, not the bank's.
pub fn at_rest(simulator: &Simulator, seeds: &[u64]) -> Frame {
    simulator.no_contact(seeds.first().copied().unwrap_or(0) ^ 0x7265_7374)
}
