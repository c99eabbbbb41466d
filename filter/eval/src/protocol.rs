//! What an evaluation runs, and which hole each of its episodes touches.

use std::ops::Range;

use rand::RngExt;
use rand_distr::StandardNormal;
use tactile_data::pose::grid::PoseGrid;
use tactile_data::pose::se2::Se2;
use tactile_data::sensor::simulator::frame_rng;
use tactile_filter::KnownStart;
use tactile_infer::Bank;

use crate::error::{Error, Result};
use crate::hole::Hole;
use crate::holes::Holes;
use crate::result::Poses;

/// Marks the errors of a camera among what is drawn of a seed.
const CAMERA: u64 = 0x6361_6d65_7261;

/// What is run, how often.
#[derive(Clone, Debug)]
pub struct Protocol {
    /// Episodes in all, shared out over the seeds.
    pub n_episodes: usize,
    /// Which of them are run here: all, or a shard.
    pub episodes: Range<usize>,
    /// Seeds of holes, poses and frames.
    pub seeds: Vec<u64>,
    /// On the grid, as the paper has it: the first touch is at a recorded pose and the motions offered lead
    /// to recorded poses. Off it: the first touch is anywhere in the recorded range, and the motions
    /// offered are those of the grid, seen from the first touch.
    pub poses: Poses,
    /// Whether the hole's own part is taken out of the bank, and of all that the bank learnt: what is felt is then none
    /// of these.
    pub absent: bool,
    /// Parts that each hole may be of: its own and others drawn with the episode; `None`: all of the bank.
    pub n_classes: Option<usize>,
    /// Milliseconds for each choice of a touch; `None`: as many as it takes, the same on every machine.
    pub choose_ms: Option<f64>,
    /// Prints of each part that holes are touched on, 1 or more; episodes take turns with them.
    pub n_prints: usize,
    /// Touches of each episode; the stopping rule is recorded and not obeyed, so that every curve is whole.
    pub n_touches: usize,
    /// Holes of a run that were named with confidence before each episode: what they told of the sensor is known.
    pub n_earlier: usize,
    /// How well a camera knows each hole's pose before it is touched: standard deviations, mm along x and along y, and degrees; `None`:
    /// it may be anywhere.
    pub start_known_to: Option<[f64; 2]>,
}

impl Protocol {
    /// Refuses what cannot be run on a scene with a bank.
    pub fn validate(&self, holes: Holes<'_>, bank: &Bank) -> Result<()> {
        if self.seeds.is_empty() || self.n_episodes == 0 || self.n_touches == 0 {
            let got = format!("{} episodes of {} seeds", self.n_episodes, self.seeds.len());
            return Err(Error::invalid("evaluation", "episodes, touches and seeds", got));
        }
        if self.episodes.end > self.n_episodes {
            let got = format!("{:?}", self.episodes);
            return Err(Error::invalid("evaluation", format!("some of {} episodes", self.n_episodes), got));
        }
        if holes.parts() != bank.parts() {
            let got = bank.parts().join(" ");
            return Err(Error::invalid("bank", format!("the scene's parts {}", holes.parts().join(" ")), got));
        }
        if let Some([mm, deg]) = self.start_known_to
            && !(mm > 0.0 && deg > 0.0 && mm.is_finite() && deg.is_finite())
        {
            return Err(Error::invalid(
                "known start",
                "two standard deviations above 0",
                format!("{mm} mm, {deg} degrees"),
            ));
        }
        self.validate_prints(holes)?;
        let n_parts = bank.parts().len();
        match self.n_classes {
            Some(_) if self.absent => Err(Error::invalid("evaluation", "classes or an absent part", "both")),
            Some(n) if !(1..=n_parts).contains(&n) => {
                Err(Error::invalid("classes", format!("1 to the bank's {n_parts}"), n.to_string()))
            }
            _ => Ok(()),
        }
    }

    /// Refuses prints where there is one, or where all look alike.
    fn validate_prints(&self, holes: Holes<'_>) -> Result<()> {
        let expected = match holes {
            _ if self.n_prints == 0 => "1 or more",
            Holes::Recorded(_) if self.n_prints > 1 => "1: recorded holes have one print",
            Holes::Simulated(simulator, _) if self.n_prints > 1 && !simulator.prints_differ() => {
                "1: this scene has no layer lines, by which prints differ"
            }
            _ => return Ok(()),
        };
        Err(Error::invalid("prints", expected, self.n_prints.to_string()))
    }

    /// Seed of an episode.
    pub(crate) fn seed(&self, index: usize) -> u64 {
        self.seeds[index % self.seeds.len()]
    }

    /// What a camera says of the first touch of an episode's hole: its pose, off by a normal error of as much as the camera knows it to.
    pub(crate) fn known_start(&self, hole: &Hole<'_>, index: usize) -> Option<KnownStart> {
        let known_to @ [mm, deg] = self.start_known_to?;
        let mut rng = frame_rng(self.seed(index) ^ CAMERA, index as u64);
        let mut off = |sd: f64| -> f64 { sd * rng.sample::<f64, _>(StandardNormal) };
        let Se2 { x_mm, y_mm, theta_rad } = hole.part_from_first();
        let seen = Se2::new(x_mm + off(mm), y_mm + off(mm), theta_rad + off(deg.to_radians()));
        Some(KnownStart::known_to(seen, known_to))
    }

