//! The banks that holes are compared with: the whole one, or one without the hole's own part.

use std::sync::Arc;

use rand::RngExt;
use tactile_data::sensor::simulator::frame_rng;
use tactile_infer::Bank;
use tactile_infer::bank::simulated::learner::Learner;
use tactile_infer::embedding::threads;

use crate::error::{Error, Result};
use crate::hole::Hole;
use crate::holes::Holes;
use crate::protocol::Protocol;

/// The bank that each hole is compared with.
#[derive(Debug)]
pub struct Banks {
    whole: Arc<Bank>,
    absent: bool,
    n_classes: Option<usize>,
    /// Makes a bank that learnt from its parts again without the one that is to be absent.
    learner: Option<Arc<Learner>>,
}

impl Banks {
    /// Prepares what a protocol asks for. A bank that learnt from its parts needs a learner where one of them is
    /// absent: what the absent part taught is left out with it.
    ///
    /// # Errors
    /// No learner where one is needed.
    pub fn new(whole: Arc<Bank>, protocol: &Protocol, learner: Option<Arc<Learner>>) -> Result<Self> {
        let absent = protocol.absent;
        if absent && whole.metric().is_some() && learner.is_none() {
            let got = "one that learnt from the absent part's touches, too";
            return Err(Error::invalid("bank", "one that can learn again without the absent part", got));
        }
        Ok(Self { whole, absent, n_classes: protocol.n_classes, learner })
    }

    /// The bank of all parts.
    pub fn whole(&self) -> &Arc<Bank> {
        &self.whole
    }

    /// What `work` makes of each episode's number and bank, in order of the episodes. Of the banks without a part one
    /// is held at a time.
    ///
    /// # Errors
    /// The first that `work` returns, and a bank that cannot be made.
    pub fn each<T: Send>(
        &self,
        holes: Holes<'_>,
        protocol: &Protocol,
        work: impl Fn(usize, &Arc<Bank>) -> Result<T> + Sync,
    ) -> Result<Vec<T>> {
        let hole = |index| protocol.hole(holes, self.whole.start(), index);
        if !self.absent {
            return threads::each(protocol.episodes.clone(), |index| work(index, &self.of(&hole(index))?));
        }
        let mut made = Vec::new();
        for part in 0..self.whole.parts().len() {
            let episodes: Vec<usize> =
                protocol.episodes.clone().filter(|index| hole(*index).part_index() == part).collect();
            if episodes.is_empty() {
                continue;
            }
            let bank = self.without(part)?;
            let of_part = threads::each(0..episodes.len(), |at| work(episodes[at], &bank))?;
            made.extend(episodes.into_iter().zip(of_part));
        }
        made.sort_unstable_by_key(|(index, _)| *index);
        Ok(made.into_iter().map(|(_, made)| made).collect())
    }

    /// The bank of a hole: whole, without its own part, or of its own part and others drawn with the episode, which
    /// shares the rows of the whole one.
    ///
    /// # Errors
    /// A bank that cannot be made.
    pub fn of(&self, hole: &Hole<'_>) -> Result<Arc<Bank>> {
        if self.absent {
            return self.without(hole.part_index());
        }
        let Some(n_classes) = self.n_classes else { return Ok(self.whole.clone()) };
        // Frames are drawn from other seeds, so that the touches are those of the whole bank.
        let mut rng = frame_rng(hole.seed() ^ 0x636c_6173, hole.episode_stream());
        let mut kept: Vec<usize> = (0..self.whole.parts().len()).collect();
        let mut others: Vec<usize> = kept.iter().copied().filter(|part| *part != hole.part_index()).collect();
        while kept.len() > n_classes {
            let out = others.swap_remove(rng.random_range(0..others.len()));
            kept.retain(|part| *part != out);
        }
        Ok(Arc::new(self.whole.with_parts(&kept)?))
    }

    /// The bank without a part, and without what that taught.
    fn without(&self, part: usize) -> Result<Arc<Bank>> {
        let bank = match &self.learner {
            Some(learner) => {
                let bank = learner.without(part)?.with_precision(self.whole.rows().precision())?;
                bank.with_maps_of(&self.whole.without(part)?)?
            }
            None => self.whole.without(part)?,
        };
        Ok(Arc::new(bank))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::result::Poses;
    use tactile_data::dataset::touch::Side;
    use tactile_data::pose::grid::PoseGrid;
    use tactile_data::scene::Scene;
    use tactile_data::sensor::simulator::Simulator;
    use tactile_infer::bank::metric::{Measured, Metric};
    use tactile_infer::bank::rows::Rows;

    fn bank(names: &[String]) -> Bank {
        let grid = PoseGrid { xy_half_mm: 0.0, xy_step_mm: 4.0, theta_half_deg: 0.0, theta_step_deg: 30.0 };
        let rows = Rows::new(2, [1.0, 0.0].repeat(names.len())).unwrap();
        Bank::from_rows(names.to_vec(), grid, rows, vec![0.5; names.len()], "").unwrap()
    }

    fn protocol(absent: bool, n_classes: Option<usize>) -> Protocol {
        Protocol {
            n_episodes: 40,
            episodes: 3..40,
            seeds: vec![1, 2],
            poses: Poses::OffGrid,
            absent,
            n_classes,
            choose_ms: None,
            start_known_to: None,
            n_prints: 1,
            n_earlier: 0,
            n_touches: 2,
        }
    }

    #[test]
    fn each_hole_has_its_own_bank_in_order_of_the_episodes() {
        let simulator = Simulator::new(Scene::preset("connectors").unwrap(), 1).unwrap();
        let holes = Holes::Simulated(&simulator, Side::Hole);
        let whole = Arc::new(bank(holes.parts()));
        for (absent, n_classes, n_expected) in [(false, None, 6), (false, Some(3), 3), (true, None, 5)] {
            let protocol = protocol(absent, n_classes);
            let banks = Banks::new(whole.clone(), &protocol, None).unwrap();
            let note = |index, bank: &Arc<Bank>| Ok((index, bank.parts().to_vec()));
            let seen = banks.each(holes, &protocol, note).unwrap();
            assert_eq!(seen.iter().map(|(index, _)| *index).collect::<Vec<_>>(), (3..40).collect::<Vec<_>>());
            for (index, parts) in seen {
                let hole = protocol.hole(holes, whole.start(), index);
                assert_eq!((parts.len(), parts.contains(&hole.part().to_owned())), (n_expected, !absent), "{index}");
            }
        }
    }

    #[test]
    fn a_bank_that_learnt_from_the_absent_part_is_refused() {
        let names = ["A", "B", "C"].map(String::from);
        let metric = Metric::new(2, vec![1.0, 0.0, 0.3, 2.0], Measured { error_scale: 0.7 }).unwrap();
        let learnt = Arc::new(bank(&names).with_metric(metric).unwrap());
        let new = |bank: &Arc<Bank>, absent| Banks::new(bank.clone(), &protocol(absent, None), None);
        let error = new(&learnt, true).unwrap_err().to_string();
        assert!(error.contains("can learn again without the absent part"), "{error}");
        assert!(new(&learnt, false).is_ok() && new(&Arc::new(bank(&names)), true).is_ok());
    }
}
