//! Touches that the filter named become a dataset with their parts and poses: `tactile-filter replay --label`.

use std::path::Path;

use tactile_data::dataset::store::{Dataset, DatasetWriter};
use tactile_data::dataset::touch::{Side, Touch};
use tactile_data::program;
use tactile_eval::Result;
use tactile_eval::replay::Played;
use tactile_filter::Episode;

/// A part is taken for what its touches say where it is more probable than this; how well it matches is what such touches are to tell.
const LEAST_PROBABILITY: f64 = 0.99;

/// A dataset of touches with their parts and poses.
pub struct LabelledTouches<'a> {
    dataset: &'a Dataset,
    writer: DatasetWriter,
    side: Side,
    n_episodes: usize,
    n_touches: usize,
}

impl<'a> LabelledTouches<'a> {
    /// Touches of a recording, into a new folder.
    pub fn new(folder: &Path, dataset: &'a Dataset, side: Side) -> Result<Self> {
        let writer = DatasetWriter::create(folder, dataset.meta().clone(), dataset.no_contact())?;
        Ok(Self { dataset, writer, side, n_episodes: 0, n_touches: 0 })
    }

    /// Adds the touches of an episode that was played, where its part is probable enough.
    pub fn add(&mut self, number: usize, played: &[Played], episode: &Episode) -> Result<()> {
        let named = episode.estimate();
        if named.probability <= LEAST_PROBABILITY {
            return Ok(());
        }
        self.n_episodes += 1;
        for (Played { frame, .. }, touched) in played.iter().zip(episode.belief().touches()) {
            let touch = Touch {
                part: Some(named.part.clone()),
                side: Some(self.side),
                part_from_sensor: Some(named.part_from_first * touched.first_from_sensor),
                moved: None,
                episode: Some(format!("episode {number}")),
                ..self.dataset.touch(*frame).clone()
            };
            self.writer.push(&self.dataset.frame(*frame), &touch)?;
            self.n_touches += 1;
        }
        Ok(())
    }

    /// Gives the dataset its name; says how many touches it has.
    pub fn finish(self) -> Result<()> {
        if self.n_touches == 0 {
            program::warning(format_args!("no touch labelled: no part was more probable than {LEAST_PROBABILITY}"));
            return Ok(());
        }
        self.writer.finish()?;
        program::say(format_args!("{} touches of {} episodes labelled", self.n_touches, self.n_episodes));
        Ok(())
    }
}