    /// The hole of an episode. Part, pose and frames follow from its number and are the same for any number of prints;
    /// the seeds take turns, and once around them the prints do.
    pub fn hole<'a>(&self, holes: Holes<'a>, grid: &PoseGrid, index: usize) -> Hole<'a> {
        let print = index / self.seeds.len() % self.n_prints;
        Hole::new(holes, grid, self.poses, self.seed(index), index).of_print(print)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tactile_data::dataset::touch::Side;
    use tactile_data::scene::Scene;
    use tactile_data::sensor::simulator::Simulator;

    fn protocol(n_prints: usize, poses: Poses) -> Protocol {
        let (seeds, episodes) = (vec![1, 2], 0..12);
        let (absent, n_classes, choose_ms) = (false, None, None);
        Protocol {
            n_episodes: 12,
            episodes,
            seeds,
            poses,
            absent,
            n_classes,
            choose_ms,
            n_prints,
            n_touches: 2,
            n_earlier: 0,
            start_known_to: None,
        }
    }

    #[test]
    fn prints_take_turns_and_change_nothing_but_the_touch() {
        let simulator = Simulator::new(Scene::preset("alphabet-small").unwrap(), 1).unwrap();
        let holes = Holes::Simulated(&simulator, Side::Hole);
        let hole = |n_prints, index| protocol(n_prints, Poses::OnGrid).hole(holes, &PoseGrid::SMALL, index);
        let prints = |n_prints| (0..12).map(|index| hole(n_prints, index).print()).collect::<Vec<_>>();
        assert_eq!(prints(1), [0; 12]);
        assert_eq!(prints(3), [0, 0, 1, 1, 2, 2, 0, 0, 1, 1, 2, 2]);
        let mut n_changed = 0;
        for index in 0..12 {
            let [mut one, mut other] = [1, 3].map(|n_prints| hole(n_prints, index));
            assert_eq!((one.part(), one.part_from_first()), (other.part(), other.part_from_first()));
            assert_eq!(PoseGrid::SMALL.pose(one.first_view().unwrap()), one.part_from_first());
            let changed = one.touch().unwrap() != other.touch().unwrap();
            assert!(!changed || other.print() > 0, "{index}");
            n_changed += usize::from(changed);
        }
        // Lines show where something is in contact, and where the camera resolves them.
        assert!(n_changed > 0);
        assert_eq!(protocol(1, Poses::OffGrid).hole(holes, &PoseGrid::SMALL, 5).first_view(), None);
    }

    #[test]
    fn a_camera_is_off_as_much_as_it_says_and_the_same_each_time() {
        let simulator = Simulator::new(Scene::preset("alphabet-small").unwrap(), 1).unwrap();
        let holes = Holes::Simulated(&simulator, Side::Hole);
        let seen = Protocol { start_known_to: Some([2.0, 5.0]), ..protocol(1, Poses::OffGrid) };
        let (mut squares, n) = ([0.0; 3], 2_000);
        for index in 0..n {
            let hole = seen.hole(holes, &PoseGrid::SMALL, index);
            let start = seen.known_start(&hole, index).unwrap();
            assert_eq!(seen.known_start(&hole, index), Some(start));
            let (found, truth) = (start.part_from_first, hole.part_from_first());
            let off = [found.x_mm - truth.x_mm, found.y_mm - truth.y_mm, found.theta_rad - truth.theta_rad];
            squares.iter_mut().zip(off).for_each(|(sum, off)| *sum += off * off / n as f64);
        }
        // Of 2,000 a standard deviation is known to 1.6 %.
        for (square, sd) in squares.into_iter().zip([2.0, 2.0, 5.0_f64.to_radians()]) {
            assert!((square.sqrt() / sd - 1.0).abs() < 0.06, "{square} {sd}");
        }
        let blind = protocol(1, Poses::OffGrid);
        assert_eq!(blind.known_start(&blind.hole(holes, &PoseGrid::SMALL, 0), 0), None);
        let wrong = Protocol { start_known_to: Some([0.0, 5.0]), ..blind };
        let bank = tactile_infer::Bank::from_rows(
            holes.parts().to_vec(),
            PoseGrid { xy_half_mm: 0.0, xy_step_mm: 1.0, theta_half_deg: 0.0, theta_step_deg: 1.0 },
            tactile_infer::bank::rows::Rows::new(1, vec![1.0; holes.parts().len()]).unwrap(),
            vec![0.2; holes.parts().len()],
            "",
        );
        let refused = wrong.validate(holes, &bank.unwrap()).unwrap_err().to_string();
        assert!(refused.contains("known start: expected two standard deviations above 0"), "{refused}");
    }

    #[test]
    fn prints_that_look_alike_are_refused() {
        let mut scene = Scene::preset("alphabet-small").unwrap();
        scene.sensor.texture_mm = [0.0; 2];
        let smooth = Simulator::new(scene, 1).unwrap();
        let check = |n_prints| {
            let checked = protocol(n_prints, Poses::OnGrid).validate_prints(Holes::Simulated(&smooth, Side::Hole));
            checked.map_err(|e| e.to_string())
        };
        assert_eq!(check(1), Ok(()));
        assert!(check(2).unwrap_err().contains("this scene has no layer lines"));
        assert!(check(0).unwrap_err().contains("prints: expected 1 or more, got 0"));
    }
}
